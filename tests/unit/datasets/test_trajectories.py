"""Trajectories as `imitation` has them: by objects, by dicts, and in its old archive."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from socialiq.datasets.trajectories import condensed, of_trajectories
from socialiq.errors import UserError


@dataclasses.dataclass
class Trajectory:
    """The fields of `imitation.data.types.TrajectoryWithRew`."""

    obs: Any
    acts: Any
    infos: Any
    terminal: Any
    rews: Any = None


pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


def info(env, social, **more):
    return {"reward_pair": np.array([env, social]), **more}


ARRIVES = Trajectory(
    np.array([[0.0, 1.0], [1.0, 1.0], [2.0, 1.0]]),
    np.array([1, 0]),
    np.array([info(1.0, 0.5), info(2.0, -1.0, ending="arrival")]),
    True,
)
CUT = Trajectory(
    np.array([[5.0, 1.0], [6.0, 1.0]]), [1], [info(3.0, 0.0, **{"TimeLimit.truncated": True})], True
)


def test_pairs_and_endings_come_from_the_infos():
    table = of_trajectories([ARRIVES, CUT], n_actions=2)
    assert table.observation.tolist() == [[0, 1], [1, 1], [5, 1]]
    assert table.next_observation.tolist() == [[1, 1], [2, 1], [6, 1]]
    assert table.rewards.env.tolist() == [1, 2, 3]
    assert table.rewards.social.tolist() == [0.5, -1, 0]
    assert table.ending.tolist() == [0, 1, 3]
    assert table.truncated.tolist() == [False, False, True]
    assert (table.episode.tolist(), table.step.tolist()) == ([0, 0, 1], [0, 1, 0])


def test_dicts_do_and_so_do_named_demonstrators():
    listed = [vars(one) for one in (ARRIVES, CUT, ARRIVES)]
    table = of_trajectories(listed, n_actions=2, modes=["bold", "patient", "bold"])
    assert table.counts() == {"bold": (2, 4), "patient": (1, 1)}


@pytest.mark.parametrize(
    ("changed", "ending"),
    [
        ({}, 4),
        ({"terminal": False}, 0),
        ({"terminal": np.bool_(True)}, 4),
        ({"infos": [{}, {"ending": "collision"}]}, 2),
        ({"infos": [{}, {"ending": "timeout"}]}, 3),
    ],
)
def test_a_last_step_ends_as_it_says(changed, ending):
    one = {"obs": ARRIVES.obs, "acts": [0, 1], "terminal": True, "rews": [[1, 2], [3, 4]]}
    assert of_trajectories([one | changed], n_actions=2).ending.tolist() == [0, ending]


def test_a_time_limit_tells_cut_episodes_from_terminal_ones():
    long = {"obs": ARRIVES.obs, "acts": [0, 1], "terminal": True, "rews": [1.0, 2.0]}
    short = {"obs": [[0, 0], [1, 1]], "acts": [0], "terminal": True, "rews": [3.0]}
    table = of_trajectories([long, short], n_actions=2, social="none", time_limit=2)
    assert table.ending.tolist() == [0, 3, 4]
    assert table.rewards.social.tolist() == [0, 0, 0]


def test_old_archives_hold_trajectories_end_to_end():
    arrays = {
        "obs": np.array([[0.0], [1.0], [2.0], [5.0], [6.0]]),
        "acts": np.array([1, 0, 1]),
        "rews": np.array([1.0, 2.0, 3.0], np.float32),
        "terminal": np.array([True, False]),
        "indices": np.array([2]),
    }
    table = of_trajectories(condensed(arrays), n_actions=2, social="none")
    assert table.observation.tolist() == [[0], [1], [5]]
    assert table.next_observation.tolist() == [[1], [2], [6]]
    assert table.ending.tolist() == [0, 4, 0] and table.episode.tolist() == [0, 0, 1]
    for changed in (
        {"indices": np.array([0])},
        {"indices": np.array([3])},
        {"indices": np.array([2.0])},
        {"indices": np.array([1, 2])},
        {"indices": np.array([[2]])},
        {"terminal": np.array(True)},
        {"obs": arrays["obs"][:4]},
        {"rews": arrays["rews"][:2]},
    ):
        with pytest.raises(UserError, match=r"indices must hold|obs has"):
            of_trajectories(condensed(arrays | changed), n_actions=2, social="none")
    del arrays["acts"]
    with pytest.raises(UserError, match="no acts: save"):
        of_trajectories(condensed(arrays), n_actions=2)


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"obs": ARRIVES.obs[:2]}, "trajectory 1: obs has 2 rows for 2 actions"),
        ({"obs": {"road": ARRIVES.obs}}, "trajectory 1: obs is a dict"),
        ({"obs": None}, "trajectory 1: it has no obs"),
        ({"obs": np.zeros((3, 5))}, "trajectories differ in features .2, 5."),
        ({"obs": np.zeros((3, 4, 4))}, "trajectory 1: obs has shape"),
        ({"acts": [0.5, 0.5]}, "trajectories differ in actions"),
        ({"acts": []}, "trajectory 1"),
        ({"infos": [{}]}, "infos must be 2 dicts"),
        ({"infos": 3}, "infos must be 2 dicts"),
        ({"infos": ["a", "b"]}, "infos must be 2 dicts"),
        ({"infos": [{}, {}]}, "no reward"),
        ({"infos": [info(1, 2), {}]}, "no reward"),
        ({"infos": None, "rews": [1.0, 2.0]}, "trajectory 1: reward has one number"),
        ({"infos": None, "rews": [[1.0, 2.0]]}, "rews has 1 rows for 2 actions"),
        ({"infos": [info(1, 2), info(1, 2, ending="won")]}, "unknown info"),
        ({"terminal": "yes"}, "terminal must be one boolean"),
        ({"terminal": None}, "it has no terminal"),
    ],
)
def test_a_wrong_trajectory_is_named(changed, match):
    wrong = dataclasses.replace(ARRIVES, **changed)
    with pytest.raises(UserError, match=match) as caught:
        of_trajectories([ARRIVES, wrong], n_actions=2)
    assert "\n" not in str(caught.value)


def test_lists_that_cannot_be():
    with pytest.raises(UserError, match="pass at least one"):
        of_trajectories([], n_actions=2)
    with pytest.raises(UserError, match="1 modes for 2 trajectories"):
        of_trajectories([ARRIVES, CUT], n_actions=2, modes=["bold"])
