from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from socialiq_recordings.prediction import following, learned
from socialiq_recordings.prediction.following import features
from socialiq_recordings.prediction.models import MODELS, Task, residuals
from socialiq_recordings.prediction.rewards import rewards
from socialiq_recordings.prediction.situations import Situations

Make = Callable[..., Situations]
LEVELS = (-2.0, 0.0, 2.0)


def test_the_level_is_the_closest_and_the_ends_take_what_is_beyond() -> None:
    level = learned.nearest(np.array([-1.0, 0.0, 1.0]), [-9.0, -0.4, 0.6, 9.0])
    assert level.tolist() == [0, 1, 2, 2]


def test_moments_become_demonstrations_with_the_rewards_of_their_levels(situations: Make) -> None:
    seen = situations(
        5,
        vehicle=[2, 1, 1, 2, 1],
        time=[0.0, 0.0, 1.0, 1.0, 4.0],
        speed=[5.0, 6.0, 7.0, 8.0, 9.0],
        acceleration=[3.0, 0.2, -1.5, 0.0, 0.0],
    )
    made = learned.demonstrations(seen, LEVELS)
    # By vehicle and time; the third moment of vehicle 1 comes after a gap.
    assert made.observation[:, 0] * 10 == pytest.approx([6, 7, 9, 5, 8])
    assert made.episode.tolist() == [0, 0, 1, 2, 2]
    assert made.action.tolist() == [1, 0, 1, 2, 1]
    assert made.truncated.tolist() == [False, True, True, False, True]
    assert made.next_observation[0] == pytest.approx(made.observation[1])
    assert made.next_observation[1, 0] * 10 == pytest.approx(5.5)  # 7 m/s less 1.5
    pair = rewards(seen, np.array(LEVELS))
    assert made.rewards.env[3] == pytest.approx(pair.env[0, 2])


def test_features_are_finite_where_nothing_is_there(situations: Make) -> None:
    found = features(situations(3))
    assert found.shape == (3, 19) and np.isfinite(found).all()


@pytest.mark.slow
def test_learned_policies_predict_a_planted_rule(situations: Make) -> None:
    rng = np.random.default_rng(0)
    gap = rng.choice([5.0, 60.0], 400)
    seen = situations(
        400,
        vehicle=np.arange(400) // 4,
        time=np.arange(400) % 4.0,
        gap=gap,
        leader_speed=10.0 + np.zeros(400),
    )
    rule = np.where(gap < 20, -2.0, 2.0) + rng.normal(0, 0.2, 400)
    seen = replace(seen, acceleration=rule)
    idm, first = following.literature(), seen.half() == 0
    last = residuals(idm, seen)
    task = Task(seen, last, first, seen.rows(first), idm, 0)
    settings = learned.Training(levels=LEVELS, updates=300, hidden=(16,))
    (made,) = learned.trained([task], settings, learned.LEARNED)
    assert set(made) == set(learned.LEARNED)
    assert [made[one].personal for one in learned.LEARNED] == [False, False, True]
    trivial = MODELS["constant speed"](task)
    for name, model in made.items():
        found = model.forecast(seen, last)
        assert np.abs(found.mean - rule).mean() < 0.5, name  # constant speed is 2 off
        densities = [
            one.spread.log_density(one.forecast(seen, last), rule, seen.moving).mean()
            for one in (model, trivial)
        ]
        assert densities[0] > densities[1] + 0.1, name
