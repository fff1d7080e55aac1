import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from tests.extras.recorded_world.conftest import crossing_road, tracks

from socialiq.cli.main import main
from socialiq.demonstrations import files as demonstration_files
from socialiq.errors import UserError
from socialiq_recordings import files
from socialiq_recordings.recording import Recording
from socialiq_recordings.road.network import RoadNetwork, Sign


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("worlds")
    files.save(made / "crossing.safetensors", Recording(tracks(), crossing_road()))
    files.save(made / "roadless.safetensors", Recording(tracks(), RoadNetwork()))
    return made


def test_a_recording_becomes_a_world_that_a_policy_is_evaluated_in(folder, tmp_path, capsys):
    out, data = tmp_path / "world.safetensors", tmp_path / "human.safetensors"
    words = ["data", "world", str(folder / "crossing.safetensors"), "--out", str(out)]
    more = ["--demonstrations", str(data), "--report", str(tmp_path / "report"), "--repeats", "1"]
    assert main([*words, *more, "--json"]) == 0
    made = json.loads(capsys.readouterr().out)
    assert made["vehicles"] == made["egos"] == 3
    row = {"road_user": "car", "read": 3, "used": 3, "left_out": 0, "why": ""}
    assert made["road_users"][-1] == row
    assert made["demonstrations"]["residual_rms"] == pytest.approx(0.0, abs=1e-6)
    assert demonstration_files.load(data).n_actions == 6
    assert (tmp_path / "report" / "compared.png").stat().st_size > 1000
    assert "speeds" in (tmp_path / "report" / "compared.csv").read_text()
    assert main([*words, "--json"]) == 2  # it exists
    assert "exists already" in capsys.readouterr().err
    driver = "python:tests.extras.recorded_world.test_command:idle"
    call = ["evaluate", driver, "--allow-code", "--world", str(out), "--episodes", "3", "--json"]
    assert main(call) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["arrival"] + found["collision"] + found["timeout"] == pytest.approx(1.0)


def test_a_dial_of_a_world_learns_from_demonstrations_alone(folder, tmp_path, capsys):
    out, data = tmp_path / "world.safetensors", tmp_path / "human.safetensors"
    words = ["data", "world", str(folder / "crossing.safetensors"), "--out", str(out)]
    assert main([*words, "--demonstrations", str(data), "--json"]) == 0
    capsys.readouterr()
    call = [str(data), "--world", str(out), "--out", str(tmp_path / "run")]
    assert main(["train", "dial", *call]) == 2
    assert "`socialiq train offline-dial FILE --world" in capsys.readouterr().err
    tiny = ["--updates", "2", "--hidden", "4", "--json"]
    assert main(["train", "offline-dial", *call, *tiny]) == 0
    assert (tmp_path / "run" / "dial_0.safetensors").is_file()
    call[-1] = str(tmp_path / "practised")
    assert main(["train", "practised-dial", *call, *tiny, "--rounds", "1", "--episodes", "2"]) == 0
    capsys.readouterr()
    record = json.loads((tmp_path / "practised" / "run.json").read_text())
    assert record["practice"]["rounds"] == 1
    assert record["practice"]["episodes"] == 2
    dial = tmp_path / "practised" / "dial_0.safetensors"
    assert dial.read_bytes() != (tmp_path / "run" / "dial_0.safetensors").read_bytes()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--rounds", "-1"], "rounds of practice must be 0 or more"),
        (["--rounds", "1", "--episodes", "0"], "episodes must be at least 1"),
        (["--rounds", "1", "--first-seed", "-5"], "seed must lie in"),
    ],
)
def test_practice_of_no_size_is_refused(folder, tmp_path, capsys, words, said):
    out, data = tmp_path / "world.safetensors", tmp_path / "human.safetensors"
    made = ["data", "world", str(folder / "crossing.safetensors"), "--out", str(out)]
    assert main([*made, "--demonstrations", str(data), "--json"]) == 0
    capsys.readouterr()
    call = ["train", "practised-dial", str(data), "--world", str(out)]
    assert main([*call, "--out", str(tmp_path / "run"), *words]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_lights_whose_states_are_not_used_are_named(tmp_path, capsys):
    lanes = crossing_road().lanelets
    lit = {**lanes, 1: dataclasses.replace(lanes[1], sign=Sign.LIGHT)}
    files.save(tmp_path / "lit.safetensors", Recording(tracks(), RoadNetwork(lit)))
    out = tmp_path / "world.safetensors"
    assert main(["data", "world", str(tmp_path / "lit.safetensors"), "--out", str(out)]) == 0
    said = capsys.readouterr().err
    assert said.count("ZAM_Made-1_1_T-1 has traffic lights, whose states are not used") == 1


def test_a_report_that_fails_leaves_no_file(folder, tmp_path, monkeypatch, capsys):
    def fails(*_given):
        raise UserError("no traffic")

    monkeypatch.setattr("socialiq_recordings.world.compare.simulate", fails)
    words = ["data", "world", str(folder / "crossing.safetensors"), "--out", str(tmp_path / "w")]
    more = ["--demonstrations", str(tmp_path / "d"), "--report", str(tmp_path / "report")]
    assert main([*words, *more]) == 2
    assert capsys.readouterr().err.endswith("socialiq: no traffic\n")
    assert list(tmp_path.iterdir()) == []


def idle(observation):
    """Return the action that changes nothing, for each observation."""
    return np.full(len(observation), 3)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["roadless.safetensors"], "no road: name its map with --road"),
        (["crossing.safetensors", "--policy-rate", "3"], "policy rate must be 1, 2, 5 or 10"),
        (["crossing.safetensors", "--levels", "1", "2"], "levels must have 0 among them"),
        (["crossing.safetensors", "--every", "2"], "--every must be 0 to one decision"),
        (["crossing.safetensors", "--repeats", "0"], "--repeats must be from 1 to 100"),
        (["crossing.safetensors", "crossing.safetensors"], "give each only once"),
        (["nowhere.safetensors"], "nowhere"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(folder, tmp_path, capsys, words, line):
    paths = [str(folder / word) if word.endswith(".safetensors") else word for word in words]
    assert main(["data", "world", *paths, "--out", str(tmp_path / "new")]) == 2
    written = capsys.readouterr().err
    assert line in written and written.count("\n") == 1
    assert not (tmp_path / "new").exists()
