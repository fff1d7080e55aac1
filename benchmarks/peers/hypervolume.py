"""Hypervolumes of random fronts by `morl-baselines`, which a unit test compares with ours.

    peers/bin/python benchmarks/peers/hypervolume.py

The environment is that of morl.txt.
"""

# The library is in the environment of morl.txt alone.
# pyright: reportMissingImports=false

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from morl_baselines.common.performance_indicators import hypervolume

OUT = Path(__file__).parents[2] / "tests/unit/evaluation/hypervolumes_by_morl_baselines.json"


def main() -> None:
    """Write 20 cases of points, reference point and hypervolume."""
    rng, cases = np.random.default_rng(0), []
    for count in range(1, 21):
        points = rng.normal(size=(count, 2)).round(3)
        reference = rng.uniform(-2.0, 0.0, 2).round(3)
        area = float(hypervolume(reference, list(points)))
        cases.append(
            {"points": points.tolist(), "reference": reference.tolist(), "hypervolume": area}
        )
    OUT.write_text("\n".join(["[" + ",\n".join(json.dumps(case) for case in cases) + "]", ""]))


if __name__ == "__main__":
    main()
