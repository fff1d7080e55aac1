"""Worth of knowing the future under each shift: the shipped dial, and its lookahead.

    python benchmarks/true_future.py

At each decision `OracleLookahead` takes every action in a copy of the simulator, which draws the
same random numbers as the episode will, lets the dial drive on there, and chooses the best end.
"""

import numpy as np

from socialiq.cli.output import print_table
from socialiq.evaluation.branching import OracleLookahead
from socialiq.evaluation.episodes import episodes_of
from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import packaged_results
from socialiq.worlds.highway.perception import KNOWN
from socialiq.worlds.highway.shifts import SHIFTS
from socialiq.worlds.intersection.world import Intersection

FIRST_SEED, EPISODES, ANGLES = 350_000_000, 500, (0.0, 45.0)
DIAL = "intersection-dial-clock/iterated.safetensors"


def main() -> None:
    """Print the shares of collisions and arrivals of both, behind the front end that is known."""
    dial = DialPolicy.load(packaged_results() / DIAL)
    seeds, rows = np.arange(FIRST_SEED, FIRST_SEED + EPISODES), []
    for shift in SHIFTS:
        for angle in ANGLES:
            row = {"shift": shift, "angle": angle}
            for name in ("dial", "future"):
                batch, policy = Intersection().shifted(shift, KNOWN).batch(250), dial.at(angle)
                if name == "future":
                    policy = OracleLookahead(policy, batch, angle)
                metrics = episodes_of(batch, policy, seeds).metrics()
                row |= {f"{name}_collision": metrics.collision, f"{name}_arrival": metrics.arrival}
                row |= {f"{name}_J": metrics.value(angle)}
            rows.append(row)
    print_table(rows, f"{EPISODES} episodes from seed {FIRST_SEED}")


if __name__ == "__main__":
    main()
