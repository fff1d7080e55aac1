"""Mistakes in a training with continuous actions: one line each, status 2, nothing written."""

from pathlib import Path

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
def data(tmp_path_factory) -> Path:
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
        (["--learner", "cql"], "choose one of iq-learn, sac, td3-bc, behaviour-cloning"),
        (["--learner", "sac"], "sac learns from no demonstrations"),
        (["--learner", "td3-bc", "--world", "Pendulum-v1"], "takes no world"),
        (["--learner", "td3-bc", "--tuned", "True"], "no temperature to tune"),
        (["--learner", "td3-bc", "--divergence", "js"], "this learner has no 'divergence'"),
        (["--learner", "behaviour-cloning", "--world", "Pendulum-v1"], "leave --world out"),
        (["--preset", "few-offline"], "choose intersection-continuous, or leave --preset out"),
        (["--learner", "td3-bc", "--preset", PRESET], "is of sac and iq-learn, not of td3-bc"),
        (["--world", "Pendulum-v1", "--preset", PRESET], "is not for Pendulum-v1: choose inter"),
        (["--loss", "mine.py:mine"], "leave it out"),
        (["--prior", "mine.py:mine"], "is for Python"),
        (["--view", "set", "--value-term", "value_expert"], "use the view flat"),
        (["--standardise", "--view", "set", "--value-term", "value_expert"], "leave --standardise"),
        (["--standardise", "--world", "intersection-continuous"], "leave --standardise out"),
        (["--standardise", "--world", "MountainCarContinuous-v0"], "belong to another world"),
        (["--learner", "sac", "--standardise"], "by demonstrations or a world"),
        (["--leave-out", "1", "--value-term", "value_expert"], "add --standardise"),
        (["--leave-out", "3", *OFFLINE], "no feature 3 to leave out: they are 0 to 2"),
        (["--leave-out", "-1", *OFFLINE], "no feature -1 to leave out"),
        (["--leave-out", "2", "0", "1", *OFFLINE], "every feature is left out"),
        ([], "value term 'value' needs the learner's own transitions"),
        (["--world", "crossing7"], "has discrete actions"),
        (["--world", "CartPole-v1"], "has discrete actions"),
        (["--world", "MountainCarContinuous-v0"], "they belong to another world"),
        (["--value-term", "value_expert", "--dial", "True", "--angle", "45"], "leave the angle"),
    ],
)
def test_mistakes_are_refused(words, says, data, tmp_path, capsys) -> None:
    out = tmp_path / "run"
    given = [] if "sac" in words and "no dem" not in says else [str(data)]
    assert main(["train", *given, *words, "--out", str(out)]) == 2
    line = capsys.readouterr().err
    assert says in line and line.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["train", "--out", "run"], "only --learner sac learns without"),
        (["train", "--learner", "sac", "--out", "run"], "online training needs a world"),
        (["train-dial", "crossing7", "--data", "DATA", "--out", "run"], "has continuous actions"),
        (["evaluate", "p.safetensors", "--data", "DATA"], "has continuous actions"),
    ],
)
def test_other_commands_say_what_they_take(words, says, data, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([str(data) if word == "DATA" else word for word in words]) == 2
    line = capsys.readouterr().err
    assert says in line and line.count("\n") == 1


def test_options_of_continuous_actions_are_refused_with_discrete_ones(tmp_path, capsys) -> None:
    path = tmp_path / "mixed.safetensors"
    assert main(["collect", "crossing5", "--episodes", "1", "--out", str(path)]) == 0
    capsys.readouterr()
    words = ["train", str(path), "--dial", "True", "--out", str(tmp_path / "run")]
    assert main(words) == 2
    assert "--dial is of continuous actions" in capsys.readouterr().err


def test_standardise_is_of_continuous_actions(tmp_path, capsys) -> None:
    path = tmp_path / "mixed.safetensors"
    assert main(["collect", "crossing5", "--episodes", "1", "--out", str(path)]) == 0
    capsys.readouterr()
    for option in (["--standardise"], ["--leave-out", "1"]):
        assert main(["train", str(path), *option, "--out", str(tmp_path / "run")]) == 2
        assert "--standardise and --leave-out are of continuous" in capsys.readouterr().err


@pytest.mark.parametrize("more", [[], ["--world", "Pendulum-v1", "--updates-per-round", "20"]])
def test_standardised_policies_take_observations_as_they_are(more, data, tmp_path) -> None:
    out = tmp_path / "run"
    words = ["--standardise", "--updates", "20", "--hidden", "8", "--batch-size", "4"]
    words += more or ["--value-term", "value_expert"]
    assert main(["train", str(data), *words, "--random-steps", "0", "--out", str(out)]) == 0
    policy = ActorPolicy.load(out / "policy_0.safetensors")
    record, seen = policy.provenance["standardised"], files.load(data, continuous=True).observation
    assert record["mean"] == pytest.approx(seen.mean(axis=0), abs=1e-6)
    assert record["deviation"] == pytest.approx(seen.std(axis=0) + 1e-3, rel=1e-5)
    first = np.abs(policy.weights[0] * np.array(record["deviation"]))
    assert first.max() < 1.0  # near its first range of 1/sqrt(3)


def test_features_that_are_left_out_do_not_change_a_policy(data, tmp_path) -> None:
    out = tmp_path / "run"
    words = ["--learner", "behaviour-cloning", "--standardise", "--leave-out", "0", "2"]
    small = ["--updates", "20", "--hidden", "8", "--batch-size", "4", "--out", str(out)]
    assert main(["train", str(data), *words, *small]) == 0
    policy = ActorPolicy.load(out / "policy_0.safetensors")
    assert (policy.weights[0][:, [0, 2]] == 0.0).all() and policy.weights[0][:, 1].all()
    assert [one is None for one in policy.provenance["standardised"]["deviation"]] == [
        True,
        False,
        True,
    ]
