import pytest

from socialiq.errors import UserError
from socialiq.evaluation.statistics import wilson


def test_wilson_by_hand():
    share = wilson(10, 100)
    z2, n, p = 1.959963984540054**2, 100, 0.1
    centre = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = (z2 * (p * (1 - p) / n + z2 / (4 * n * n))) ** 0.5 / (1 + z2 / n)
    assert share.value == 0.1
    assert share.low == pytest.approx(centre - half)
    assert share.high == pytest.approx(centre + half)


def test_nothing_counted_still_has_an_upper_end():
    share = wilson(0, 50)
    assert share.value == share.low == 0
    assert 0.05 < share.high < 0.09


def test_no_trial_is_refused():
    with pytest.raises(UserError, match="at least one trial"):
        wilson(0, 0)
