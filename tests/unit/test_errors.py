import math

import pytest

from socialiq.errors import UserError, one_of


def test_a_name_among_the_known_ones_is_accepted():
    one_of("world", "crossing5", ("crossing5", "crossing7"))


@pytest.mark.parametrize("value", ["crossing6", math.nan, ["crossing5"], None])
def test_other_values_of_a_file_are_refused_in_one_line(value):
    with pytest.raises(UserError, match=r"unknown world '.*': choose one of crossing5, crossing7"):
        one_of("world", value, ("crossing5", "crossing7"))


def test_a_long_name_is_cut():
    with pytest.raises(UserError) as caught:
        one_of("world", "x" * 5000, ("crossing5",))
    assert len(str(caught.value)) < 150
