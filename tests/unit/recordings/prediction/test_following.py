from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from socialiq_recordings import idm
from socialiq_recordings.prediction import following
from socialiq_recordings.prediction.situations import Situations

Make = Callable[..., Situations]


def _traffic(situations: Make, count: int, seed: int = 0) -> Situations:
    rng = np.random.default_rng(seed)
    return situations(
        count,
        vehicle=np.arange(count) // 20,
        speed=rng.uniform(2, 16, count),
        gap=np.where(rng.random(count) < 0.3, np.inf, rng.uniform(3, 40, count)),
        leader_speed=rng.uniform(2, 16, count),
    )


def test_a_standing_vehicle_without_a_leader_starts_as_fast_as_it_can(situations: Make) -> None:
    found = following.next_second(following.literature(), situations(1, speed=[0.0]))
    assert found == pytest.approx([idm.Idm().max_acceleration], rel=1e-3)


def test_planted_parameters_are_found_again(situations: Make) -> None:
    seen = _traffic(situations, 400)
    truth = np.log([12.0, 1.8, 3.0, 1.6, 2.2])
    driven = following.next_second(truth, seen)
    seen = _with(seen, driven)
    found = np.exp(following.fit_population(seen))
    assert found == pytest.approx(np.exp(truth), rel=0.1)


def _with(seen: Situations, acceleration: np.ndarray) -> Situations:
    return replace(seen, acceleration=acceleration)


def test_drivers_are_told_apart_where_they_may_differ(situations: Make) -> None:
    seen = _traffic(situations, 200)
    population = following.literature()
    truth = np.tile(population, (10, 1))
    truth[:, 1] += np.linspace(-0.6, 0.6, 10)  # log of the time headway
    seen = _with(seen, following.next_second(truth[seen.vehicle], seen))
    free = following.fit_drivers(population, seen, error=0.1, spread=1.0)
    headways = np.array([free[one][1] for one in range(10)])
    assert np.corrcoef(headways, truth[:, 1])[0, 1] > 0.95
    alike = following.fit_drivers(population, seen, error=1.0, spread=1e-3)
    assert all(np.abs(one - population).max() < 0.01 for one in alike.values())
    first = np.arange(200) % 20 < 10
    assert following.best_spread(population, seen, first, error=0.1) > min(following.SPREADS)
    unknown = following.of_drivers(population, {}, seen)
    assert (unknown == population).all()
