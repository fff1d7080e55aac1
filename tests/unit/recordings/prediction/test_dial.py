from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp, softmax

from socialiq_recordings.prediction import following, learned
from socialiq_recordings.prediction.learned import Levels, Training, of_policies
from socialiq_recordings.prediction.models import Task
from socialiq_recordings.prediction.situations import Situations

Make = Callable[..., Situations]
LEVELS = (-1.0, 0.0, 1.0)


class Constant:
    """Policy that takes each level with one probability wherever it is."""

    def __init__(self, *chance: float) -> None:
        self.chance = np.array(chance)

    def probabilities(self, given: np.ndarray) -> np.ndarray:
        return np.tile(self.chance, (len(given), 1))


def turned(angle: float) -> Constant:
    """Return a policy that brakes the more the larger its angle is."""
    return Constant(*softmax(np.array([1.0, 0.0, -1.0]) * (angle - 45.0) / 15.0))


FAMILY = [Constant(0.25, 0.5, 0.25), *(turned(one) for one in learned.ANGLES)]


def test_no_share_is_the_clone_and_all_of_it_the_dial(situations: Make) -> None:
    seen = situations(2)
    found = learned.of_family(FAMILY)(seen).reshape(2, len(learned.SHARES), len(learned.ANGLES), 3)
    assert logsumexp(found, axis=3) == pytest.approx(np.zeros(found.shape[:3]))
    assert np.exp(found[0, 0]) == pytest.approx(np.tile([0.25, 0.5, 0.25], (7, 1)))
    ends = [turned(one).chance for one in learned.ANGLES]
    assert np.exp(found[1, -1]) == pytest.approx(np.stack(ends), rel=1e-6)


def test_a_density_is_the_mixture_over_levels(situations: Make) -> None:
    seen = situations(6, acceleration=[-1.0, -0.8, 0.1, 0.0, 1.2, 1.0])
    levels = Levels(_task(seen), Training(levels=LEVELS))
    assert levels.centre == pytest.approx([-0.9, 0.05, 1.1])
    chance = (0.2, 0.3, 0.5)
    found = levels.log_density(of_policies([Constant(*chance)]), seen)[:, 0]
    model = levels.fitted(of_policies([Constant(*chance)]), np.zeros(1))
    made = model.forecast(seen, np.zeros(6))
    assert found == pytest.approx(levels.spread.log_density(made, seen.acceleration, seen.moving))
    assert made.mean == pytest.approx(np.full(6, np.dot(chance, levels.centre)))


def _task(seen: Situations) -> Task:
    first = seen.half() == 0
    last = np.zeros(len(seen))
    return Task(seen, last, first, seen.rows(first), following.literature(), 0)


def _planted(situations: Make, angles: list[float], seed: int) -> Situations:
    """Drivers of given angles who follow the dial of `FAMILY`, 20 moments each."""
    rng, each = np.random.default_rng(seed), 20
    chance = [turned(one).chance for one in angles for _ in range(each)]
    taken = [rng.choice(LEVELS, p=one) for one in chance]
    vehicle = np.repeat(np.arange(len(angles)), each)
    time = np.tile(np.arange(float(each)), len(angles))
    seen = situations(len(vehicle), vehicle=vehicle, time=time)
    return replace(seen, acceleration=np.array(taken) + rng.normal(0, 0.05, len(vehicle)))


def test_planted_angles_predict_second_halves_and_no_difference_predicts_nothing(
    situations: Make,
) -> None:
    apart = [0.0, 15.0, 75.0, 90.0] * 4
    gains = {}
    for name, angles in (("apart", apart), ("alike", [60.0] * 16)):
        seen = _planted(situations, angles, 1)
        task = _task(seen)
        levels, chances = Levels(task, Training(levels=LEVELS)), learned.of_family(FAMILY)
        made = learned._models(task, levels, chances, levels.log_density(chances, seen))
        assert not made[learned.AT_ANGLE].personal and made[learned.BY_DRIVER].personal
        later = seen.rows(~task.first)
        each = [
            one.spread.log_density(
                one.forecast(later, np.zeros(len(later))), later.acceleration, later.moving
            ).mean()
            for one in (made[learned.BY_DRIVER], made[learned.AT_ANGLE])
        ]
        gains[name] = each[0] - each[1]
    assert gains["apart"] > 0.2
    assert abs(gains["alike"]) < 0.02
