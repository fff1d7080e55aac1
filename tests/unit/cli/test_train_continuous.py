"""Mistakes in a training with continuous actions: one line each, status 2, nothing written."""

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.types import RewardPair

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


PRESET = "intersection-continuous"


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "drives.safetensors"
    rng = np.random.default_rng(0)
    table = Demonstrations.of(
        observation=rng.normal(size=(20, 3)),
        action=rng.uniform(-1, 1, (20, 1)),
        next_observation=rng.normal(size=(20, 3)),
        ending=np.tile([0] * 9 + [3], 2),
        rewards=RewardPair(rng.normal(size=20), rng.normal(size=20)),
        episode=np.repeat([0, 1], 10),
        n_actions=0,
    )
    files.save(path, table)
    return path


OFFLINE = ("--standardise", "--value-term", "value_expert")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["cql"], "has continuous actions"),
        (["td3-bc", "--world", "Pendulum-v1"], "unknown option --world"),
        (["td3-bc", "--set", "tuned=true"], "no temperature to tune"),
        (["td3-bc", "--set", "divergence=js"], "there is no setting divergence: choose one of"),
        (["behaviour-cloning", "--world", "Pendulum-v1"], "unknown option --world"),
        (["--preset", "few-offline"], "choose intersection-continuous, or leave --preset out"),
        (["td3-bc", "--preset", PRESET], "unknown option --preset"),
        (["--world", "Pendulum-v1", "--preset", PRESET], "is not for Pendulum-v1: choose inter"),
        (["--loss", "mine.py:mine"], "leave it out"),
        (["--prior", "mine.py:mine"], "is for Python"),
        (["--set", "view=set", "--value-term", "value_expert"], "use the view flat"),
        (
            ["--standardise", "--set", "view=set", "--value-term", "value_expert"],
            "leave --standardise",
        ),
        (["--standardise", "--world", "intersection-continuous"], "leave --standardise out"),
        (["--standardise", "--world", "MountainCarContinuous-v0"], "belong to another world"),
        (["sac", "--standardise"], "by demonstrations or a world"),
        (["--leave-out", "1", "--value-term", "value_expert"], "add --standardise"),
        (["--leave-out", "3", *OFFLINE], "no feature 3 to leave out: they are 0 to 2"),
        (["--leave-out", "-1", *OFFLINE], "no feature -1 to leave out"),
        (["--leave-out", "2", "0", "1", *OFFLINE], "every feature is left out"),
        ([], "value term 'value' needs the learner's own transitions"),
        (["--world", "crossing7"], "has discrete actions"),
        (["--world", "CartPole-v1"], "has discrete actions"),
        (["--world", "MountainCarContinuous-v0"], "they belong to another world"),
        (
            ["--value-term", "value_expert", "--set", "dial=true", "--angle", "45"],
            "leave out --angle",
        ),
    ],
)
def test_mistakes_are_refused(words, says, data, tmp_path, capsys):
    out = tmp_path / "run"
    learner, options = ("iq-learn", words)
    if words and not words[0].startswith("-"):
        learner, *options = words
    file = [] if learner == "sac" else [str(data)]
    assert main(["train", learner, *file, *options, "--out", str(out)]) == 2
    line = capsys.readouterr().err
    assert says in line and line.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["train", "sac", "--out", "run"], "online training needs a world"),
        (
            ["train", "sac", "--world", "Pendulum-v1", "--angle", "0", "90", "--out", "run"],
            "without a pair only angle 0 has a meaning",
        ),
        (
            ["train", "dial", "DATA", "--world", "crossing7", "--out", "run"],
            "has continuous actions",
        ),
        (["evaluate", "p.safetensors", "--data", "DATA"], "has continuous actions"),
    ],
)
def test_other_commands_say_what_they_take(words, says, data, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([str(data) if word == "DATA" else word for word in words]) == 2
    line = capsys.readouterr().err
    assert says in line and line.count("\n") == 1


def test_options_of_continuous_actions_are_refused_with_discrete_ones(tmp_path, capsys):
    path = tmp_path / "mixed.safetensors"
    assert main(["collect", "crossing5", "--episodes", "1", "--out", str(path)]) == 0
    capsys.readouterr()
    words = ["train", "iq-learn", str(path), "--set", "dial=true", "--out", str(tmp_path / "run")]
    assert main(words) == 2
    assert "there is no setting dial" in capsys.readouterr().err


def test_standardise_is_of_continuous_actions(tmp_path, capsys):
    path = tmp_path / "mixed.safetensors"
    assert main(["collect", "crossing5", "--episodes", "1", "--out", str(path)]) == 0
    capsys.readouterr()
    for option in (["--standardise"], ["--leave-out", "1"]):
        assert main(["train", "iq-learn", str(path), *option, "--out", str(tmp_path / "run")]) == 2
        assert "--standardise and --leave-out are of continuous" in capsys.readouterr().err


ONLINE = ["--world", "Pendulum-v1", "--set", "updates_per_round=20"]


@pytest.mark.parametrize("more", [[], pytest.param(ONLINE, marks=pytest.mark.slow)])
def test_standardised_policies_take_observations_as_they_are(more, data, tmp_path):
    out = tmp_path / "run"
    words = ["--standardise", "--updates", "20", "--hidden", "8", "--set", "batch_size=4"]
    words += more or ["--value-term", "value_expert"]
    assert (
        main(["train", "iq-learn", str(data), *words, "--set", "random_steps=0", "--out", str(out)])
        == 0
    )
    policy = ActorPolicy.load(out / "policy_angle0.safetensors")
    record, seen = policy.provenance["standardised"], files.load(data, continuous=True).observation
    assert record["mean"] == pytest.approx(seen.mean(axis=0), abs=1e-6)
    assert record["deviation"] == pytest.approx(seen.std(axis=0) + 1e-3, rel=1e-5)
    first = np.abs(policy.weights[0] * np.array(record["deviation"]))
    assert first.max() < 1.0  # near its first range of 1/sqrt(3)


def test_features_that_are_left_out_do_not_change_a_policy(data, tmp_path):
    out = tmp_path / "run"
    words = ["--standardise", "--leave-out", "0", "2"]
    small = ["--updates", "20", "--hidden", "8", "--set", "batch_size=4", "--out", str(out)]
    assert main(["train", "behaviour-cloning", str(data), *words, *small]) == 0
    policy = ActorPolicy.load(out / "policy_0.safetensors")
    assert (policy.weights[0][:, [0, 2]] == 0.0).all() and policy.weights[0][:, 1].all()
    assert [one is None for one in policy.provenance["standardised"]["deviation"]] == [
        True,
        False,
        True,
    ]
