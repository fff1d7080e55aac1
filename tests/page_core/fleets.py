"""Rates of the page's fleets: what becomes of one, four or all of eight cars at an angle.

`python -m tests.page_core.fleets --out FILE` measures the page's dials by the native core.
"""

from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Int

from socialiq.nn.dial_policy import DialPolicy
from socialiq.page.fleets import COUNTS, DIALS, OPTIONS
from socialiq.population.fleet import drive
from socialiq.results_folder import as_csv
from socialiq.statistics.intervals import normal_mean
from socialiq.storage import packaged_results, write_atomically
from socialiq.to_json import rounded
from socialiq.types import Ending, Row
from socialiq.worlds.intersection.world import Intersection

_ANGLES = np.arange(0.0, 91.0, 15.0)


def chosen_cars(seeds: np.ndarray, count: int) -> Int[np.ndarray, "episode agent"]:
    """Return 1 for so many cars in turn, the first one by the episode's seed, and 0 for others."""
    places = np.arange(OPTIONS.agents) - seeds[:, None]
    return (places % OPTIONS.agents < count).astype(np.int64)


def rates_of(dial: DialPolicy, angle: float, count: int, seeds: np.ndarray) -> Row:
    """Return cars that arrive in a minute and shares of endings, with 95 % intervals.

    An episode lasts until its last car has ended.
    """
    policies = [dial.at(dial.low), dial.at(angle)]
    fleet = drive(Intersection(OPTIONS), policies, chosen_cars(seeds, count), seeds)
    minutes = fleet.seconds.max(axis=1) / 60.0
    arrived = (fleet.ending == Ending.ARRIVAL).sum(axis=1)
    rate = arrived.sum() / minutes.sum()
    apart = (arrived - rate * minutes) / minutes.mean()  # of a ratio of means, linearised
    row: Row = {"angle": angle, "count": count, "episodes": len(seeds)}
    row |= normal_mean("per_minute", rate + apart)
    for ending in (Ending.ARRIVAL, Ending.COLLISION, Ending.TIMEOUT):
        row |= normal_mean(ending.name.lower(), (fleet.ending == ending).mean(axis=1))
    return row


def main(out: Path, episodes: int = 500) -> None:
    """Measure the page's dials at every fifteenth degree.

    Args:
        out: The file to write, CSV.
        episodes: Of each fleet, seeds 1 ff.
    """
    seeds, dials = np.arange(1, episodes + 1), [packaged_results() / path for path in DIALS]
    rows = [
        {"dial": number} | rates_of(dial, angle, count, seeds)
        for number, dial in enumerate(map(DialPolicy.load, dials))
        for angle in _ANGLES.tolist()
        for count in COUNTS
    ]
    write_atomically(out, as_csv(rounded(rows)))


if __name__ == "__main__":
    tyro.cli(main)
