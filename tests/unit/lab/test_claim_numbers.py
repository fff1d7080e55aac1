import math

import pytest

from socialiq.errors import UserError
from socialiq_lab.claims import Ours, Printed, printed, tolerance, verdict


def of(thesis, value, statement="", **more):
    return {"id": "one", "thesis": thesis, "value": value, "statement": statement} | more


def test_digits_are_read_off_the_printed_number():
    assert printed(of("+8.17 +- 3.45", 8.17, spread=3.45, spread_of="episodes")).digit == 0.01
    assert printed(of("12,096", 12096.0, tolerance=0.5)).digit == 1
    assert printed(of("3e-4", 3e-4, tolerance=5e-5)).digit == pytest.approx(1e-4)
    assert printed(of("never (0 % arrival)", 0.0, tolerance=0.005)).digit == 1
    assert printed(of("nearly 100 %", 1.0, tolerance=0.05)).digit == pytest.approx(0.01)


def test_a_tolerance_is_half_a_digit_or_one_after_about():
    printed(of("152 deg", 152.0, "an angle of about 152 degrees", tolerance=1.0))
    for wide in (of("152 deg", 152.0, tolerance=1.0), of("0.3", 0.3, tolerance=0.06)):
        with pytest.raises(UserError, match="half a unit of its last digit"):
            printed(wide)
    with pytest.raises(UserError, match="spread_of"):
        printed(of("1 +- 2", 1.0, spread=2.0, spread_of="wheels"))


def test_means_are_compared_by_standard_errors():
    thesis = Printed(10.0, 0.1, spread=5.0, over="episodes")
    assert tolerance(thesis, Ours(10.0, 4.0, 1600)) == pytest.approx(0.05 + 2 * 0.1)
    seeds = Printed(10.0, 0.1, spread=3.0, over="seeds")
    both = math.hypot(3.0 / math.sqrt(5), 0.1)
    assert tolerance(seeds, Ours(10.0, 4.0, 1600)) == pytest.approx(0.05 + 2 * both)


@pytest.mark.parametrize(
    ("value", "count", "found"),
    [
        (10.2, 1600, "reproduced"),
        (10.5, 1600, "partly"),  # a tenth of the spread: negligible, but another mean
        (12.0, 1600, "not"),  # well within the spread of single episodes
        (12.0, 2, "partly"),  # ours is known to 5.7 only, which decides nothing
        (30.0, 2, "not"),
    ],
)
def test_verdicts_of_a_mean_with_a_spread_of_episodes(value, count, found):
    thesis = Printed(10.0, 0.1, spread=5.0, over="episodes")
    assert verdict(thesis, Ours(value, 4.0, count)) == found
