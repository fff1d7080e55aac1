"""Environments that no policy can drive in, through the commands that drive: one line each."""

import pytest

from socialiq.cli.main import main

CODE = """
import gymnasium
import numpy as np
from gymnasium import spaces


class Road(gymnasium.Env):
    action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
    observation_space = spaces.Box(-9.0, 9.0, (2,), np.float32)
    reward = np.zeros(2)
    seen = np.zeros(2, np.float32)
    limit = 4

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.clock = 0
        return self.seen, {}

    def step(self, action):
        self.clock += 1
        return self.seen, self.reward, False, self.clock == self.limit, {}


def changed(**attributes):
    return lambda: type("Changed", (Road,), attributes)()


good = changed()
unbounded = changed(action_space=spaces.Box(-np.inf, np.inf, (1,), np.float32))
one_sided = changed(action_space=spaces.Box(0.0, np.inf, (1,), np.float32))
matrix = changed(action_space=spaces.Box(-1.0, 1.0, (2, 2), np.float32))
whole = changed(action_space=spaces.Box(0, 3, (1,), np.int64))
several = changed(action_space=spaces.MultiDiscrete([2, 2]))
named = changed(action_space=spaces.Dict({"gas": spaces.Box(-1.0, 1.0, (1,), np.float32)}))
three = changed(reward=np.zeros(3))
single = changed(reward=np.zeros(1))
nan_reward = changed(reward=np.array([0.0, np.nan]))
nan_seen = changed(seen=np.array([0.0, np.nan], np.float32))
longer = changed(seen=np.zeros(3, np.float32))
endless = changed(limit=-1)


def still(observations):
    return np.zeros((len(observations), 1))


def nan(observations):
    return np.full((len(observations), 1), np.nan)


def far(observations):
    return np.full((len(observations), 1), 2.0)


def two(observations):
    return np.zeros((len(observations), 2))
"""
BAD = {
    "unbounded": "the Box of actions has no finite bounds",
    "one_sided": "the Box of actions has no finite bounds",
    "matrix": "actions are a Box of float32 of shape (2, 2)",
    "whole": "actions are a Box of int64 of shape (1,)",
    "several": "actions of kind MultiDiscrete are not supported",
    "named": "actions of kind Dict are not supported",
    "three": "a vector reward has length 3, and an angle weighs two parts",
    "single": "a vector reward has length 1, and an angle weighs two parts",
    "nan_reward": "a vector reward must be two finite numbers",
    "nan_seen": "gave an observation of NaN or infinity",
    "longer": "gave an observation of shape (3,)",
}
TINY = ("--updates", "3", "--set", "updates_per_round=3", "--hidden", "4", "--set", "batch_size=4")


@pytest.fixture(autouse=True)
def code_of_a_user(tmp_path, monkeypatch, as_a_user_runs_it):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a_bad_road.py").write_text(CODE)


def train(name):
    world = ("--world", f"a_bad_road.py:{name}", "--allow-code")
    return main(["train", "sac", *world, *TINY, "--out", "run"])


def collect(name, driver="still"):
    named = ("--driver", f"python:a_bad_road.py:{driver}", "--episodes", "1", "--allow-code")
    return main(["collect", f"a_bad_road.py:{name}", *named, "--out", "data"])


def evaluate(name, driver="still"):
    world = ("--world", f"a_bad_road.py:{name}", "--episodes", "1", "--allow-code")
    return main(["evaluate", f"python:a_bad_road.py:{driver}", *world])


def check_refusal(status, capsys, tmp_path, line):
    told = capsys.readouterr().err
    assert status == 2 and told.startswith("socialiq: ") and told.count("\n") == 1
    assert line in told
    assert {one.name for one in tmp_path.iterdir()} <= {"a_bad_road.py", "__pycache__"}


@pytest.mark.parametrize("command", [train, collect, evaluate])
@pytest.mark.parametrize("name", BAD)
def test_an_environment_that_cannot_be_driven_in_is_told(command, name, capsys, tmp_path):
    check_refusal(command(name), capsys, tmp_path, BAD[name])


@pytest.mark.parametrize("command", [collect, evaluate])
@pytest.mark.parametrize(
    ("driver", "line"),
    [
        ("nan", "NaN"),
        ("far", "continuous actions must be in [-1, 1]"),
        ("two", "it must be 1 number for each of 1 observations"),
    ],
)
def test_actions_that_are_no_actions_are_told(command, driver, line, capsys, tmp_path):
    check_refusal(command("good", driver), capsys, tmp_path, line)


@pytest.mark.slow
@pytest.mark.parametrize("command", [collect, evaluate])
def test_an_episode_that_does_not_end_is_told(command, capsys, tmp_path):
    check_refusal(command("endless"), capsys, tmp_path, "gymnasium.wrappers.TimeLimit")


@pytest.mark.slow
def test_the_same_commands_do_their_work_in_a_good_one(tmp_path):
    assert train("good") == collect("good") == evaluate("good") == 0
    assert (tmp_path / "run" / "run.json").is_file() and (tmp_path / "data").is_file()


def test_a_folder_that_was_there_stays(tmp_path):
    (tmp_path / "run").mkdir()
    assert train("nan_reward") == 2
    assert (tmp_path / "run").is_dir() and not any((tmp_path / "run").iterdir())
