"""Reward pairs for any environment: accepted and refused environments."""

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds.wrapper import (
    RewardPairWrapper,
    Transition,
    flat,
    flat_rows,
    flat_space,
)


class Road(gymnasium.Env):
    """Two numbers in a square; arrives at the third step."""

    action_space: gymnasium.Space = spaces.Discrete(2)
    observation_space: gymnasium.Space = spaces.Box(-1e300, 9.0, (2, 2), np.float64)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.time = 0
        return self._seen(), {}

    def step(self, action):
        self.time += 1
        return self._seen(), 2.0, self.time == 3, False, {"lost": 0.5 * action}

    def _seen(self):
        return np.full((2, 2), float(self.time))


def by_hand(moment: Transition):
    """r_env: the reward and how far it came; r_social: what others lost."""
    gone = moment.next_observation[0, 0] - moment.observation[0, 0]
    return moment.reward + gone + 10 * moment.env.unwrapped.time, -moment.info["lost"]


def test_the_pair_and_its_score_are_those_of_the_function():
    env = RewardPairWrapper(Road(), by_hand, angle=90.0)
    seen, _ = env.reset(seed=0)
    assert seen.tolist() == [0.0] * 4 and seen.dtype == np.float32
    after, reward, terminated, _, info = env.step(1)
    assert after.tolist() == [1.0] * 4 and after in env.observation_space
    assert info["reward_pair"].tolist() == [2 + 1 + 10, -0.5]
    assert reward == pytest.approx(-0.5) and not terminated
    env.step(0)
    *_, info = env.step(0)
    assert info["reward_pair"].tolist() == [2 + 1 + 30, 0.0] and "ending" not in info


@pytest.mark.parametrize("kind", [Ending.COLLISION, "collision"])
def test_the_ending_is_asked_for_at_the_end_alone(kind):
    asked = []
    env = RewardPairWrapper(Road(), by_hand, lambda moment: asked.append(moment) or kind)
    env.reset()
    *_, first = env.step(0)
    env.step(0)
    *_, last = env.step(0)
    assert "ending" not in first and last["ending"] == "collision" and len(asked) == 1
    assert asked[0].terminated and asked[0].action == 0


def test_a_time_limit_truncates_whatever_the_ending_says():
    limited = gymnasium.wrappers.TimeLimit(Road(), 2)
    env = RewardPairWrapper(limited, by_hand, lambda _: "arrival")
    env.reset()
    env.step(0)
    _, _, terminated, truncated, info = env.step(0)
    assert (terminated, truncated) == (False, True) and "ending" not in info


def test_without_a_function_the_environment_has_to_tell():
    env = RewardPairWrapper(Road())
    env.reset()
    with pytest.raises(UserError, match=r"^the environment gives no reward pair: put .* into info"):
        env.step(0)
    told = RewardPairWrapper(RewardPairWrapper(Road(), by_hand), angle=0.0)
    told.reset()
    assert told.step(0)[1] == 13.0


@pytest.mark.parametrize(
    "given", [(1.0,), (1.0, 2.0, 3.0), (1.0, np.nan), (np.inf, 0.0), 5.0, None, ("a", "b")]
)
def test_what_is_no_pair_is_refused(given):
    env = RewardPairWrapper(Road(), lambda _: given)
    env.reset()
    line = r"^the reward pair must be two finite numbers \(r_env, r_social\), got "
    with pytest.raises(UserError, match=line) as caught:
        env.step(0)
    assert "\n" not in str(caught.value)


def test_a_function_that_fails_is_blamed():
    env = RewardPairWrapper(Road(), lambda moment: moment.info["speed"])
    env.reset()
    with pytest.raises(UserError, match="function of the reward pair raised KeyError: 'speed'"):
        env.step(0)
    env = RewardPairWrapper(Road(), by_hand, lambda _: "crashed")
    env.reset()
    env.step(0)
    env.step(0)
    with pytest.raises(UserError, match="choose one of arrival, collision, other"):
        env.step(0)


@pytest.mark.parametrize(
    "space",
    [
        spaces.Discrete(5),
        spaces.Discrete(5, start=-2),
        spaces.MultiBinary(4),
        spaces.MultiBinary([2, 3]),
        spaces.MultiDiscrete([3, 2, 4]),
        spaces.MultiDiscrete([[3, 2], [2, 2]], start=[[1, 0], [-3, 0]]),
        spaces.Box(-1.0, 1.0, (2, 3), np.float64),
        spaces.Box(0, 255, (2, 2), np.uint8),
    ],
)
def test_observations_are_flat_as_gymnasium_flattens_them(space):
    space.seed(0)
    rows = [space.sample() for _ in range(50)]
    expected = [spaces.flatten(space, row).astype(np.float32) for row in rows]
    np.testing.assert_array_equal(flat_rows(space, np.array(rows)), expected)
    np.testing.assert_array_equal([flat(space, row) for row in rows], expected)
    inside = flat_space(space)
    assert inside.dtype == np.float32 and all(inside.contains(row) for row in expected)
    env = RewardPairWrapper(type("Other", (Road,), {"observation_space": space})(), by_hand)
    assert env.observation_space == inside


def test_parts_of_a_dict_are_side_by_side_as_gymnasium_has_them():
    inner = spaces.Dict(level=spaces.Discrete(3, start=1), car=spaces.Box(-1.0, 1.0, (2, 2)))
    space = spaces.Dict(mine=spaces.Box(0.0, 1.0, (2,)), house=inner)
    space.seed(0)
    for row in (space.sample() for _ in range(20)):
        np.testing.assert_array_equal(flat(space, row), spaces.flatten(space, row))
        assert flat_space(space).contains(flat(space, row))
    with pytest.raises(UserError, match="kind Box, .* not Text"):
        flat_space(spaces.Dict(name=spaces.Text(2)))


def test_whole_numbers_that_a_space_does_not_have_are_refused():
    for value in (5, -1, 1.5):
        with pytest.raises(ValueError, match="whole"):
            flat(spaces.Discrete(5), value)
    with pytest.raises(UserError, match="are 2,000,000 numbers as one-hot vectors"):
        flat_space(spaces.Discrete(2_000_000))


@pytest.mark.parametrize(
    ("name", "space", "line"),
    [
        ("action_space", spaces.Box(0, np.inf, (1,)), "the Box of actions has no finite bounds"),
        ("action_space", spaces.Discrete(2, start=1), "must be numbered from 0, not 1"),
        ("observation_space", spaces.Text(2), "kind Box, .* not Text: wrap"),
    ],
)
def test_other_spaces_are_refused(name, space, line):
    kind = type("Other", (Road,), {name: space})
    with pytest.raises(UserError, match=line):
        RewardPairWrapper(kind(), by_hand)
    with pytest.raises(UserError, match="outside"):
        RewardPairWrapper(Road(), by_hand, angle=400.0)
