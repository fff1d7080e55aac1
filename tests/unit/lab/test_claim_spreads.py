"""Printed standard deviations are judged by ratios of variances, from numbers alone."""

import numpy as np
import pytest

from socialiq.statistics.intervals import variance_ratio
from socialiq.storage import packaged_results
from socialiq_lab import claim_spreads, claims


def test_the_interval_of_a_ratio_covers_as_often_as_it_says():
    rng = np.random.default_rng(0)
    first = rng.normal(0, 2.0, (2000, 5)).std(axis=1, ddof=1)
    second = rng.normal(0, 1.0, (2000, 9)).std(axis=1, ddof=1)
    ratios = [variance_ratio((a, 4), (b, 8)) for a, b in zip(first, second, strict=True)]
    covered = np.mean([ratio.low <= 4.0 <= ratio.high for ratio in ratios])
    assert covered == pytest.approx(0.95, abs=0.015)


def judged(spread, thesis, over="episodes", episodes=1000):
    """Judge one cell whose spread of ours and number of episodes are given."""
    cell = {"our_value": "{s:table_a_1.egoistic.g_env.mean}", "spread": thesis, "spread_of": over}
    if over == "seeds":
        cell["our_value"] = "{s:table_6_2.calibrated_online_greedy.egoistic.speed.ours}"
    values = {
        "config.pool_episodes": episodes,
        "config.trios": [1, 2],
        "config.seeds": [1, 2],
        "config.evaluation_seeds": 5,
    }
    return claim_spreads.compared(
        {"spreads_of": "a-.*"},
        {"a-1": cell, "b-1": {}, "a-2": {"spread": None}},
        lambda _, path: values.get(path, spread),
    )


def test_a_spread_is_reproduced_refuted_or_too_uncertain_to_say():
    assert judged(2.0, 2.1)["from_numbers"] == "reproduced"
    assert judged(2.0, 4.0)["from_numbers"] == "not"
    assert judged(2.0, 2.1, "seeds")["from_numbers"] == "partly"
    assert judged(2.0, 40.0, "seeds")["from_numbers"] == "not"


def test_both_sides_name_their_degrees_of_freedom():
    row = judged(2.0, 4.0)
    assert "2.00 for 4: 0.25 (" in row["ours"] and "F(999, 99)" in row["ours"]
    assert "F(1998, 99)" in row["matched"]
    row = judged(2.0, 2.0, "seeds")
    assert "F(8, 4)" in row["ours"] and "F(16, 4)" in row["matched"]


def test_every_printed_spread_of_tables_6_2_and_a_1_is_judged_once():
    rows = [row for row in claims.ledger(packaged_results()) if row["id"].startswith("spreads-")]
    assert len(rows) == 9
    assert sum(row["ours"].count(" for ") - 1 for row in rows) == 5 * 7 - 1 + 12  # one is +- 0
    assert all(row["from_numbers"] == row["verdict"] for row in rows)
