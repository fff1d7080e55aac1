"""Operations on rows that studies share."""

import numpy as np
import pytest

from socialiq.statistics.comparisons import holm, paired_difference
from socialiq_lab.tables import (
    groups,
    matching,
    mean,
    nested,
    paired_differences,
    spread,
)

FIRST = [{"a": 1.0, "b": 2.0}, {"a": 2.0, "b": 2.5}, {"a": 4.0, "b": 2.0}]
SECOND = [{"a": 0.0, "b": 1.0}, {"a": 1.5, "b": 2.0}, {"a": 2.0, "b": 3.0}]


def test_differences_are_paired_and_adjusted_over_all_columns():
    rows = paired_differences(FIRST, SECOND, "a", "b", label="measure")
    assert [row["measure"] for row in rows] == ["a", "b"]
    assert rows[0]["mean"] == pytest.approx((1.0 + 0.5 + 2.0) / 3)
    expected = holm(
        [paired_difference([r[c] for r in FIRST], [r[c] for r in SECOND]).p for c in "ab"]
    )
    np.testing.assert_allclose([row["p_holm"] for row in rows], expected)


def test_one_seed_gives_no_difference():
    assert paired_differences(FIRST[:1], SECOND[:1], "a") == []


def test_rows_are_chosen_and_grouped_by_value():
    rows = [
        {"a": 1, "b": "x", "v": 2.0},
        {"a": 2, "b": "x", "v": 3.0},
        {"a": 1, "b": "y", "v": 5.0},
    ]
    assert matching(rows, a=1) == [rows[0], rows[2]]
    assert matching(rows, a=1, b="y") == [rows[2]]
    assert groups(rows, "b") == {("x",): rows[:2], ("y",): rows[2:]}
    assert mean(rows, "v") == pytest.approx(10 / 3)
    assert spread(rows, "v") == {"mean": pytest.approx(10 / 3), "low": 2.0, "high": 5.0}
    assert nested(rows, "a", "b") == {
        "1": {"x": {"v": 2.0}, "y": {"v": 5.0}},
        "2": {"x": {"v": 3.0}},
    }
