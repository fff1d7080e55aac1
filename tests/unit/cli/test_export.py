import json
from pathlib import Path

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.nn.ensemble import load_values
from socialiq.nn.q_policy import QPolicy


@pytest.fixture(name="files")
def two_policies(tmp_path):
    """Two policies of crossing5 without layers between, which prefer different actions."""
    paths = []
    for number, bias in enumerate(([0.0, 2.0, 3.0, 0.0, 0.0], [3.0, 2.0, 0.0, 0.0, 0.0])):
        weight = np.zeros((5, 4), np.float32)
        policy = QPolicy((weight,), (np.array(bias, np.float32),), "relu", 1.0, {"seed": number})
        paths.append(tmp_path / f"policy_{number}.safetensors")
        policy.save(paths[-1])
    return [str(path) for path in paths]


def test_ensemble_is_written_as_one_policy(files, tmp_path, capsys):
    out = tmp_path / "mean.safetensors"
    assert main(["ensemble", *files, "--out", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    policy = load_values(out)
    assert found["members"] == 2 and found["sha256"] == policy.sha256
    assert policy.predict(np.zeros(4))[0] == 1


def test_card_lists_the_networks_of_an_ensemble(files, tmp_path):
    out, card = tmp_path / "mean.safetensors", tmp_path / "card.md"
    assert main(["ensemble", *files, "--out", str(out)]) == 0
    assert main(["export", str(out), "--format", "card", "--out", str(card)]) == 0
    assert "mean of the values of 2: 4-5, relu" in card.read_text()


def test_ensemble_of_one_file_is_refused(files, tmp_path, capsys):
    assert main(["ensemble", files[0], "--out", str(tmp_path / "x.safetensors")]) == 2
    assert "at least two files" in capsys.readouterr().err


def test_a_folder_for_a_hub_has_the_policy_and_its_card(files, tmp_path, capsys):
    out = tmp_path / "hub"
    command = ["export", files[0], "--format", "hub", "--out", str(out)]
    assert main(command) == 0
    assert {path.name for path in out.iterdir()} == {"README.md", "policy.safetensors"}
    policy = load_values(out / "policy.safetensors")
    assert policy.sha256 == load_values(Path(files[0])).sha256
    assert f"{policy.sha256}" in (out / "README.md").read_text()
    capsys.readouterr()
    assert main(command) == 2 and "exists already" in capsys.readouterr().err
