"""Audits of policies with continuous actions, from declaration to repetition."""

import json
import sys

import numpy as np
import pytest

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.profile.environment import Environment
from socialiq.audit.profile.profile import world_of
from socialiq.cli.main import main
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.policies.interface import Interface

CODE = """
import gymnasium
import numpy as np
from socialiq.worlds.wrapper import RewardPairWrapper


class Place(gymnasium.Env):
    \"\"\"Three steps move a drawn place; r_env wants it at 1, r_social small steps.\"\"\"

    observation_space = gymnasium.spaces.Box(-9.0, 9.0, (2,), np.float32)

    def __init__(self, largest=0.5):
        self.action_space = gymnasium.spaces.Box(-largest, largest, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place, self.time = self.np_random.uniform(-1.0, 1.0), 0
        return self.seen(), {}

    def step(self, action):
        self.place, self.time = self.place + float(action[0]), self.time + 1
        return self.seen(), 0.0, self.time == 3, False, {"ending": "arrival"}

    def seen(self):
        return np.array([self.place, self.time], np.float32)


def pair(step):
    return -abs(step.next_observation[0] - 1.0), -abs(float(step.action[0]))


def make(largest=0.5):
    return RewardPairWrapper(Place(largest), pair)


def towards(seen):
    return np.clip(2.0 * (1.0 - seen[:, :1]), -1.0, 1.0)


def still(seen):
    return 0.0 * seen[:, :1]


asked = []


def drifting(seen):
    asked.append(1)
    return towards(seen) * (1.0 if len(asked) < 200 else 0.5)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a_place.py").write_text(CODE)
    yield tmp_path
    sys.modules.pop("a_place", None)


@pytest.fixture
def audited(folder):
    new = ["profile", "new", "--world", "a_place.py:make", "--angle", "0", "--margin", "0.1"]
    assert main([*new, "--out", "p.toml", "--allow-code"]) == 0

    place = "python:a_place.py:"

    def run(policy, *more):
        given = [word for one in ("towards", "still") for word in ("--reference", place + one)]
        given += [
            "--episodes",
            "60",
            "--seed",
            "7",
            "--profile",
            "p.toml",
            "--out",
            "out",
            "--allow-code",
            "--isolation",
            "none",
        ]
        return main(["audit", policy, *given, *more])

    return run


def linear(gain, deviation=False):
    """Return the actor a = tanh(gain (1 - place))."""
    weight = np.array([[-gain, 0.0], [0.0, 0.0]], np.float32)[: 1 + deviation]
    return ActorPolicy((weight,), (np.array([gain, -1.0], np.float32)[: 1 + deviation],), "relu", 1)


def test_a_policy_of_the_best_drives_as_declared_and_its_audit_repeats(audited, folder, capsys):
    linear(30.0).save(folder / "keen.safetensors")
    assert audited("keen.safetensors") == 1  # it oscillates around 1
    code = ["--world", "a_place.py:make", "--reference", "python:a_place.py:towards"]
    code += ["--reference", "python:a_place.py:still"]
    rerun = ["audit", "verify", "out", "--rerun", "--policy", "keen.safetensors", *code]
    assert main([*rerun, "--allow-code"]) == 0
    capsys.readouterr()
    linear(2.5).save(folder / "fair.safetensors")
    assert audited("fair.safetensors", "--replace") == 0
    report = json.loads((folder / "out/report.json").read_text())
    record = report["policy"]["record"]
    assert record["action_size"] == 1 and "n_actions" not in record
    names = [one["name"] for one in report["trivial"]]
    assert names == ["trivial_lowest_values", "trivial_highest_values", "trivial_random"]
    assert "an action of 1 number in [-1, 1]" in (folder / "out/annex-iv.md").read_text()


@pytest.mark.slow
def test_python_is_asked_again(audited, folder):
    assert audited("python:a_place.py:towards") == 0
    report = json.loads((folder / "out/report.json").read_text())
    assert report["consistency"]["repeated"] == {"queries": 180, "differing": 0}
    assert audited("python:a_place.py:drifting", "--replace") == 3
    report = json.loads((folder / "out/report.json").read_text())
    assert report["verdict"]["decision"] == "inconclusive"
    assert report["consistency"]["repeated"]["differing"] > 0


def test_a_dial_is_audited_at_the_declared_angle_and_a_reference_at_each_of_seven(audited, folder):
    turned = ActorPolicy(
        (np.array([[-2.5, 0.0, 0.0, 0.0]], np.float32),), (np.array([2.5], np.float32),), "relu", 1
    )
    ActorDial(turned, 0.0, 90.0).save(folder / "dial.safetensors")
    assert audited("dial.safetensors", "--reference", "dial.safetensors") == 3
    report = json.loads((folder / "out/report.json").read_text())
    angles = [one["angles"] for one in report["references"] if one["angles"]]
    assert len(report["left_out"]) == 0 and [15.0] in angles and [90.0] in angles


@pytest.mark.parametrize(
    ("policy", "line"),
    [
        (
            "atlas:prosocial",
            "unknown policy of the atlas 'prosocial': choose one of expert_egoistic",
        ),
        ("wide.safetensors", "actions of 2 numbers, the world has 2 and actions of 1 number:"),
        ("python:a_place.py:pair", "raised"),
    ],
)
def test_a_policy_of_other_actions_is_refused_in_one_line(audited, folder, capsys, policy, line):
    weight = np.zeros((2, 2), np.float32)
    wide = ActorPolicy((weight,), (np.zeros(2, np.float32),), "relu", 2)
    wide.save(folder / "wide.safetensors")
    capsys.readouterr()
    assert audited(policy) == 2
    told = capsys.readouterr().err.splitlines()
    assert line in told[-1] and not (folder / "out").exists()


def test_a_continuous_policy_does_not_fit_a_discrete_declaration(folder, capsys):
    weight = np.zeros((3, 70), np.float32)
    ActorPolicy((weight,), (np.zeros(3, np.float32),), "relu", 3).save(folder / "a.safetensors")
    assert (
        main(["profile", "new", "--world", "intersection", "--angle", "0", "--out", "i.toml"]) == 0
    )
    capsys.readouterr()
    assert main(["audit", "a.safetensors", "--profile", "i.toml", "--out", "out"]) == 2
    assert "actions of 3 numbers, the world has 70 and 3 discrete" in capsys.readouterr().err


def test_the_bounds_of_actions_are_part_of_the_scenario(folder):
    narrow, wide = (Environment.of("a_place.py:make", {"largest": one}, True) for one in (0.5, 2.0))
    found = json.loads(narrow.description)
    assert found["action_bounds"] == {"low": [-0.5], "high": [0.5]} and "n_actions" not in found
    assert narrow.description != wide.description
    assert Interface.of(narrow) == Interface(2, 0, 1, "rows-1")
    assert Interface.of(world_of("intersection", {})) == Interface(70, 3, schema="rows-1")


def test_random_actions_are_those_of_the_episode(folder):
    world, seeds = Environment.of("a_place.py:make", {}, True), np.arange(30)
    reference = Reference("fair", linear(2.5))
    both = [
        collect_evidence(world, linear(1.0), part, [reference]).trivial[-1].totals
        for part in (seeds, seeds[::-1])
    ]
    assert np.array_equal(both[0], both[1][::-1]) and len(np.unique(both[0][:, 1])) == 30
