"""README's picture: one network at the intersection, turned from 0 to 90 degrees.

It is drawn from the committed table `results/intersection-dial-clock/policies.csv` alone:

    python docs/pictures/front.py [FILE.png]
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

ROOT = Path(__file__).parents[2]
LABELLED = {
    0: (10, -4),
    15: (10, 0),
    30: (10, 4),
    45: (10, 6),
    60: (9, 8),
    75: (0, 11),
    90: (-6, 13),
}
"""Angles that get a label, and its offset in points."""

MEANING = {0: " for itself", 90: " for the others"}


def points() -> dict[float, np.ndarray]:
    """Mean totals of both rewards by angle, a row for each training seed."""
    with (ROOT / "results" / "intersection-dial-clock" / "policies.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["family"] == "iterated"]
    return {
        angle: np.array(
            [
                [float(row["r_env"]), float(row["r_social"])]
                for row in rows
                if float(row["asked"]) == angle
            ]
        )
        for angle in sorted({float(row["asked"]) for row in rows})
    }


def draw() -> Figure:
    """Draw the mean of the seeds with its angles, and each seed as a small dot."""
    found = points()
    drawn = Figure(figsize=(7.2, 4.4), dpi=110, layout="constrained")
    axes = drawn.add_subplot()
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#eeeeee")
    every = np.concatenate(list(found.values()))
    axes.plot(*every.T, "o", color="#9db9d9", markersize=3, label="each of five trainings")
    means = {angle: seeds.mean(axis=0) for angle, seeds in found.items()}
    axes.plot(*np.array(list(means.values())).T, color="#1f5fa8", linewidth=2, label="their mean")
    for angle, offset in LABELLED.items():
        axes.plot(*means[angle], "o", color="#1f5fa8", markersize=8)
        axes.annotate(
            f"{angle}°{MEANING.get(angle, '')}",
            means[angle],
            offset,
            textcoords="offset points",
            fontsize=12,
            fontweight="bold",
            ha="center" if offset[0] == 0 else "left",
            va="center",
        )
    axes.set_xlabel("own progress: mean total reward of an episode  →")
    axes.set_ylabel("effect on others: mean total reward  →")
    axes.set_xlim(-0.9, 11.3)
    axes.set_ylim(-0.35, 2.95)
    axes.legend(frameon=False, loc="lower left")
    axes.set_title("Asked for larger angles, one network gives up progress for others", loc="left")
    return drawn


if __name__ == "__main__":
    target = sys.argv[1] if len(sys.argv) > 1 else ROOT / "docs" / "pictures" / "front.png"
    draw().savefig(target, metadata={"Software": None})
