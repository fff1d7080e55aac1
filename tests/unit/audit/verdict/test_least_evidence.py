"""The least evidence against a recorded driver, by counting."""

import math

import pytest

from socialiq.audit.verdict.least_evidence import least_units


def test_units_that_are_all_beyond_are_counted_by_hand():
    """One of 2^n patterns is all beyond: 2^-n <= .0125 from n = 7 on."""
    assert least_units(0.025, share=1.0) == 7


@pytest.mark.parametrize("error", [0.1, 0.025])
def test_the_number_has_its_power_and_its_error(error):
    units = least_units(error)

    def chance(share, critical, count):
        return sum(
            math.comb(count, k) * share**k * (1 - share) ** (count - k)
            for k in range(critical, count + 1)
        )

    for count, enough in ((units, True), (units - 1, False)):
        critical = next(c for c in range(count + 2) if chance(0.5, c, count) <= error / 2)
        assert (chance(0.9, critical, count) >= 0.9) == enough
