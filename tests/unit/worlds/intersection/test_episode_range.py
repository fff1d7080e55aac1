"""Limits of an episode's rewards, by hand and against random drivers."""

import numpy as np
import pytest

from socialiq.worlds.highway.options import SOCIAL_SIGNALS
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import (
    Intersection,
    decisions,
    env_range,
    largest_progress,
    social_range,
)


def test_the_defaults_by_hand():
    options = Options()
    assert decisions(options) == 20
    progress = 2 * 13 / 28  # at most 1.3 x 10 m of 28 m, at weight 2
    assert env_range(options)[1] == pytest.approx(20 * (progress + 0.5 - 0.15))
    # The last decision collides.
    assert env_range(options)[0] == pytest.approx(19 * (-progress - 0.15) - 2.0)
    vehicles = sum(5 + later for later in range(20))
    assert social_range(options) == (-1.0 * vehicles - 5.0, pytest.approx(0.2 * vehicles))


@pytest.mark.parametrize(
    ("duration", "frequency", "count"), [(20.0, 1, 20), (4.5, 5, 23), (0.1, 1, 1), (3.0, 10, 30)]
)
def test_decisions_are_counted_as_the_core_does(duration, frequency, count):
    options = Options(duration=duration, policy_frequency=frequency)
    batch = Intersection(options).batch(4)
    batch.reset(0)
    running, made = np.ones(4, bool), 0
    while running.any():  # braking all the time, most run out of time
        running &= batch.step(np.zeros(4, int), auto_reset=False, rows=running).ending == 0
        made += 1
    assert decisions(options) in (count, count + 1)
    assert made <= decisions(options) <= made + 1


OPTIONS = {
    "usual": Options(),
    "crowded": Options(spawn_probability=1.0, initial_vehicle_count=12, duration=25.0),
    "fine": Options(simulation_frequency=15, policy_frequency=5, duration=4.5),
    "added": Options(destination="random", zone="beyond_8_m", crash="add"),
    "literal": Options(disruption="literal", yielding_weight=-0.3, arrival_weight=9.0),
    "fast": Options(target_speeds=(-3.0, 6.0, 15.0), simulation_frequency=2),
}
EPISODES = 150


@pytest.mark.parametrize("name", sorted(OPTIONS))
def test_random_drivers_stay_within(name):
    options = OPTIONS[name]
    batch, rng = Intersection(options).batch(EPISODES), np.random.default_rng(0)
    batch.reset(0)
    running, totals = np.ones(EPISODES, bool), np.zeros((EPISODES, 2))
    # Some prefer to brake and some to accelerate.
    shares = rng.dirichlet(np.ones(3), EPISODES)
    for number in range(decisions(options)):
        actions = (rng.random((EPISODES, 1)) > np.cumsum(shares, axis=1)[:, :2]).sum(axis=1)
        made = batch.step(actions, auto_reset=False, rows=running)
        progress = made.signals["progress"][running]
        assert np.abs(progress).max() <= largest_progress(options)
        others = options.initial_vehicle_count + number
        for signal in SOCIAL_SIGNALS[:2]:
            assert made.signals[signal][running].max() <= others
        totals[running] += np.stack(made.rewards, axis=1)[running]
        running &= made.ending == 0
        if not running.any():
            break
    assert not running.any()
    ranges = env_range(options), social_range(options)
    for total, (low, high) in zip(totals.T, ranges, strict=True):
        assert low <= total.min() and total.max() <= high
