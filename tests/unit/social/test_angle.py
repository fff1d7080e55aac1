import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from socialiq.errors import UserError
from socialiq.social.angle import (
    AngleEstimate,
    Arc,
    angle_difference,
    angle_of,
    arcs_of_grid,
    check_angle,
    complement,
    direction_interval,
    estimate_angle,
    exact_weights,
    score,
    weights,
)
from socialiq.statistics import bootstrap
from socialiq.statistics.bootstrap import resample_rows
from socialiq.types import RewardPair

degrees = st.floats(-720, 720)


@pytest.mark.parametrize("angle", [0.0, 45.0, 359.999])
def test_an_angle_in_range_is_returned(angle):
    assert check_angle(angle) == angle


@pytest.mark.parametrize("angle", [-0.001, 360.0, 405.0, math.nan, math.inf, -math.inf])
def test_an_angle_out_of_range_is_refused(angle):
    with pytest.raises(UserError, match=r"outside \[0, 360\)"):
        check_angle(angle)


def test_weights_by_hand():
    assert weights(0.0) == (1.0, 0.0)
    assert weights(30.0) == pytest.approx((0.8660254037844387, 0.5), abs=1e-15)
    assert weights(45.0) == pytest.approx((0.7071067811865476, 0.7071067811865476), abs=1e-15)
    assert weights(225.0) == pytest.approx((-0.7071067811865476, -0.7071067811865476), abs=1e-15)


def test_weights_keep_the_residue_of_the_thesis_at_90_degrees():
    assert weights(90.0) == (6.123233995736766e-17, 1.0)


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(0.0, (1.0, 0.0)), (90.0, (0.0, 1.0)), (180.0, (-1.0, 0.0)), (270.0, (0.0, -1.0))],
)
def test_exact_weights_are_exact_at_right_angles(angle, expected):
    assert exact_weights(angle) == expected


@pytest.mark.parametrize("angle", [1e-9, 30.0, 89.999, 90.001, 123.4])
def test_exact_weights_are_the_weights_elsewhere(angle):
    assert exact_weights(angle) == weights(angle)


@pytest.mark.parametrize(
    ("env", "social", "expected"),
    [
        (1.0, 0.0, 0.0),
        (2.0, 2.0, 45.0),
        (0.0, 3.0, 90.0),
        (-1.0, 0.0, 180.0),
        (0.0, -1.0, -90.0),
        (-math.sqrt(3.0), 1.0, 150.0),
    ],
)
def test_angle_of_by_hand(env, social, expected):
    assert angle_of(env, social) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("social", [-0.0, -1e-300])
def test_angle_of_never_gives_minus_180(social):
    assert angle_of(-1.0, social) == 180.0


@given(st.floats(0, 359.99), st.floats(1e-3, 1e3))
def test_angle_of_undoes_weights_at_any_length(angle, length):
    env, social = weights(angle)
    found = angle_of(length * env, length * social)
    assert -180.0 < found <= 180.0
    assert abs(angle_difference(found, angle)) < 1e-9


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [(10.0, 350.0, 20.0), (350.0, 10.0, -20.0), (-170.0, 170.0, 20.0), (180.0, 0.0, -180.0)],
)
def test_angle_difference_by_hand(a, b, expected):
    assert angle_difference(a, b) == expected


@given(degrees, degrees)
@example(float(np.nextafter(-180.0, -np.inf)), 0.0)
def test_angle_difference_is_wrapped_and_keeps_the_direction(a, b):
    difference = angle_difference(a, b)
    assert -180.0 <= difference < 180.0
    turns = (a - b - difference) / 360.0
    assert turns == pytest.approx(round(turns), abs=1e-9)


# r_env = 2, r_social = -4.
@pytest.mark.parametrize(
    ("angle", "expected"),
    [
        (0.0, 2.0),
        (30.0, -0.2679491924311226),  # 2 * 0.8660254 - 4 * 0.5
        (45.0, -1.4142135623730951),  # (2 - 4) / sqrt 2
        (90.0, -4.0),
        (180.0, -2.0),
        (270.0, 4.0),
    ],
)
def test_equation_4_3_by_hand(angle, expected):
    rewards = RewardPair(env=2.0, social=-4.0)
    assert score(exact_weights(angle), rewards) == pytest.approx(expected, abs=1e-14)


def test_equation_4_3_of_columns():
    rewards = RewardPair(env=np.array([1.0, 0.0, 3.0]), social=np.array([1.0, 2.0, -3.0]))
    root = np.sqrt(0.5)
    np.testing.assert_allclose(score(weights(45.0), rewards), [2 * root, 2 * root, 0.0], atol=1e-15)


def sample(direction: float, episodes: int, spread: float, seed: int) -> np.ndarray:
    """Totals (2, episodes) scattered about the unit vector of a direction in degrees."""
    rng = np.random.default_rng(seed)
    mean = np.array([np.cos(np.deg2rad(direction)), np.sin(np.deg2rad(direction))])
    return mean[:, None] + spread * rng.standard_normal((2, episodes))


def test_it_is_the_angle_of_the_means_not_the_mean_of_angles():
    found = estimate_angle(np.array([10.0, 0.0]), np.array([0.0, 1.0]), seed=0)
    assert (found.env, found.social) == (5.0, 0.5)
    assert found.angle == pytest.approx(5.710593137499643)  # atan(0.1); the mean would be 45


def test_one_episode_has_no_spread():
    found = estimate_angle(np.array([-1.0]), np.array([1.0]), seed=3)
    assert found == AngleEstimate(135.0, 135.0, 135.0, -1.0, 1.0)


def test_the_seed_decides_the_interval():
    totals = sample(60.0, 30, 1.0, seed=1)
    first, again, other = (estimate_angle(*totals, seed=seed) for seed in (5, 5, 6))
    assert first == again
    assert first.angle == other.angle
    assert (first.low, first.high) != (other.low, other.high)


@pytest.mark.parametrize(
    ("confidence", "low", "high"), [(0.9, 0.0, 90.0), (0.6, 0.0, 90.0), (0.4, 45.0, 45.0)]
)
def test_the_interval_of_two_episodes_by_hand(confidence, low, high):
    # Four equally likely resamples: both (1, 0), one of each (twice), both (0, 1). A quarter of
    # the angles are 0, half 45 and a quarter 90.
    found = estimate_angle(
        np.array([1.0, 0.0]), np.array([0.0, 1.0]), seed=0, confidence=confidence, resamples=1000
    )
    assert found[:3] == pytest.approx((45.0, low, high))


def test_the_pair_stays_together_in_a_resample():
    env = np.array([1.0, 2.0, 30.0])
    found = estimate_angle(env, 2.0 * env, seed=0)
    assert found.low == pytest.approx(found.angle, abs=1e-9)
    assert found.high == pytest.approx(found.angle, abs=1e-9)


@pytest.mark.parametrize("direction", [180.0, 179.0, -179.0])
def test_the_interval_wraps_at_180_degrees(direction):
    found = estimate_angle(*sample(direction, 200, 0.5, seed=2), seed=0)
    assert abs(angle_difference(found.angle, direction)) < 10.0
    assert found.angle - 10.0 < found.low < found.angle < found.high < found.angle + 10.0
    assert found.low < 180.0 < found.high or found.low < -180.0 < found.high


@pytest.mark.parametrize("quarter_turns", [1, 2, 3])
def test_turning_the_totals_turns_the_estimate(quarter_turns):
    env, social = sample(20.0, 25, 0.7, seed=4)
    found = estimate_angle(env, social, seed=9)
    for _ in range(quarter_turns):
        env, social = -social, env
    turned = estimate_angle(env, social, seed=9)
    assert angle_difference(turned.angle, found.angle + 90.0 * quarter_turns) == pytest.approx(
        0.0, abs=1e-9
    )
    assert turned.low - turned.angle == pytest.approx(found.low - found.angle, abs=1e-9)
    assert turned.high - turned.angle == pytest.approx(found.high - found.angle, abs=1e-9)


def test_higher_confidence_gives_a_wider_interval():
    totals = sample(60.0, 30, 1.0, seed=1)
    narrow, wide = (estimate_angle(*totals, seed=5, confidence=c) for c in (0.5, 0.99))
    assert wide.low < narrow.low < narrow.high < wide.high


@pytest.mark.parametrize("direction", [30.0, 180.0])
def test_a_95_percent_interval_covers_the_truth(direction):
    # 400 studies of 40 episodes. The binomial standard error is 1.1 %, and a percentile
    # bootstrap of 40 covers a little less than it says: 90 % to 98 % is allowed.
    covered = 0
    for study in range(400):
        found = estimate_angle(*sample(direction, 40, 1.0, seed=study), seed=study, resamples=400)
        truth = found.angle + angle_difference(direction, found.angle)
        covered += found.low <= truth <= found.high
    assert 0.90 <= covered / 400 <= 0.98


@pytest.mark.parametrize(
    ("env", "social"),
    [([], []), ([1.0, np.nan], [0.0, 0.0]), ([1.0, 0.0], [np.inf, 0.0])],
)
def test_nothing_and_not_finite_are_refused(env, social):
    with pytest.raises(UserError, match="at least one episode, and finite reward totals"):
        estimate_angle(np.array(env), np.array(social), seed=0)


# A resample for each block, uneven blocks, and all at once.
@pytest.mark.parametrize("block", [1, 100, 10**9])
@pytest.mark.parametrize("episodes", [1, 2, 13, 64, 97])
def test_resamples_do_not_depend_on_where_the_blocks_are_cut(block, episodes, monkeypatch):
    monkeypatch.setattr(bootstrap, "_BLOCK", block)
    whole = np.random.default_rng(3).integers(episodes, size=(29, episodes))
    np.testing.assert_array_equal(np.concatenate(list(resample_rows(episodes, 29, 3))), whole)
    totals = sample(50.0, episodes, 0.3, seed=episodes)
    found = estimate_angle(*totals, seed=3, resamples=29)
    means = totals.T[whole].mean(axis=1)
    deviations = np.degrees(np.arctan2(means[:, 1], means[:, 0])) - found.angle
    wrapped = (deviations + 180.0) % 360.0 - 180.0
    low, high = found.angle + np.quantile(wrapped, [(1 - 0.95) / 2, (1 + 0.95) / 2])
    assert (found.low, found.high) == (low, high)  # to the last bit


def test_many_episodes_are_resampled_in_little_memory():
    totals = sample(50.0, 10_000, 1.0, seed=0)
    tracemalloc.start()
    estimate_angle(*totals, seed=0, resamples=300)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6


def test_the_region_seen_from_the_origin():
    """A circle of radius r around (d, 0) is seen under ± asin(r / d)."""
    rows = np.array([[3.0, 1.0], [3.0, -1.0], [4.0, 0.0], [2.0, 0.0]])
    # n = 4, S = 2/3 I, F(0.95; 2, 2) = 19: r² = 2/3 · 2·3/2 · 19 / 4
    radius = np.sqrt(2 / 3 * 3 * 19 / 4)
    assert direction_interval(rows, 0.95) is None  # 3.08 > 3
    rows[:, 0] += 4.0
    low, high = direction_interval(rows, 0.95)
    expected = np.degrees(np.arcsin(radius / 7.0))
    assert (low, high) == pytest.approx((-expected, expected), abs=1e-3)


def test_no_spread_is_one_direction_and_zero_is_none():
    assert direction_interval(np.tile([1.0, 1.0], (3, 1)), 0.95) == pytest.approx((45.0, 45.0))
    assert direction_interval(np.zeros((5, 2)), 0.95) is None


def test_the_ends_go_beyond_half_a_turn():
    rows = np.array([[-50.0, 1.0], [-50.0, -1.0], [-51.0, 0.3], [-49.0, 0.0]])
    low, high = direction_interval(rows, 0.9)
    assert low < 180.0 < high and high - low < 20.0


def test_it_covers_the_truth_as_often_as_promised():
    rng = np.random.default_rng(3)
    hits, angle = 0, np.degrees(np.arctan2(0.5, 2.0))
    for _ in range(400):
        found = direction_interval(rng.normal([2.0, 0.5], [1.0, 0.5], (6, 2)), 0.9)
        hits += found is None or found[0] <= angle <= found[1]
    assert hits / 400 > 0.9  # of the directions at least as often as of the vector


def apart(one, other):
    return abs((one - other + 180) % 360 - 180)


@pytest.mark.parametrize(
    ("centres", "halves", "arcs"),
    [
        ([], [], [(0, 360)]),
        ([0.0], [60.0], [(60, 300)]),
        ([180.0], [60.0], [(240, 480)]),
        ([0.0, 90.0], [60.0, 60.0], [(150, 300)]),
        ([0.0, 180.0], [60.0, 60.0], [(60, 120), (240, 300)]),
        ([0.0, 120.0, 240.0], [70.0, 70.0, 70.0], []),
        ([10.0, 10.0], [30.0, 5.0], [(40, 340)]),
        ([0.0], [0.0], [(0, 360)]),
    ],
)
def test_what_open_arcs_leave_by_hand(centres, halves, arcs):
    assert complement(centres, halves) == tuple(Arc(*map(float, arc)) for arc in arcs)


@given(
    st.lists(st.tuples(st.integers(0, 359), st.integers(1, 170)), max_size=6),
    st.integers(0, 359),
)
def test_an_angle_is_left_or_ruled_out(spans, angle):
    centres, halves = ([float(one[side]) for one in spans] for side in (0, 1))
    left = any(arc.holds(float(angle)) for arc in complement(centres, halves))
    ruled_out = [apart(angle, one) < half for one, half in zip(centres, halves, strict=True)]
    assert left != any(ruled_out)


@given(st.lists(st.booleans(), min_size=12, max_size=12))
def test_runs_hold_what_is_inside(inside):
    arcs = arcs_of_grid(np.array(inside), 30.0)
    for number, one in enumerate(inside):
        assert any(arc.holds(30.0 * number) for arc in arcs) == one
    assert all(0 <= arc.low < 360 for arc in arcs)
