"""The intersection with continuous actions from the command line: train, collect, evaluate."""

import json

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.demonstrations import files
from socialiq.nn.actor_policy import ActorDial

WORLD = "intersection-continuous"
SMALL = ("--hidden", "8", "--set", "batch_size=8", "--updates", "2", "--set", "updates_per_round=2")

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


@pytest.fixture(scope="module")
def dial(tmp_path_factory):
    out = tmp_path_factory.mktemp("dial") / "run"
    words = ["train", "sac", "--world", WORLD, "--set", "dial=true", "times=20"]
    assert main([*words, "--set", "view=set", *SMALL, "--out", str(out)]) == 0
    return out / "dial_0.safetensors"


def test_a_dial_of_the_core_sees_the_time_and_is_evaluated_at_an_angle(dial, capsys):
    assert (ActorDial.load(dial).n_features, ActorDial.load(dial).action_size) == (71, 1)
    found = []
    for words in ((), ("--angle", "45")):
        given = ["evaluate", str(dial), "--world", WORLD, "--episodes", "8", *words, "--json"]
        assert main(given) == 0
        found.append(json.loads(capsys.readouterr().out))
    assert found[0]["episodes"] == 8 and "at_fault_per_conflict" in found[0]
    assert found[0]["collision"] + found[0]["arrival"] + found[0]["timeout"] == pytest.approx(1.0)


@pytest.mark.slow
def test_drivers_are_collected_with_the_time_and_learned_from(dial, tmp_path, capsys):
    data = tmp_path / "drives.safetensors"
    words = ["collect", WORLD, "--driver", f"one={dial}", "--episodes", "3", "--clock"]
    assert main([*words, "--out", str(data)]) == 0
    table = files.load(data, continuous=True)
    assert table.n_episodes == 3 and (table.n_features, table.action_size) == (71, 1)
    starts = table.episode_starts
    np.testing.assert_array_equal(table.observation[starts, -1], 0.0)
    words = [
        "train",
        "iq-learn",
        str(data),
        "--world",
        WORLD,
        "--set",
        "times=20",
        "--set",
        "view=set",
        *SMALL,
    ]
    assert main([*words, "--angle", "0", "90", "--out", str(tmp_path / "run")]) == 0
    assert (tmp_path / "run" / "policy_1.safetensors").is_file()
    capsys.readouterr()
    other = ("--world", f"{WORLD}-steering", "--out", str(tmp_path / "other"))
    assert main(["train", "iq-learn", str(data), *SMALL, *other]) == 2
    assert "they belong to another world" in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["evaluate", "DIAL", "--world", WORLD], "add --episodes N"),
        (["evaluate", "DIAL", "--world", f"{WORLD}-steering", "--episodes", "2"], "action"),
        (
            ["evaluate", "atlas:no_such", "--world", WORLD, "--episodes", "2"],
            "unknown policy of the atlas 'no_such': choose one of expert_egoistic",
        ),
        (
            ["evaluate", "expert_nobody", "--world", WORLD, "--episodes", "2"],
            "unknown driver 'expert_nobody': choose one of go, idle",
        ),
        (["evaluate", "no.safetensors", "--world", WORLD, "--episodes", "2"], "no.safetensors"),
        (["evaluate", "DIAL", "--world", "intersection", "--episodes", "2"], "DIAL"),
        (["collect", WORLD, "--out", "x.safetensors"], "name the drivers"),
    ],
)
def test_mistakes_are_one_line(words, says, dial, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given = [str(dial) if word == "DIAL" else word for word in words]
    assert main(given) == 2
    line = capsys.readouterr().err
    assert says.replace("DIAL", str(dial)) in line and line.count("\n") == 1


def test_episodes_are_split_among_processes(capsys):
    rows = []
    for processes in ("0", "2"):
        words = ["--world", f"{WORLD},late", "--episodes", "9", "--processes", processes]
        assert main(["evaluate", "atlas:expert_prosocial", *words, "--json"]) == 0
        rows.append(json.loads(capsys.readouterr().out))
    assert rows[0] == rows[1]


def test_an_expert_of_the_atlas_is_drawn(tmp_path):
    out = tmp_path / "drive.png"
    words = ["render", WORLD, "--driver", "expert_egoistic", "--seed", "3", "--out", str(out)]
    assert main(words) == 0 and out.stat().st_size > 1000


def test_in_a_world_of_discrete_actions_it_is_refused(dial, capsys):
    assert main(["evaluate", str(dial), "--world", "crossing7"]) == 2
    line = "the world has 6 and 3 discrete actions"
    assert capsys.readouterr().err.count(line) == 1
