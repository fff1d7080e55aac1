"""`train dqn`: experts in every world of discrete actions, by one piece of code."""

import json
from pathlib import Path

import pytest

from socialiq.cli.main import main

OWN = """
import gymnasium
import numpy as np


class Own(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(0, 1, (3,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.left = 5
        return self.np_random.random(3).astype(np.float32), {}

    def step(self, action):
        self.left -= 1
        info = {"reward_pair": (float(action), 1.0 - action)}
        return self.np_random.random(3).astype(np.float32), 0.0, False, self.left == 0, info
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(OWN)


def trained(*words):
    assert main(["train", "dqn", *words, "--out", "run"]) == 0
    return json.loads(Path("run/run.json").read_text())


def evaluated(capsys, *words):
    capsys.readouterr()
    assert main(["evaluate", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_experts_of_a_gridworld_are_its_optima(capsys):
    run = trained("--world", "crossing7", "--angle", "0", "45", "--updates", "8000")
    for policy in run["policies"]:
        file = f"run/{policy['file']}"
        row = evaluated(capsys, file, "--world", "crossing7", "--angle", f"{policy['angle']:g}")
        assert row["regret"] == pytest.approx(0.0, abs=0.02)


def test_an_expert_of_an_environment_of_the_user_does_what_its_angle_pays(capsys):
    world = ("--world", "own.py:Own", "--allow-code")
    trained(*world, "--angle", "0", "90", "--updates", "200", "--set", "steps_per_update=4")
    for angle, row in ((0, {"r_env": 5, "r_social": 0}), (90, {"r_env": 0, "r_social": 5})):
        found = evaluated(capsys, f"run/policy_angle{angle}.safetensors", *world, "--episodes", "4")
        assert {name: found[name] for name in row} == row


@pytest.mark.parametrize(
    "world", ["intersection", "merge", "intersection,people=0.1", "crossing5", "CartPole-v1"]
)
def test_every_world_of_discrete_actions_trains_experts(world):
    run = trained("--world", world, "--updates", "2", "--seed", "0", "1")
    assert [policy["seed"] for policy in run["policies"]] == [0, 1]
    assert run["world"] == world


@pytest.mark.parametrize(
    ("words", "structure"),
    [
        ((), {"double": True, "batch_size": 256, "through_timeouts": False}),
        (
            ("--preset", "thesis"),
            {"double": False, "batch_size": 32, "through_timeouts": True},
        ),
        (("--set", "through_timeouts=true"), {"double": True, "through_timeouts": True}),
    ],
)
def test_presets_and_settings_shape_the_expert(words, structure):
    run = trained("--world", "intersection", *words, "--updates", "3")
    assert {name: run["structure"][name] for name in structure} == structure
    assert run["structure"]["steps"] == 3 * 48
    assert run["numbers"][0]["learning_rate"] == 3e-4
    assert run["numbers"][0]["discount"] == 0.99


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--world", "intersection-continuous"), "socialiq train sac --world"),
        (("--world", "intersection,agents=2"), "leave agents out"),
        (("--world", "crossing7", "--preset", "best"), "choose one of ours, thesis, grid"),
        (("--world", "crossing7", "--set", "nosuch=1"), "there is no setting nosuch"),
        (("--world", "crossing7", "--updates", "0"), "must be at least 1"),
        (("--world", "CartPole-v1", "--angle", "45"), "gives no reward pair"),
        (("--world", "own.py:Own"), "--allow-code"),
        (("--world", "nowhere"), "unknown world"),
    ],
)
def test_a_mistake_gets_one_line_and_leaves_nothing(words, line, capsys, tmp_path):
    assert main(["train", "dqn", *words, "--out", "run"]) == 2
    error = capsys.readouterr().err
    assert line in error
    assert not (tmp_path / "run").exists()
