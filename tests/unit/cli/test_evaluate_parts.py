"""`evaluate` in parts: the same row, to the last digit, in however many."""

import json

import pytest

from socialiq.cli import evaluate_parts
from socialiq.cli.drivers import driver_of
from socialiq.cli.evaluate_parts import Parts
from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.evaluation.episodes import Episodes, episodes_of
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq_lab.engine import Engine
from socialiq_lab.jobs import do, fingerprints


def silent(_):
    return None


def listed(episodes):
    return [getattr(episodes, name) for name in Episodes._fields]


def as_text(episodes):
    return [str([part.tolist() for part in value]) for value in listed(episodes)[:2]] + [
        str(value.tolist()) if hasattr(value, "tolist") else str(value)
        for value in listed(episodes)[2:]
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "soft"), [("gap_3s", False), ("prosocial", True)])
def test_one_and_three_parts_are_the_whole(tmp_path, name, soft):
    seeds = range(7, 30)
    whole = episodes_of(Batch(Options(), len(seeds)), driver_of(name), [*seeds], not soft)
    for parts in (1, 3):
        work = tmp_path / f"{parts}"
        made = Parts(Engine(), work, silent, parts).episodes(name, seeds, soft)
        assert as_text(made) == as_text(whole)


@pytest.mark.slow
def test_the_command_prints_the_same_row(tmp_path, capsys):
    words = ["evaluate", "idm", "--world", "intersection", "--episodes", "9", "--json"]
    assert main(words) == 0
    whole = json.loads(capsys.readouterr().out)
    assert main([*words, "--processes", "2", "--work", str(tmp_path / "work")]) == 0
    assert json.loads(capsys.readouterr().out) == whole
    assert len([*(tmp_path / "work" / "idm").glob("*/job.json")]) == 2


WALK = """
import gymnasium
import numpy as np

class Walk(gymnasium.Env):
    action_space = gymnasium.spaces.Discrete(2)
    observation_space = gymnasium.spaces.Box(-99.0, 99.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place, self.left = 0.0, int(self.np_random.integers(2, 7))
        return np.array([self.place], np.float32), {}

    def step(self, action):
        reward = self.np_random.normal()
        self.place, self.left = self.place + action + reward, self.left - 1
        info = {"reward_pair": (reward, -reward * self.place), "speed": float(action)}
        return np.array([self.place], np.float32), reward, self.left == 0, False, info

def goes(observations):
    return [int(one[0] < 1.0) for one in observations]
"""


def test_an_environment_gives_the_same_row_in_parts(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a_walk.py").write_text(WALK)
    monkeypatch.setattr(evaluate_parts, "run_jobs", done_here)
    words = ["evaluate", "python:a_walk.py:goes", "--world", "a_walk.py:Walk", "--allow-code"]
    words += ["--episodes", "11", "--seed", "3", "--json"]
    assert main(words) == 0
    whole = capsys.readouterr().out
    for processes in ("1", "2", "3"):
        assert main([*words, "--processes", processes]) == 0
        assert capsys.readouterr().out == whole
    assert main([*words, "--processes", "2", "--soft"]) == 2
    assert "draws its actions in order" in capsys.readouterr().err


def done_here(jobs, work, *_):
    """Do the jobs in this process, the last first."""
    for job in reversed(jobs):
        do(job, work, fingerprints(jobs)[job.name], lambda _: None)


def test_what_can_not_be_split_is_refused(tmp_path, capsys):
    with pytest.raises(UserError, match=r"^random draws its actions in order"):
        Parts(Engine(), tmp_path, silent, 2).episodes("random", range(9), False)
    words = ["evaluate", "x.safetensors", "--world", "crossing7"]
    for more, line in (
        (["--processes", "2"], "episodes of crossing7 are not split"),
        (["--work", "w"], "--work is of --processes or --cluster"),
    ):
        assert main([*words, *more]) == 2
        assert line in capsys.readouterr().err
