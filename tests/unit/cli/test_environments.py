"""`collect`, `train` and `evaluate` in a user's environment: modes, mixtures, mistakes."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from socialiq.audit.profile import reader
from socialiq.cli.main import main
from socialiq.demonstrations import files
from socialiq.nn.q_policy import QPolicy

CODE = """
import gymnasium
import numpy as np
from socialiq.worlds.wrapper import RewardPairWrapper

class Road(gymnasium.Env):
    \"\"\"Who goes (1) arrives after 2 steps at the others' cost; who waits runs out of time.\"\"\"

    action_space = gymnasium.spaces.Discrete(2)
    observation_space = gymnasium.spaces.Box(0.0, 9.0, (2,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place, self.drawn = 0, self.np_random.random()
        return self.seen(), {}

    def step(self, action):
        self.place += action
        return self.seen(), 0.0, self.place == 2, False, {"ending": "arrival"}

    def seen(self):
        return np.array([self.place, self.drawn], np.float32)

def bare(steps=4):
    return gymnasium.wrappers.TimeLimit(Road(), steps)

def make(steps=4):
    return RewardPairWrapper(bare(steps), lambda step: (float(step.action), -0.5 * step.action))

def goes(observations):
    return [1 for _ in observations]

def waits(observations):
    return [0 for _ in observations]
"""
DRIVERS = ("--driver", "python:a_cli_road.py:goes", "--driver", "calm=python:a_cli_road.py:waits")


@pytest.fixture(autouse=True)
def code_of_a_user(tmp_path, monkeypatch, as_a_user_runs_it):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a_cli_road.py").write_text(CODE)


def collect(out, *more, world="a_cli_road.py:make", drivers=DRIVERS):
    return main(["collect", world, *drivers, "--out", str(out), "--allow-code", *more])


def refused(capsys):
    line = capsys.readouterr().err
    assert line.startswith("socialiq: ") and line.count("\n") == 1
    return line


def test_each_driver_is_a_mode_on_the_same_episodes(tmp_path):
    assert collect(tmp_path / "data", "--episodes", "3", "--seed", "5") == 0
    data = files.load(tmp_path / "data")
    assert data.counts() == {"goes": (3, 6), "calm": (3, 12)}
    totals = data.totals()
    assert sorted(totals.env.tolist()) == [0, 0, 0, 2, 2, 2]
    assert sorted(totals.social.tolist()) == [-1, -1, -1, 0, 0, 0]
    drawn = data.observation[data.episode_starts, 1].reshape(2, 3)
    assert sorted(drawn[0]) == sorted(drawn[1])
    assert data.truncated.sum() == 3 and data.terminated.sum() == 3
    source = data.source["of"]["goes"]
    assert source["world"] == "a_cli_road.py:make" and len(source["sha256"]) == 64


def test_options_of_the_environment_are_given_and_recorded(tmp_path):
    assert collect(tmp_path / "short", "--set", "steps=3", "--episodes", "1") == 0
    data = files.load(tmp_path / "short")
    assert data.counts() == {"goes": (1, 2), "calm": (1, 3)}
    assert [source["options"] for source in data.source["of"].values()] == [{"steps": 3}] * 2


@pytest.mark.parametrize(
    ("options", "counts"),
    [
        (["--mixture", "weighted", "--weights", "1", "3"], {"goes": (1, 2), "calm": (3, 12)}),
        (["--mixture", "weighted"], {"goes": (2, 4), "calm": (2, 8)}),
        (
            ["--mixture", "equal_transitions", "--transitions", "8"],
            {"goes": (4, 8), "calm": (2, 8)},
        ),
        (
            [
                "--mixture",
                "contaminated",
                "--base",
                "calm",
                "--contaminant",
                "goes",
                "--share",
                "0.25",
            ],
            {"calm": (3, 12), "goes": (1, 2)},
        ),
    ],
)
def test_mixtures_are_those_of_the_gridworlds(tmp_path, options, counts):
    assert collect(tmp_path / "data", "--episodes", "4", *options) == 0
    assert files.load(tmp_path / "data").counts() == counts


@pytest.mark.parametrize(
    ("changed", "more", "line"),
    [
        ({"drivers": ()}, (), "name the drivers, one --driver for each mode"),
        ({"drivers": DRIVERS[:2] * 2}, (), "two drivers are called goes: write NAME=python:"),
        ({"world": "a_cli_road.py:bare"}, (), "gives no reward pair"),
        ({"world": "a_cli_road.py:none"}, (), "has no function and registers no 'none'"),
        ({}, ("--clock",), "leave out --clock"),
        ({}, ("--mixture", "weighted", "--weights", "1", "2", "3"), "give each mode one"),
        ({}, ("--mixture", "contaminated"), "unknown mode 'prosocial': choose one of goes, calm"),
        ({"drivers": ("--driver", "none.zip")}, (), "no such file"),
    ],
)
def test_mistakes_are_told_in_one_line(tmp_path, capsys, changed, more, line):
    assert collect(tmp_path / "data", "--episodes", "2", *more, **changed) == 2
    assert line in refused(capsys)
    assert not (tmp_path / "data").exists()


def test_code_is_run_only_if_that_is_allowed(tmp_path, capsys):
    policy = tmp_path / "policy.safetensors"
    QPolicy((np.eye(2, dtype=np.float32),), (np.zeros(2, np.float32),), "relu", 1.0).save(policy)
    world = ["--world", "a_cli_road.py:make"]
    for command in (
        ["collect", "a_cli_road.py:make", "--driver", str(policy), "--out", "data"],
        ["evaluate", str(policy), *world, "--episodes", "2"],
        ["profile", "new", *world, "--angle", "0"],
    ):
        assert main(command) == 2
        assert "--allow-code" in refused(capsys)


@pytest.mark.slow
def test_train_and_evaluate_see_pair_and_time_limit(tmp_path, capsys):
    assert collect(tmp_path / "data", "--episodes", "3") == 0
    world = ["--world", "a_cli_road.py:make", "--allow-code"]
    tiny = ["--updates", "5", "--set", "batch_size=8", "--hidden", "4"]
    assert main(["train", "iq-learn", "data", *world, *tiny, "--out", "run"]) == 0
    offline = ["--value-term", "value_expert", "--out", "offline"]
    assert main(["train", "iq-learn", "data", *tiny, *offline]) == 0
    capsys.readouterr()
    assert main(["evaluate", "run/policy_angle0.safetensors", *world, "--episodes", "2"]) == 0
    capsys.readouterr()
    goes = ["evaluate", "python:a_cli_road.py:goes", *world, "--episodes", "3", "--json"]
    assert main(goes) == 0
    shown = json.loads(capsys.readouterr().out)
    assert (shown["r_env"], shown["r_social"], shown["arrival"]) == (2.0, -1.0, 1.0)
    calm = ["evaluate", "python:a_cli_road.py:waits", *world, "--episodes", "3", "--json"]
    assert main(calm) == 0
    assert json.loads(capsys.readouterr().out)["timeout"] == 1.0
    other = ["--world", "CartPole-v1", "--out", "other"]
    assert main(["train", "iq-learn", "data", *tiny, *other]) == 2
    assert "they belong to another world" in refused(capsys)


def test_evaluate_scores_policies_and_a_rule_on_the_same_episodes(capsys):
    rules = ["python:a_cli_road.py:waits", "python:a_cli_road.py:goes", "random"]
    command = ["evaluate", *rules, "--world", "a_cli_road.py:make", "--allow-code"]
    assert main(["--json", *command, "--episodes", "20", "--angle", "60"]) == 0
    waits, goes, drawn = json.loads(capsys.readouterr().out)["policies"]
    assert (waits["policy"], goes["policy"], drawn["policy"]) == (*rules,)
    assert goes["score"] == pytest.approx(2 * 0.5 - 1 * 0.75**0.5, abs=1e-6)
    assert goes["best"] and not waits["best"] and waits["score"] == 0.0
    assert waits["below_best"] == waits["below_best_low"] == goes["score"]
    assert drawn["score_low"] < drawn["score"] < drawn["score_high"]
    gap = goes["score"] - drawn["score"]
    assert drawn["below_best"] == pytest.approx(gap, abs=2e-6)


def test_a_profile_takes_its_margin_from_references_and_asks_for_no_missing_ending(capsys):
    (Path("quiet.py")).write_text(CODE.replace('{"ending": "arrival"}', "{}"))
    for world, arrival in (("a_cli_road.py:make", 0.8), ("quiet.py:make", 0.0)):
        new = ["profile", "new", "--world", world, "--angle", "0", "--allow-code", "--replace"]
        assert main(new) == 2
        assert f"no margin is known in {world}: add --margin" in refused(capsys)
        names = ("--reference", "python:a_cli_road.py:goes")
        assert main([*new, *names, "--reference", "python:a_cli_road.py:waits"]) == 0
        declared = reader.load(Path("profile.toml"))
        assert declared.margin.regret == 1.0 and declared.competence.min_arrival == arrival
        assert ("vehicle" in declared.source.decode()) == (arrival > 0)
        capsys.readouterr()


def test_a_training_is_compared_with_its_demonstrators(tmp_path, capsys):
    assert collect(tmp_path / "data", "--episodes", "8") == 0
    capsys.readouterr()
    quick = ["data", "--out", "run", "--hidden", "8", "--set", "critic_factor=1"]
    assert main(["train", "offline-dial", *quick, "--updates", "500"]) == 0
    line = capsys.readouterr().err.splitlines()[-1]
    assert re.fullmatch(
        r"score at 45 degrees \(fitted Q evaluation of data\): trained [-.\de]+, "
        r"best demonstrator \(goes\) 0\.707\d?, weighted cloning [-.\de]+",
        line,
    )
    assert main(["train", "cql", "data", "--out", "short", "--updates", "20"]) == 0
    line = capsys.readouterr().err.splitlines()[-1]
    assert line == "no score: --updates 20 are fewer than 500"


@pytest.mark.parametrize("silent", [True, False])
@pytest.mark.parametrize("learner", ["dial", "sac"])
def test_an_angle_that_nothing_teaches_is_told_before_the_training(
    learner, silent, tmp_path, capsys
):
    pair = "(1.0, -1.0 * (drawn.random() < (0.0 if SILENT else 0.02)))"
    code = CODE.replace("(float(step.action), -0.5 * step.action)", pair)
    code = code.replace("SILENT", str(silent)) + "drawn = np.random.default_rng(0)\n"
    if learner == "sac":
        code = code.replace("spaces.Discrete(2)", "spaces.Box(-1.0, 1.0, (1,), np.float32)")
        code = code.replace("self.place += action", "self.place += int(action[0] > 0)")
    (tmp_path / "a_quiet_road.py").write_text(code)
    words = ["train", learner, "--world", "a_quiet_road.py:make", "--allow-code", "--out", "run"]
    small = {"dial": ["replay_batch=4"], "sac": ["updates_per_round=2", "--angle", "45"]}
    words += ["--updates", "2", "--hidden", "4", "--set", *small[learner]]
    assert main(words) == 0
    line = "r_social was 0 in 1,000 steps of random actions: if it is always 0, the angle teaches"
    assert (line in capsys.readouterr().err) == silent


BESIDE = CODE.replace(
    'return self.seen(), 0.0, self.place == 2, False, {"ending": "arrival"}',
    """self.queue -= not action
        info = {"ending": "arrival", "others": OTHERS}
        return self.seen(), 0.0, self.place == 2, self.queue == 0, info

    def without_ego(self):
        alone = Road()
        alone.place, alone.drawn, alone.queue, alone.step = 0, 0.0, self.queue, alone.passes
        return alone

    def passes(self, _):
        self.queue -= 1
        return self.seen(), 0.0, False, self.queue == 0, {"others": 1.0}""",
).replace("self.place, self.drawn = 0,", "self.queue, self.place, self.drawn = 3, 0,")


@pytest.mark.parametrize("others", ["1 - action", "None"])
def test_effects_of_an_environment_that_drives_without_the_ego(others, tmp_path, capsys):
    (tmp_path / "a_cli_road.py").write_text(BESIDE.replace("OTHERS", others))
    policies = ["--policy", "python:a_cli_road.py:goes", "--policy", "python:a_cli_road.py:waits"]
    words = ["effects", "a_cli_road.py:make", *policies, "--episodes", "4", "--allow-code"]
    if others == "None":
        assert main([*words, "--out", "caused"]) == 2
        assert "must be the progress of others in the step: a number" in refused(capsys)
        assert not (tmp_path / "caused").exists()
        return
    assert main([*words, "--out", "caused", "--json"]) == 0
    goes, waits = json.loads(capsys.readouterr().out)["drivers"]
    assert (goes["delay"], waits["delay"]) == (2.0, 0.0)
    assert (goes["r_caused"], goes["arrival"], waits["arrival"]) == (-1.0, 1.0, 0.0)
    assert {path.name for path in (tmp_path / "caused").iterdir()} == {
        "effects.csv",
        "effects.json",
        "episodes.csv",
    }


SMALL = ("--updates", "2", "--hidden", "4")


@pytest.mark.slow
def test_dials_are_trained_and_driven(tmp_path, capsys):
    """In the environment, from its demonstrations there, and from their file alone."""
    assert collect(tmp_path / "data", "--episodes", "4") == 0
    own = ("--world", "a_cli_road.py:make", "--allow-code")
    trainings = {
        "acting": ["dial", *own, "--set", "replay_batch=4"],
        "there": ["offline-dial", "data", *own],
        "alone": ["offline-dial", "data"],
    }
    for name, words in trainings.items():
        assert main(["train", *words, *SMALL, "--out", name]) == 0
        policy = ("--policy", f"{name}/dial_0.safetensors", "--every", "90")
        capsys.readouterr()
        words = ["dial", "a_cli_road.py:make", *policy, "--episodes", "2", "--allow-code", "--json"]
        assert main(words) == 0
        rows = json.loads(capsys.readouterr().out)["angles"]
        assert [row["angle"] for row in rows] == [0, 90]
        assert all(row["r_social"] == -0.5 * row["r_env"] for row in rows)
    sha256s = [
        json.loads((tmp_path / name / "run.json").read_text())["dials"][0]["sha256"]
        for name in ("there", "alone")
    ]
    assert sha256s[0] == sha256s[1]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("train dial --world a_cli_road.py:make --out run", "--allow-code"),
        (
            "train dial --world a_cli_road.py:make --preset online --allow-code --out run",
            "choose environment, online-clockless, offline",
        ),
        (
            "train dial --world a_cli_road.py:bare --updates 2 --hidden 4 --allow-code --out run",
            "the environment gives no reward pair",
        ),
        ("dial a_cli_road.py:make --policy driver", "--allow-code"),
        ("dial a_cli_road.py:make --policy driver --allow-code", "name another policy"),
        ("effects a_cli_road.py:make --policy python:a_cli_road.py:goes", "--allow-code"),
        (
            "effects a_cli_road.py:make --policy python:a_cli_road.py:goes --allow-code",
            "does not give: add a method without_ego",
        ),
        (
            "effects a_cli_road.py:make --policy random --allow-code --tow-after 3",
            "--tow-after is of a road as the world",
        ),
    ],
)
def test_dials_and_effects_that_an_environment_cannot_have(words, line, tmp_path, capsys):
    assert main(words.split()) == 2
    assert line in refused(capsys)
    assert not (tmp_path / "run").exists()
