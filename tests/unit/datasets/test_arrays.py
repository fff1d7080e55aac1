"""Plain arrays become the table that the same arrays by hand make."""

import numpy as np
import pytest

from socialiq.datasets.arrays import of_steps
from socialiq.errors import UserError
from socialiq.types import Ending

SEEN = np.array([[0.0], [1.0], [2.0], [5.0], [6.0]])
ACTION = [1, 1, 0, 2, 1]
REWARD = np.array([[1.0, 0.5], [2.0, 0.0], [3.0, -1.0], [4.0, 2.0], [5.0, 0.25]])
LAST = np.array([0, 0, 1, 0, 1], np.bool_)
FINAL = [[3.0], [7.0]]

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


def made(**changed):
    given = {"terminated": LAST, "final_observation": FINAL, "n_actions": 3} | changed
    columns = [given.pop(n, d) for n, d in (("seen", SEEN), ("action", ACTION), ("reward", REWARD))]
    return of_steps(*columns, **given)


def test_what_follows_is_derived_within_each_episode():
    table = made()
    assert table.next_observation.tolist() == [[1], [2], [3], [6], [7]]
    assert table.episode.tolist() == [0, 0, 0, 1, 1]
    assert table.step.tolist() == [0, 1, 2, 0, 1]
    assert table.ending.tolist() == [0, 0, 4, 0, 4]
    assert table.rewards.env.tolist() == [1, 2, 3, 4, 5]
    assert table.rewards.social.tolist() == [0.5, 0, -1, 2, 0.25]
    assert (table.mode_names, table.n_actions, table.mode.max()) == (("demonstrator",), 3, 0)
    assert table.totals().env.tolist() == [6, 9]


def test_a_flag_that_only_cuts_is_a_timeout():
    cut = made(terminated=None, truncated=LAST)
    assert cut.ending.tolist() == [0, 0, 3, 0, 3] and not cut.terminated.any()
    both = made(truncated=np.array([0, 0, 0, 0, 1]))
    assert both.ending.tolist() == [0, 0, 4, 0, 4]  # a terminal state that the clock cuts too
    assert both.truncated.tolist() == [False] * 4 + [True]


def test_kinds_of_ending_tell_the_flags():
    table = made(terminated=None, ending=[0, 0, 2, 0, 3])
    assert table.terminated.tolist() == [False, False, True, False, False]
    assert table.truncated.tolist() == [False, False, False, False, True]
    assert table.ending[2] == Ending.COLLISION


def test_episodes_may_be_numbered_and_need_not_end():
    table = made(terminated=None, episode=[0, 0, 1, 1, 1], final_observation=[[2.0], [7.0]])
    assert table.ending.tolist() == [0] * 5 and table.step.tolist() == [0, 1, 0, 1, 2]
    assert table.next_observation.tolist() == [[1], [2], [5], [6], [7]]


def test_given_successors_stay_as_they_are():
    after = SEEN * 10
    table = made(next_observation=after, final_observation=None)
    assert np.array_equal(table.next_observation, after.astype(np.float32))


def test_demonstrators_by_row():
    table = made(mode=[0, 0, 0, 1, 1], mode_names=("bold", "patient"))
    assert table.counts() == {"bold": (1, 3), "patient": (1, 2)}


def test_one_reward_a_step_is_r_env_only_where_that_is_said():
    table = made(reward=REWARD[:, 0], social="none")
    assert table.rewards.social.tolist() == [0] * 5 and table.rewards.env[4] == 5
    with pytest.raises(UserError, match="r_social is not known"):
        made(reward=REWARD[:, 0])
    with pytest.raises(UserError, match="unknown social 'zero'"):
        made(reward=REWARD[:, 0], social="zero")


def test_images_are_flattened_only_where_that_is_said():
    images = np.arange(5 * 4).reshape(5, 2, 2)
    table = made(seen=images, final_observation=np.zeros((2, 2, 2)), flatten=True)
    assert table.observation[1].tolist() == [4, 5, 6, 7]
    with pytest.raises(UserError, match=r"observation has shape \(5, 2, 2\)"):
        made(seen=images)


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"final_observation": None, "episode": [0, 0, 0, 1, 2]}, "episode 1 has one step, and"),
        ({"final_observation": [[1.0]]}, "one row of 1 features for each of 2"),
        ({"terminated": None}, "nothing says where an episode ends"),
        ({"terminated": LAST[:3]}, "need 5 rows"),
        ({"terminated": [0, 0, 2, 0, 1]}, "one boolean a step"),
        ({"episode": [0, 0, 0]}, "episode has 3 rows where observation has 5"),
        ({"episode": [0, 0, 1, 0, 0], "final_observation": [[1.0]] * 3}, "episode, row 3"),
        ({"action": [0.5] * 5}, "no number of actions"),
        ({"action": [[0, 1]] * 5}, "one integer for each step"),
        ({"action": [0, 1, 2, 3, 0]}, "column action, row 3: outside"),
        ({"action": [0, 1, 2, 2**40, 0]}, "holds 1099511627776"),
        ({"action": [0, 1]}, "has 2 rows where|where action has 2"),
        ({"n_actions": 2}, "column action, row 3: outside"),
        ({"reward": REWARD.T}, "pass .steps, 2."),
        ({"reward": REWARD[:3]}, "column r_env has 3 rows"),
        ({"reward": REWARD * np.nan}, "column r_env, row 0: not finite"),
        ({"seen": {"a": SEEN}}, "observation is a dict"),
        ({"seen": [[1.0], [1.0, 2.0], [0.0], [0.0], [0.0]]}, "not an array of numbers"),
        ({"seen": np.array(["a"] * 5)}, "an array of numbers"),
        ({"seen": np.array([object()] * 5)}, "observation is object"),
        ({"seen": SEEN * 1e300}, "column observation, row 1: not finite"),
        ({"seen": np.zeros((0, 1))}, "at least one row"),
        ({"seen": np.zeros((5, 0))}, "at least one row of one feature"),
        ({"ending": [0, 0, 4, 0, 300]}, "ending holds 300"),
        ({"ending": [0, 0, 3, 0, 4]}, "column ending, row 2: must be 3 TIMEOUT"),
    ],
)
def test_what_does_not_fit_is_one_line(changed, match):
    with pytest.raises(UserError, match=match) as caught:
        made(**changed)
    assert "\n" not in str(caught.value)
