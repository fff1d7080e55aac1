"""Tasks of MO-Gymnasium by name: a vector of two rewards is the pair, any other is refused."""

import numpy as np
import pytest

pytest.importorskip("mo_gymnasium", reason="mo-gymnasium is not installed")

from socialiq.errors import UserError
from socialiq.evaluation.rollout import rollout_env
from socialiq.worlds.environment import make_environment

pytestmark = [
    # Gymnasium warns of rewards that are vectors, and of bounds in float64.
    pytest.mark.filterwarnings("ignore:.*reward returned by:UserWarning"),
    pytest.mark.filterwarnings("ignore:.*precision lowered:UserWarning"),
]


class Still:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.ones(np.shape(observation)[:-1], int), state


def test_a_task_of_two_rewards_has_them_as_its_pair():
    env = make_environment("mo_gymnasium:deep-sea-treasure-v0", allow_code=True, needs_pair=True)
    observation, _ = env.reset(seed=0)
    # One cell down: the treasure of 0.7 after one step, which costs 1.
    _, _, ended, _, info = env.step(1)
    assert observation.tolist() == [0, 0]
    assert ended and info["reward_pair"].tolist() == pytest.approx([0.7, -1.0])


def test_a_task_of_three_rewards_is_refused_in_one_line():
    env = make_environment("mo_gymnasium:mo-mountaincar-v0", allow_code=True, needs_pair=True)
    with pytest.raises(
        UserError, match="a vector reward has length 3, and an angle weighs two parts"
    ):
        rollout_env(env, Still(), 1, seed=0)
