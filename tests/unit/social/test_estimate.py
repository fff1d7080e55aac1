import tracemalloc

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.social import estimate
from socialiq.social.angle import angle_difference
from socialiq.social.estimate import AngleEstimate, estimate_angle, resampled


def sample(direction: float, episodes: int, spread: float, seed: int) -> np.ndarray:
    """Totals (2, episodes) scattered about the unit vector of a direction in degrees."""
    rng = np.random.default_rng(seed)
    mean = np.array([np.cos(np.deg2rad(direction)), np.sin(np.deg2rad(direction))])
    return mean[:, None] + spread * rng.standard_normal((2, episodes))


def test_it_is_the_angle_of_the_means_not_the_mean_of_angles() -> None:
    found = estimate_angle(np.array([10.0, 0.0]), np.array([0.0, 1.0]), seed=0)
    assert (found.env, found.social) == (5.0, 0.5)
    assert found.angle == pytest.approx(5.710593137499643)  # atan(0.1); the mean would be 45


def test_one_episode_has_no_spread() -> None:
    found = estimate_angle(np.array([-1.0]), np.array([1.0]), seed=3)
    assert found == AngleEstimate(135.0, 135.0, 135.0, -1.0, 1.0)


def test_the_seed_decides_the_interval() -> None:
    totals = sample(60.0, 30, 1.0, seed=1)
    first, again, other = (estimate_angle(*totals, seed=seed) for seed in (5, 5, 6))
    assert first == again
    assert first.angle == other.angle
    assert (first.low, first.high) != (other.low, other.high)


@pytest.mark.parametrize(
    ("confidence", "low", "high"), [(0.9, 0.0, 90.0), (0.6, 0.0, 90.0), (0.4, 45.0, 45.0)]
)
def test_the_interval_of_two_episodes_by_hand(confidence: float, low: float, high: float) -> None:
    # Four equally likely resamples: both (1, 0), one of each (twice), both (0, 1). A quarter of
    # the angles are 0, half 45 and a quarter 90.
    found = estimate_angle(
        np.array([1.0, 0.0]), np.array([0.0, 1.0]), seed=0, confidence=confidence, resamples=1000
    )
    assert found[:3] == pytest.approx((45.0, low, high))


def test_the_pair_stays_together_in_a_resample() -> None:
    env = np.array([1.0, 2.0, 30.0])
    found = estimate_angle(env, 2.0 * env, seed=0)
    assert found.low == pytest.approx(found.angle, abs=1e-9)
    assert found.high == pytest.approx(found.angle, abs=1e-9)


@pytest.mark.parametrize("direction", [180.0, 179.0, -179.0])
def test_the_interval_wraps_at_180_degrees(direction: float) -> None:
    found = estimate_angle(*sample(direction, 200, 0.5, seed=2), seed=0)
    assert abs(angle_difference(found.angle, direction)) < 10.0
    assert found.angle - 10.0 < found.low < found.angle < found.high < found.angle + 10.0
    assert found.low < 180.0 < found.high or found.low < -180.0 < found.high


@pytest.mark.parametrize("quarter_turns", [1, 2, 3])
def test_turning_the_totals_turns_the_estimate(quarter_turns: int) -> None:
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


def test_higher_confidence_gives_a_wider_interval() -> None:
    totals = sample(60.0, 30, 1.0, seed=1)
    narrow, wide = (estimate_angle(*totals, seed=5, confidence=c) for c in (0.5, 0.99))
    assert wide.low < narrow.low < narrow.high < wide.high


@pytest.mark.parametrize("direction", [30.0, 180.0])
def test_a_95_percent_interval_covers_the_truth(direction: float) -> None:
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
def test_nothing_and_not_finite_are_refused(env: list[float], social: list[float]) -> None:
    with pytest.raises(UserError, match="at least one episode, and finite reward totals"):
        estimate_angle(np.array(env), np.array(social), seed=0)


# A resample for each block, uneven blocks, and all at once.
@pytest.mark.parametrize("block", [1, 100, 10**9])
@pytest.mark.parametrize("episodes", [1, 2, 13, 64, 97])
def test_resamples_do_not_depend_on_where_the_blocks_are_cut(
    block: int, episodes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimate, "_BLOCK", block)
    whole = np.random.default_rng(3).integers(episodes, size=(29, episodes))
    np.testing.assert_array_equal(np.concatenate(list(resampled(episodes, 29, 3))), whole)
    totals = sample(50.0, episodes, 0.3, seed=episodes)
    found = estimate_angle(*totals, seed=3, resamples=29)
    means = totals.T[whole].mean(axis=1)
    deviations = np.degrees(np.arctan2(means[:, 1], means[:, 0])) - found.angle
    wrapped = (deviations + 180.0) % 360.0 - 180.0
    low, high = found.angle + np.quantile(wrapped, [(1 - 0.95) / 2, (1 + 0.95) / 2])
    assert (found.low, found.high) == (low, high)  # to the last bit


def test_many_episodes_are_resampled_in_little_memory() -> None:
    totals = sample(50.0, 10_000, 1.0, seed=0)
    tracemalloc.start()
    estimate_angle(*totals, seed=0, resamples=300)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6
