"""Absorbing states: what the environment gives, and that demonstrations are changed alike."""

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

from socialiq.demonstrations.variants import with_absorbing_states
from socialiq.errors import UserError
from socialiq.evaluation.rollout import rollout_env
from socialiq.types import Ending
from socialiq.worlds.wrapper import AbsorbingStates


class Falls(gymnasium.Env):
    """Counts steps; terminates after the second, or with `stands` is cut after the third."""

    observation_space = spaces.Box(1.0, 9.0, (2,), np.float32)
    action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)

    def __init__(self, stands: bool = False) -> None:
        self.stands = stands

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.count = 1
        return self._seen(), {}

    def step(self, action):
        self.count += 1
        over = not self.stands and self.count == 3
        return self._seen(), 7.0, over, self.stands and self.count == 4, {}

    def _seen(self):
        return np.full(2, self.count, np.float32)


class Still:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((*np.shape(observation)[:-1], 1), np.float32), state


def test_a_terminal_state_is_left_for_one_that_is_never_left():
    env = AbsorbingStates(Falls(), stay=2)
    assert env.observation_space.shape == (3,)
    seen, _ = env.reset(seed=0)
    assert seen.tolist() == [1.0, 1.0, 0.0] and env.observation_space.contains(seen)
    found = [env.step(np.zeros(1)) for _ in range(4)]
    assert [one[0].tolist() for one in found] == [[2.0, 2.0, 0.0], *[[0.0, 0.0, 1.0]] * 3]
    assert [one[1] for one in found] == [7.0, 7.0, 0.0, 0.0]
    assert [one[2:4] for one in found] == [(False, False)] * 3 + [(False, True)]
    assert all(env.observation_space.contains(one[0]) for one in found)
    assert env.reset()[0].tolist() == [1.0, 1.0, 0.0]


@pytest.mark.parametrize("stands", [False, True])
@pytest.mark.parametrize("stay", [1, 3])
def test_demonstrations_are_changed_as_the_environment_is(stands, stay):
    plain = rollout_env(Falls(stands), Still(), 2, 0).transitions
    wanted = rollout_env(AbsorbingStates(Falls(stands), stay), Still(), 2, 0).transitions
    found = with_absorbing_states(plain, stay)
    for name, column in wanted.arrays().items():
        np.testing.assert_array_equal(found.arrays()[name], column, err_msg=name)
    assert set(found.ending[found.truncated].tolist()) == {int(Ending.TIMEOUT)}
    assert not found.terminated.any()


def test_no_step_in_it_is_refused():
    for make in (
        lambda: AbsorbingStates(Falls(), 0),
        lambda: with_absorbing_states(rollout_env(Falls(), Still(), 1, 0).transitions, 0),
    ):
        with pytest.raises(UserError, match="stay must be at least 1, got 0"):
            make()
