"""Shares of the error."""

from fractions import Fraction

import pytest

from socialiq.audit.looks.look import SMALLEST_ERROR, check_spendable, spend
from socialiq.errors import UserError


def test_the_shares_by_hand():
    assert [spend(0.05, look).error for look in (1, 2, 3)] == [0.05 / 2, 0.05 / 6, 0.05 / 12]
    assert spend(0.05, 4).look == 4


@pytest.mark.parametrize("looks", [1, 2, 20, 10_000])
def test_no_number_of_looks_spends_more_than_the_whole(looks):
    """1/2 + 1/6 + ... + 1/(K (K + 1)) = 1 - 1/(K + 1)."""
    shares = sum(Fraction(1, look * (look + 1)) for look in range(1, looks + 1))
    assert shares == 1 - Fraction(1, looks + 1)
    spent = sum(spend(0.05, look).error for look in range(1, looks + 1))
    assert spent == pytest.approx(0.05 * float(shares), rel=1e-12) and spent < 0.05


def test_a_share_that_resamples_would_not_resolve_is_refused():
    check_spendable(spend(0.05, 21))
    assert spend(0.05, 22).error < SMALLEST_ERROR
    with pytest.raises(UserError, match=r"look 22 .* agree with the auditor on a new log"):
        check_spendable(spend(0.05, 22))
