"""Bounds by betting, against exact probabilities and what any valid bound must keep."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom

from socialiq.statistics.betting import (
    bounds_by_betting,
    episodes_by_betting,
    leading,
    levels,
    lower_bound_of_largest,
    significantly_below,
)

ERROR = 0.05


def exact_rejections(mean: float, low: float, limit: float, episodes: int) -> float:
    """Probability that "the mean is below `mean`" is said wrongly, by all 2^n sequences."""
    share = (mean - low) / (limit - low)
    kinds = np.array(list(itertools.product([False, True], repeat=episodes)))
    values = np.where(kinds, limit, low)
    said = significantly_below(values, np.array([mean]), limit, ERROR)[:, 0]
    count = kinds.sum(axis=1)
    return float((said * share**count * (1.0 - share) ** (episodes - count)).sum())


@pytest.mark.parametrize("low", [-1.0, 0.0, 0.9])
@pytest.mark.parametrize("place", [0.05, 0.3, 0.6, 0.95])
def test_two_values_are_bounded_exactly(low, place):
    """The worst distributions have two values; 12 episodes can be enumerated."""
    limit = 1.0
    assert exact_rejections(low + place * (limit - low), low, limit, 12) <= ERROR


def test_it_says_something():
    """All values at 0 and a limit of 1: n must exceed that of the binomial bound, by little."""
    mean = np.array([0.1])
    exact = math.ceil(math.log(ERROR) / math.log(1.0 - 0.1))  # 29 episodes without an event
    for episodes, said in ((exact - 1, False), (36, True)):
        found = significantly_below(np.zeros((1, episodes)), mean, 1.0, ERROR)
        assert found.tolist() == [[said]]


@pytest.mark.parametrize("share", [0.002, 0.01, 0.2])
def test_a_rare_value_is_missed_in_at_most_5_percent(share):
    """The mean is the level; 4,000 samples of 200 (seed 0)."""
    values = (np.random.default_rng(0).random((4000, 200)) < share).astype(float)
    said = significantly_below(values, np.array([share]), 1.0, ERROR).mean()
    assert said <= binom.ppf(0.999, 4000, ERROR) / 4000


@pytest.mark.parametrize("kind", ["lognormal", "pareto", "normal"])
def test_heavy_tails_cut_at_the_limit(kind):
    rng = np.random.default_rng(1)
    size = (2000, 300)
    drawn = {
        "lognormal": lambda: rng.lognormal(0.0, 2.0, size),
        "pareto": lambda: 1.0 + rng.pareto(1.5, size),
        "normal": lambda: rng.normal(0.0, 1.0, size),
    }[kind]().clip(None, 60.0)
    found = bounds_by_betting(drawn, levels(1.0, 60.0), 60.0, ERROR)
    assert (found < drawn.mean()).mean() <= binom.ppf(0.999, 2000, ERROR) / 2000


def test_only_the_upper_limit_is_needed():
    """Gains of 100 in 1 % of episodes: the bound holds though no lower limit is known."""
    rng = np.random.default_rng(2)
    usual = rng.normal(size=(2000, 300)).clip(None, 5.0)
    heavy = np.where(rng.random(usual.shape) < 0.01, -100.0, usual)
    found = bounds_by_betting(heavy, levels(1.0, 5.0), 5.0, ERROR)
    assert (found < heavy.mean()).mean() <= binom.ppf(0.999, 2000, ERROR) / 2000
    assert np.median(found) < 0.3


@pytest.fixture(scope="module")
def normal():
    return np.random.default_rng(3).normal(0.0, 1.0, (50, 600)).clip(-10.0, 10.0)


def test_the_price_against_students_bound(normal):
    """With the limit at 10 σ the excess over the mean is at most twice that of a known σ."""
    found = bounds_by_betting(normal, levels(0.5, 10.0), 10.0, ERROR) - normal.mean(axis=1)
    assert 1.0 < np.median(found) * math.sqrt(600) / 1.645 < 2.0


def test_more_error_and_a_smaller_limit_are_tighter(normal):
    def median(limit, error):
        return np.median(bounds_by_betting(normal, levels(0.5, limit), limit, error))

    assert median(10.0, 0.2) < median(10.0, 0.05) < median(10.0, 0.001)
    assert median(10.0, 0.05) < median(40.0, 0.05) < median(160.0, 0.05)


def test_a_value_above_the_limit_leaves_no_bound():
    values = np.zeros((2, 100))
    values[1, 3] = 1.1
    found = bounds_by_betting(values, levels(0.5, 1.0), 1.0, ERROR)
    assert found[0] < 0.5 and np.isposinf(found[1])
    assert lower_bound_of_largest(-values[1:], levels(0.5, 1.0), 1.0, ERROR) == -np.inf


@settings(max_examples=50)
@given(
    values=st.lists(st.floats(-2.0, 1.0), min_size=1, max_size=40),
    margin=st.floats(0.01, 0.9),
)
def test_a_bound_lies_between_the_smallest_value_and_the_limit(values, margin):
    """The wealth can't grow at a level that no value is below."""
    (found,) = bounds_by_betting(np.array([values]), levels(margin, 1.0), 1.0, ERROR)
    assert min(values) <= found <= 1.0


@settings(max_examples=50)
@given(values=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=40), unit=st.floats(0.01, 100.0))
def test_units_do_not_matter(values, unit):
    rows, mean = np.array([values]), np.array([0.1, 0.5])
    usual = significantly_below(rows, mean, 1.0, 0.3)
    # A power of two changes no digit.
    unit = 2.0 ** round(math.log2(unit))
    assert (significantly_below(rows * unit, mean * unit, unit, 0.3) == usual).all()


@pytest.mark.parametrize("limit", [1.5, 283.6, 1e6])
def test_the_levels_surround_the_margin(limit):
    on, between = levels(1.0, limit), levels(1.0, limit, between=True)
    for found in (on, between):
        assert (np.diff(found) > 0).all() and -limit < found[0] and found[-1] < limit
        assert found[0] < -0.8 * limit and found[-1] > 0.8 * limit
        assert len(found) < 500
    assert (on == 1.0).sum() == 1
    above, below = between[between > 1.0][0], between[between < 1.0][-1]
    assert above - 1.0 == pytest.approx(1.0 - below) and above < 1.003


def test_the_leader_is_that_of_the_earlier_episodes():
    values = np.array([[0.0, 1.0, 0.0, 0.0], [0.5, 0.0, 9.0, 0.0]])
    # Sums before each: none; 0 and 0.5; 1 and 0.5; 1 and 9.5.
    assert leading(values).tolist() == [0, 1, 0, 1]


def test_the_lower_bound_of_the_largest_mean_holds_for_any_number_of_series():
    """Twelve equal series: the largest mean is 0, and no correction is needed (seed 4)."""
    rng = np.random.default_rng(4)
    grid = levels(0.5, 10.0, between=True)
    wrong = 0
    for _ in range(400):
        values = rng.normal(0.0, 1.0, (12, 150)).clip(-10.0, 10.0)
        wrong += lower_bound_of_largest(values, grid, 10.0, ERROR) > 0.0
    assert wrong <= binom.ppf(0.999, 400, ERROR)


def test_the_lower_bound_finds_the_largest():
    rng = np.random.default_rng(5)
    values = rng.normal(size=(5, 1500)).clip(-10.0, 10.0)
    values[3] += 2.0
    found = lower_bound_of_largest(values, levels(0.5, 12.0, between=True), 12.0, ERROR)
    assert 1.7 < found < 2.0


def test_the_number_needed_decides_in_nine_of_ten():
    rng = np.random.default_rng(6)
    needed = episodes_by_betting(rng.normal(0.0, 1.5, 20_000), 0.25, 50.0, ERROR, 0.9)
    assert needed is not None
    for share, low, high in ((1.0, 0.8, 0.98), (0.5, 0.0, 0.2)):
        drawn = rng.normal(0.0, 1.5, (300, int(share * needed)))
        said = significantly_below(drawn, np.array([0.25]), 50.0, ERROR).mean()
        assert low <= said <= high


def test_no_number_is_enough_on_the_limit_or_beyond():
    assert episodes_by_betting(np.full(30, 1.0), 1.0, 5.0, ERROR, 0.9) is None
    assert episodes_by_betting(np.full(30, 2.0), 1.0, 5.0, ERROR, 0.9) is None
    assert episodes_by_betting(np.array([0.0, 7.0]), 1.0, 5.0, ERROR, 0.9) is None
