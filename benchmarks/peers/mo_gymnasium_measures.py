"""Measures of random fronts by `morl-baselines`, which a unit test compares with ours.

    peers/bin/python benchmarks/peers/mo_gymnasium_measures.py

The environment is that of mo_gymnasium.txt. Weights have length 1, as ours have.
"""

# The library is in the environment of mo_gymnasium.txt alone.
# pyright: reportMissingImports=false

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from morl_baselines.common.performance_indicators import (
    expected_utility,
    hypervolume,
    maximum_utility_loss,
)

OUT = Path(__file__).parents[2] / "tests/unit/evaluation/measures_by_morl_baselines.json"


def main() -> None:
    """Write 20 cases of points, reference point and measures."""
    rng, cases = np.random.default_rng(0), []
    for count in range(1, 21):
        points = rng.normal(size=(count, 2)).round(3)
        front = np.concatenate([points, rng.normal(size=(3, 2)).round(3)])
        reference = rng.uniform(-2.0, 0.0, 2).round(3)
        angles = np.sort(rng.uniform(0.0, 90.0, 7)).round(1)
        weights = [np.array([np.cos(a), np.sin(a)]) for a in np.radians(angles)]
        loss = maximum_utility_loss(list(points), list(front), np.array(weights))
        cases.append(
            {
                "points": points.tolist(),
                "front": front.tolist(),
                "reference": reference.tolist(),
                "angles": angles.tolist(),
                "hypervolume": float(hypervolume(reference, list(points))),
                "expected_utility": float(expected_utility(list(points), weights)),
                "maximum_utility_loss": float(loss),
            }
        )
    OUT.write_text("\n".join(["[" + ",\n".join(json.dumps(one) for one in cases) + "]", ""]))


if __name__ == "__main__":
    main()
