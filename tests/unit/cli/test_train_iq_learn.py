"""`train iq-learn` takes the preset of its world."""

import json

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
