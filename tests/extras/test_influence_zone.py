"""The zone that is learned from branches, by scikit-learn."""

import numpy as np
import pytest

pytest.importorskip("sklearn", reason="extra `boosting` is not installed")

from tests.unit.studies.test_influence_zone import planted_zone

from socialiq import tabulate
from socialiq.worlds.registry import make_grid
from studies.influence_zone import moved
from studies.influence_zone.study import leaf_rows, learned_zone


@pytest.mark.parametrize("options", [{}, {"conflict": "end_cell"}], ids=str)
def test_a_planted_zone_is_found_exactly(options: dict[str, str]) -> None:
    """A small tree of one half of the states is the rule in the other half."""
    features, is_moved = moved.grid_vehicles(tabulate(make_grid("crossing7", **options)))
    planted = planted_zone(features, options)
    train = np.random.default_rng(0).random(len(features)) < 0.5
    row, tree = learned_zone(features, is_moved * 1.0, planted, train, 0.5)
    for zone in ("hand", "tree"):
        assert row[f"recall_{zone}"] == row[f"precision_{zone}"] == 1.0, zone
    assert leaf_rows(tree, moved.GRID_FEATURES)[0]["moved"] == 1.0
