"""`socialiq population` of a dial of two rules, and `socialiq stakeholders` on few episodes."""

import json

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.results_folder import from_csv

PEOPLE = "[passenger]\nweight = 1.0\nr_env = 1.0\n[others]\nweight = 2.0\ndelay = -1.0\n"


@pytest.fixture
def files(tmp_path):
    rows = ["policy,angle,seed,r_env,delay"]
    settings = ("dial.safetensors,0.0", 9, 8), ("dial.safetensors,45.0", 8, 4), ("wait,", 1, 60)
    for setting, r_env, delay in settings:
        rows += [f"{setting},{seed},{r_env + seed % 2},{delay - seed % 3}" for seed in range(30)]
    (tmp_path / "episodes.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "people.toml").write_text(PEOPLE)
    return [str(tmp_path / "episodes.csv"), "--utilities", str(tmp_path / "people.toml")]


def test_table_names_the_weights(files, capsys):
    assert main(["stakeholders", *files]) == 0
    out = capsys.readouterr().out
    assert "Choices with the weights passenger 1, others 2" in out
    assert "dial 45.0" in out
    assert "8.50 (8." in out  # of passenger at 45 degrees, with its interval


def test_json_and_folder_agree(files, tmp_path, capsys):
    assert main(["stakeholders", *files, "--out", str(tmp_path / "out"), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result == json.loads((tmp_path / "out" / "stakeholders.json").read_text())
    waits = result["settings"][2]
    assert waits["policy"] == "wait"
    assert waits["dominated"] == 1.0
    assert result["choices"][0]["weighted_sum"] == "dial 45.0"
    assert main(["stakeholders", *files, "--out", str(tmp_path / "out")]) == 2
    assert "remove it first" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--resamples", "3"], "--resamples 3"),
        (["--seed", "-1"], "seed"),
        (["--out", "."], "is no new place"),
    ],
)
def test_mistakes_are_one_line(files, words, says, capsys):
    assert main(["stakeholders", *files, *words]) == 2
    message = capsys.readouterr().err
    assert says in message
    assert len(message.splitlines()) == 1


def test_one_setting_is_refused(files, tmp_path, capsys):
    table = tmp_path / "episodes.csv"
    table.write_text("\n".join(table.read_text().splitlines()[:31]) + "\n")
    assert main(["stakeholders", *files]) == 2
    assert "has one setting" in capsys.readouterr().err


def rules(path, features, actions):
    """Write a dial that takes the last action at 0 degrees, and the first at 90."""
    weight = np.zeros((actions, features + 2), np.float32)
    weight[-1, -2] = weight[0, -1] = 1.0  # (cos α, sin α)
    network = QPolicy((weight,), (np.zeros(actions, np.float32),), "relu", 1.0)
    DialPolicy(network, 0.0, 90.0).save(path)
    return ["population", "--policy", str(path), "--angle", "0", "90", "--agents", "3"]


@pytest.fixture
def dial(tmp_path):
    """A dial that accelerates at 0 degrees and slows down at 90, by its angle alone."""
    return rules(tmp_path / "rules.safetensors", 70, 3)


def test_fleets_of_two_rules(dial, tmp_path, capsys):
    words = [*dial, "--episodes", "4", "--duration", "12", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "Fleets of 3, everybody at one angle" in out
    assert "What an invader (row) gets more" in out
    goes, waits = from_csv(tmp_path / "out" / "fleets.csv")
    assert waits["arrival"] == 0.0
    assert waits["timeout"] > goes["timeout"]
    rows = from_csv(tmp_path / "out" / "invasions.csv")
    assert [(row["resident"], row["invader"]) for row in rows] == [(0.0, 90.0), (90.0, 0.0)]
    assert rows[0]["gain"] < 0.0
    assert len(from_csv(tmp_path / "out" / "episodes.csv")) == 8
    assert (tmp_path / "out" / "population.png").read_bytes().startswith(b"\x89PNG")
    (tmp_path / "people.toml").write_text(PEOPLE.replace("delay = -1.0", "collision = -10.0"))
    people = ["--utilities", str(tmp_path / "people.toml")]
    assert main(["stakeholders", str(tmp_path / "out" / "episodes.csv"), *people]) == 0


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--angle", "0"], "two or more"),
        (["--angle", "0", "120"], "120"),
        (["--invaders", "3"], "leave no resident"),
        (["--episodes", "1"], "--episodes 1"),
        (["--agents", "20"], "at most 16"),
        (["--agents", "1", "--invaders", "1"], "leave no resident"),
        (["--policy", "x"], "unknown driver 'x'"),
        (["--spawn-probability", "2"], "spawn_probability"),
        (["--out", "."], "is no new place"),
    ],
)
def test_mistakes_of_fleets_are_one_line(dial, words, says, capsys, each_once):
    assert main(each_once(*dial, "--episodes", "2", *words)) == 2
    message = capsys.readouterr().err
    assert says in message
    assert len(message.splitlines()) == 1


def test_fleets_at_the_merge(dial, tmp_path, capsys, each_once):
    words = rules(tmp_path / "merge.safetensors", 35, 5)
    assert main([*words, "merge", "--episodes", "2", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["world"], result["duration"], result["spawn_probability"]) == ("merge", 40, None)
    slows, keeps_left = (row["seconds"] for row in result["fleets"])
    assert slows > keeps_left  # both by the angle alone
    for call, says in (
        ([*words, "merge", "--spawn-probability", "0.2"], "spawn_probability"),
        (["population", "merge", *words[1:], "--agents", "6"], "has 5 vehicles"),
        ([*dial, "merge"], "name another policy"),
    ):
        assert main(each_once(*call, "--episodes", "2")) == 2
        message = capsys.readouterr().err
        assert says in message and len(message.splitlines()) == 1
