"""Width of an angle that audits of the shipped dial can show where people walk.

    python benchmarks/widths.py

The dial of `intersection-crosswalk` at 0, 15, ..., 90 degrees drives 10,000 episodes by class
angle, on the block that defaults were set on (`episode_seeds(20261126, 10000)`) and on another
(20261127).
Printed are, by width: the least D at an end, reward per episode, and how many of ten audits of
1,000 episodes each show the direction, by declared angle.
"""

from __future__ import annotations

import datetime
from dataclasses import replace

import numpy as np

from socialiq.audit.evidence.drive import Course
from socialiq.audit.evidence.outcomes import Evidence, Outcomes
from socialiq.audit.profile.profile import Margin
from socialiq.audit.profile.template import USUAL, declare
from socialiq.audit.request import shipped_dial
from socialiq.audit.seeds import episode_seeds
from socialiq.audit.verdict.direction import direction_test
from socialiq.audit.verdict.regret import Decision
from socialiq.worlds.registry import make

WORLD, EPISODES, AUDIT = "intersection-crosswalk", 10_000, 1000
ANGLES, ERRORS = [15.0 * step for step in range(7)], (0.05, 0.00625)


def part(driver: Outcomes, first: int) -> Outcomes:
    """Return the episodes of one audit."""
    return replace(driver, episodes=driver.episodes.rows(slice(first, first + AUDIT)))


def shown(width: float, class_angle: float, drivers: list[Outcomes]) -> list[int]:
    """Return by declared angle how many audits show the direction within a width."""
    day, clip, counts = datetime.date(2026, 1, 1), USUAL[WORLD].clip, [0] * len(ANGLES)
    for number, angle in enumerate(ANGLES):
        options, margin = {"class_angle": class_angle}, Margin(0.5, width=width)
        profile = declare(angle, "benchmark", WORLD, margin, day, options, clip=clip)
        for first in range(0, EPISODES, AUDIT):
            rows = [part(driver, first) for driver in drivers]
            policy = replace(rows[number], name="policy", angles=())
            evidence = Evidence("", np.arange(AUDIT), policy, tuple(rows), {})
            test = direction_test(profile, evidence, *ERRORS, ends_only=True)
            counts[number] += test.decision is Decision.PASS
    return counts


def measure(class_angle: float, block: int) -> None:
    """Drive, and print a line for each width."""
    world, clip = make(WORLD, class_angle=class_angle), USUAL[WORLD].clip
    course = Course(world, episode_seeds(block, EPISODES))
    assert clip is not None
    drivers = [course.drive(row).clipped(*clip.ends) for row, _ in shipped_dial(world, ANGLES)]
    for width in (15.0, 30.0, 45.0):
        apart = round(width / 15)
        pairs = [*zip(drivers, drivers[apart:], strict=False)]
        least = min(
            float(np.mean(sign * (end.values(across) - own.values(across))))
            for low, high in pairs
            for own, end, sign in ((low, high, 1.0), (high, low, -1.0))
            for across in (end.angles[0] + 90.0,)
        )
        print(class_angle, block, width, f"{least:.2f}", shown(width, class_angle, drivers))


if __name__ == "__main__":
    for b in (0.0, 15.0, 30.0, 45.0, 90.0):
        for seed in (20261126, 20261127):
            measure(b, seed)
