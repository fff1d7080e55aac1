"""Shares of the error."""

from fractions import Fraction

import pytest

from socialiq.audit.look import spend


def test_the_shares_by_hand():
    assert [spend(0.05, look) for look in (1, 2, 3)] == [0.05 / 2, 0.05 / 6, 0.05 / 12]


@pytest.mark.parametrize("looks", [1, 2, 20, 10_000])
def test_no_number_of_looks_spends_more_than_the_whole(looks):
    """1/2 + 1/6 + ... + 1/(K (K + 1)) = 1 - 1/(K + 1)."""
    shares = sum(Fraction(1, look * (look + 1)) for look in range(1, looks + 1))
    assert shares == 1 - Fraction(1, looks + 1)
    spent = sum(spend(0.05, look) for look in range(1, looks + 1))
    assert spent == pytest.approx(0.05 * float(shares), rel=1e-12) and spent < 0.05
