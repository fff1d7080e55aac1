"""The page from inD's folder to a driven, audited policy, on a crossing made by hand."""

import json
import re
import shlex
from pathlib import Path

import pytest

pytest.importorskip("lanelet2", reason="extra `lanelet2` is not installed")

from tests.extras.recorded_world.crossing_files import crossing_map, ind_files, interaction_files
from tests.extras.recorded_world.test_audit import waiting

from socialiq.cli.main import main, parse

PAGE = Path(__file__).parents[3] / "docs" / "recordings.md"


def test_every_command_of_the_page_parses():
    lines = re.findall(r"^\$ (socialiq .*)$", PAGE.read_text(), re.MULTILINE)
    assert len(lines) >= 10
    for line in lines:
        assert parse(shlex.split(line)[1:]) is not None


@pytest.mark.parametrize("kind", ["ind", "interaction"])
def test_files_and_their_map_become_a_world_that_is_audited(tmp_path, monkeypatch, capsys, kind):
    monkeypatch.chdir(tmp_path)
    if kind == "ind":
        states = [ind_files(tmp_path, 7), ind_files(tmp_path, 8)]
    else:
        states = [interaction_files(tmp_path)]
    road = "location2.osm" if kind == "ind" else "map.osm"
    words = [str(path) for path in states]
    ask = ["data", "import", "csv", *words, "--columns", kind, "--road", road, "--out", "made"]
    assert main([*ask, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["recordings"]
    assert [one["tracks"] for one in told] == [8] * len(states)
    found = [str(path) for path in sorted(Path("made").glob("*.safetensors"))]
    assert main(["data", "world", *found, "--out", "world.safetensors", "--json"]) == 0
    made = json.loads(capsys.readouterr().out)
    assert made["vehicles"] == made["egos"] == 8 * len(states)
    new = ["profile", "new", "--world", "world.safetensors", "--angle", "45", "--margin", "0.5"]
    assert main(new) == 0
    waiting(tmp_path / "world.safetensors").save(tmp_path / "p.safetensors")
    call = ["audit", "p.safetensors", "--profile", "profile.toml", "--episodes", "40"]
    capsys.readouterr()
    assert main([*call, "--seed", "50000000", "--out", "audit", "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    means = {one["name"]: one for one in report["references"]}
    assert means["driver"]["arrival"] > 0.9 > means["wait"]["arrival"]


def test_a_map_of_another_place_is_one_line(tmp_path, monkeypatch, capsys):
    """INTERACTION's tracks on inD's map, whose frame is another."""
    monkeypatch.chdir(tmp_path)
    states = interaction_files(tmp_path)
    crossing_map(tmp_path / "location2.osm", "ind")
    ask = ["data", "import", "csv", str(states), "--columns", "interaction", "--out", "made"]
    code = main([*ask, "--road", "location2.osm", "--json"])
    if code == 0:
        found = [str(path) for path in sorted(Path("made").glob("*.safetensors"))]
        capsys.readouterr()
        code = main(["data", "world", *found, "--out", "world.safetensors", "--json"])
    written = capsys.readouterr().err
    assert code == 2 and written.count("\n") == 1
    assert "is --road the map of this recording" in written
