"""Effects of the shipped drivers of the intersection, and how often they pass bounds of them.

    python benchmarks/bounds.py [EPISODES [AUDITS]]

All drivers drive the same episodes; audits are drawn from them. It prints the ranges of an episode,
D between settings of the dial of effects, the share of audits that pass the bounds of
docs/audit.md, and the share of wrong passes by drivers whose mean is the limit.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np

from socialiq.audit.evidence.drive import Course
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.profile.fields import QUANTITIES
from socialiq.audit.request import GAPS, shipped_dial
from socialiq.audit.seeds import episode_seeds
from socialiq.evaluation.rollout import MODES
from socialiq.statistics.betting import significantly_below
from socialiq.statistics.intervals import clopper_pearson
from socialiq.worlds.intersection import atlas
from socialiq.worlds.registry import make

SEED, DRAWS = 20_261_126, 100_000  # of the episodes, and of the audits that are drawn from them
ANGLES = tuple(range(0, 91, 15))
ERROR = 0.05
LIMITS = {"delay": 6.0, "braking": 1.0, "gap_below_1_s": 0.25}


def drivers() -> Iterator[Reference]:
    world = make("intersection")
    for name in ("go", "wait", "idm", *GAPS):
        yield Reference(name, world.driver(name))
    for reward, name in (("Eq 4.2", "intersection"), ("effects", "intersection-caused")):
        for driver, _ in shipped_dial(make(name), ANGLES):
            yield Reference(f"{reward} {driver.angle:g}", driver.policy, driver.angle)
    for mode in MODES:
        yield Reference(f"set_{mode}", atlas.load(f"set_{mode}"))


def passes(row: str, values: np.ndarray, limit: float) -> np.ndarray:
    """Whether each audit shows the mean to be at most the limit, as `bound_tests` does."""
    if not QUANTITIES[row].unit:
        highs = (
            clopper_pearson(int(count), values.shape[1], 1.0 - 2.0 * ERROR).high
            for count in values.sum(axis=1)
        )
        return np.array([high <= limit for high in highs])
    low, high = QUANTITIES[row].range
    return significantly_below(values - low, np.array([limit - low]), high - low, ERROR)[:, 0]


def main(episodes: int = 10_000, audits: int = 200) -> None:
    course = Course(
        make("intersection-caused"), episode_seeds(SEED, episodes), measured=tuple(QUANTITIES)
    )
    pool = {driver.name: course.drive(driver) for driver in drivers()}
    for name in QUANTITIES:
        ends = [(row.episodes[name].min(), row.episodes[name].max()) for row in pool.values()]
        print(f"{name}: {min(low for low, _ in ends):.1f} to {max(high for _, high in ends):.1f}")
    for angle in ANGLES:
        policy = pool[f"effects {angle}"]
        for other in ANGLES:
            if 0 < abs(other - angle) <= 30:
                differences = pool[f"effects {other}"].values(other + 90.0)
                differences = differences - policy.values(other + 90.0)
                error = differences.std() / episodes**0.5
                print(f"D of {angle} at {other}: {differences.mean():.2f}, error {error:.2f}")
    for name, driver in pool.items():
        beyond = (np.abs(driver.totals[:, 1]) > 30.0).mean()
        means = ", ".join(f"{row} {driver.episodes[row].mean():.2f}" for row in QUANTITIES)
        print(f"{name}: {means}; r_social beyond 30: {100 * beyond:.1f} %")
        for count in (1_000, 5_000):
            drawn = np.random.default_rng(DRAWS).integers(episodes, size=(audits, count))
            kept, wrong = [], []
            for row, limit in LIMITS.items():
                column = driver.episodes[row]
                kept.append(passes(row, column[drawn], limit))
                wrong.append(passes(row, column[drawn], float(column.mean())).mean())
            shares = [f"{each.mean():.3f}" for each in (*kept, np.all(kept, axis=0))]
            errors = [f"{share:.3f}" for share in wrong]
            print(
                f"  {count} episodes: pass each, and all: {', '.join(shares)}; at the limit: "
                f"{', '.join(errors)}",
                flush=True,
            )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
