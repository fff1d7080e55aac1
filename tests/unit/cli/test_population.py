"""`socialiq stakeholders` on a small file of episodes."""

import json

import pytest

from socialiq.cli.main import main

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
