"""`train iq-learn` takes the preset of its world, or of its demonstrations'."""

import json
from pathlib import Path

import pytest

from socialiq.cli.main import main


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    file = tmp_path_factory.mktemp("data") / "mixed.safetensors"
    arguments = ["--driver", "go", "--driver", "wait", "--episodes", "2", "--out", str(file)]
    assert main(["collect", "intersection", *arguments]) == 0
    return file


@pytest.mark.parametrize(
    ("preset", "kind", "temperature"),
    [((), "instantaneous", 0.1), (("--preset", "intersection-thesis"), "running", 1.0)],
)
def test_the_intersection_has_its_own_preset(mixed, tmp_path, preset, kind, temperature):
    out = tmp_path / "run"
    run = ["train", "iq-learn", str(mixed), "--world", "intersection", "--angle", "0", *preset]
    assert main([*run, "--updates", "1", "--out", str(out)]) == 0
    record = json.loads((out / "run.json").read_text())
    assert record["structure"]["target_kind"] == kind
    assert record["numbers"][0]["temperature"] == temperature


def trained(data, *words):
    assert main(["train", "iq-learn", str(data), "--updates", "1", *words, "--out", "run"]) == 0
    return json.loads(Path("run/run.json").read_text())["structure"]


def test_another_road_has_the_preset_of_roads(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["--driver", "go", "--episodes", "2", "--out", "merge.safetensors"]
    assert main(["collect", "merge", *words]) == 0
    assert trained("merge.safetensors", "--world", "merge")["hidden"] == [256, 256]


def test_offline_the_demonstrations_name_the_world(mixed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    structure = trained(mixed)
    assert (structure["hidden"], structure["target_kind"]) == ([256, 256], "instantaneous")
    assert (structure["online"], structure["value_term"]) == (False, "value_expert")
