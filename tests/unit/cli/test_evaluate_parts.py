"""`evaluate` in parts: the same row, to the last digit, in however many processes."""

import json

import pytest

from socialiq.cli import evaluate
from socialiq.cli.drivers import driver_of
from socialiq.cli.main import main
from socialiq.evaluation import parts
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.measures import joined
from socialiq.worlds.grammar import parse
from socialiq.worlds.intersection.world import Intersection


def as_text(episodes):
    return {name: str(column.tolist()) for name, column in episodes.items()}


@pytest.mark.parametrize(("name", "soft"), [("gap_3s", False), ("prosocial", True)])
def test_parts_are_the_whole(name, soft):
    seeds = range(7, 30)
    driver = driver_of(name, Intersection()).policy
    whole = episodes_of(Intersection().batch(len(seeds)), driver, [*seeds], not soft)
    for processes in (1, 3):
        blocks = parts.blocks_of(seeds, processes)
        road = (name, parse("intersection"), None, False, soft, 0.0, len(seeds))
        played = [evaluate._play_road(*road, block) for block in blocks]
        assert as_text(joined(played)) == as_text(whole)


@pytest.mark.slow
def test_the_command_prints_the_same_row(capsys):
    words = ["evaluate", "idm", "--world", "intersection", "--episodes", "9", "--json"]
    assert main(words) == 0
    whole = json.loads(capsys.readouterr().out)
    assert main([*words, "--processes", "2"]) == 0
    assert json.loads(capsys.readouterr().out) == whole


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
    monkeypatch.setattr(parts, "in_parts", lambda play, split, *_: list(map(play, split)))
    words = ["evaluate", "python:a_walk.py:goes", "--world", "a_walk.py:Walk", "--allow-code"]
    words += ["--episodes", "11", "--seed", "3", "--json"]
    assert main(words) == 0
    whole = capsys.readouterr().out
    for processes in ("1", "2", "3"):
        assert main([*words, "--processes", processes]) == 0
        assert capsys.readouterr().out == whole
    assert main([*words, "--processes", "2", "--soft"]) == 2
    assert "draws its actions in order" in capsys.readouterr().err


def test_what_can_not_be_split_is_refused(capsys):
    words = ["evaluate", "random", "--world", "intersection", "--episodes", "9"]
    assert main([*words, "--processes", "2"]) == 2
    assert "random draws its actions in order" in capsys.readouterr().err
    words = ["evaluate", "x.safetensors", "--world", "crossing7", "--processes"]
    for number, line in (("2", "episodes of crossing7 are not split"), ("-1", "at least 1")):
        assert main([*words, number]) == 2
        assert line in capsys.readouterr().err
