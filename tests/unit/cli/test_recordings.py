"""`socialiq data import`: what is written, what is printed, what is refused."""

import dataclasses
import json
from pathlib import Path

import pytest
from benchmarks.recordings import write_csv

from socialiq.cli.main import main
from socialiq_recordings import files

EXAMPLES = sorted((Path(__file__).parents[3] / "examples" / "recordings").glob("*.xml"))


def refused(capsys, *arguments):
    assert main(["data", "import", *map(str, arguments)]) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1
    return said.err


def test_scenarios_become_files(tmp_path, capsys):
    out = tmp_path / "out"
    call = ["data", "import", "commonroad", *map(str, EXAMPLES), "--out", str(out)]
    assert main([*call, "--json"]) == 0
    first, second = json.loads(capsys.readouterr().out)["recordings"]
    assert (first["recording"], first["tracks"], first["states"]) == (
        "ZAM_Crossing-1_1_T-1",
        3,
        120,
    )
    assert first["refused"] == [] and second["skipped"] == {"planningProblem": 1}
    found = files.load(out / first["file"])
    assert found.tracks.identity.tolist() == [101, 102, 103] and len(found.road.lanelets) == 9
    assert sorted(one.name for one in out.iterdir()) == [
        "ZAM_Crossing-1_1_T-1.safetensors",
        "ZAM_Crossing-2_1_T-1.safetensors",
        "refused.csv",
    ]
    # The folder is never written over.
    assert "exists already" in refused(capsys, "commonroad", EXAMPLES[0], "--out", out)


def test_refused_tracks_are_printed_and_written(tmp_path, capsys):
    text = EXAMPLES[0].read_text().replace("<length>4.5</length>", "<length>45.0</length>")
    path, out = tmp_path / "s.xml", tmp_path / "out"
    path.write_text(text)
    assert main(["data", "import", "commonroad", str(path), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "refused tracks" in said and "45 m long" in said
    lines = (out / "refused.csv").read_text().splitlines()
    assert lines[0] == "recording,identity,reason,road_user"
    assert lines[1].startswith('ZAM_Crossing-1_1_T-1,101,"45 m long and 1.8 m wide')


def test_csv_needs_a_column_map_and_has_one(tmp_path, capsys):
    path = write_csv(files_of_example().tracks, "ind", tmp_path)
    out = tmp_path / "out"
    assert "--columns goes with csv" in refused(capsys, "csv", path, "--out", out)
    assert "--columns goes with csv" in refused(
        capsys, "commonroad", EXAMPLES[0], "--columns", "ind", "--out", out
    )
    assert main(["data", "import", "csv", str(path), "--columns", "ind", "--out", str(out)]) == 0
    assert "120" in capsys.readouterr().out


def files_of_example():
    from socialiq_recordings.readers import import_file

    return import_file(EXAMPLES[0])[0].recording


def test_mistakes_leave_nothing_behind(tmp_path, capsys):
    out = tmp_path / "out"
    assert "no such file" in refused(capsys, "commonroad", tmp_path / "absent.xml", "--out", out)
    assert "unknown format 'waymo'" in refused(capsys, "waymo", EXAMPLES[0], "--out", out)
    assert "at least one file" in refused(capsys, "commonroad", "--out", out)
    line = refused(capsys, "commonroad", EXAMPLES[0], "--most-states", 100, "--out", out)
    assert "more than 100 states" in line
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_fails_does_not_void_the_others(tmp_path, capsys):
    bad, out = tmp_path / "bad.xml", tmp_path / "out"
    bad.write_text("<commonRoad")
    paths = [bad, EXAMPLES[0], EXAMPLES[0], tmp_path / "absent.xml", EXAMPLES[1]]
    call = ["data", "import", "commonroad", *map(str, paths), "--out", str(out), "--json"]
    assert main(call) == 1
    said = capsys.readouterr()
    told = json.loads(said.out)
    assert len(told["recordings"]) == 2 and len(told["failed"]) == 3
    assert said.err.count("not imported: ") == said.err.count("\n") == 3
    assert "is named ZAM_Crossing-1_1_T-1 too" in said.err
    assert len(list(out.glob("*.safetensors"))) == 2
    line = refused(capsys, "commonroad", bad, bad, "--out", tmp_path / "none")
    assert "(and 1 more files)" in line and not (tmp_path / "none").exists()


def test_a_road_and_errors_go_with_what_has_them(tmp_path, capsys):
    out = tmp_path / "out"
    line = refused(capsys, "commonroad", EXAMPLES[0], "--road", EXAMPLES[0], "--out", out)
    assert "--road goes with csv" in line
    line = refused(capsys, "commonroad", EXAMPLES[0], "--position-error", 0, "--out", out)
    assert "error of position must be a number above 0" in line
    csv = ("csv", EXAMPLES[0], "--columns", "interaction", "--out", out)
    assert "latitude, -80 to 84, and longitude" in refused(capsys, *csv, "--origin", 85, 0)
    for name, words in (("m.txt", "is not a map"), ("m.xml", "holds no lanelet")):
        road = tmp_path / name
        road.write_text("<commonRoad commonRoadVersion='2020a' timeStepSize='0.1'/>")
        assert words in refused(capsys, *csv, "--road", road)
    path = write_csv(files_of_example().tracks, "ind", tmp_path)
    call = ["data", "import", "csv", str(path), "--columns", "ind", "--out", str(out), "--json"]
    assert main([*call, "--road", str(EXAMPLES[0]), "--position-error", "0.1"]) == 0
    [told] = json.loads(capsys.readouterr().out)["recordings"]
    assert len(files.load(out / told["file"]).road.lanelets) == 9


def test_a_map_of_another_place_is_said(tmp_path, capsys):
    tracks = files_of_example().tracks
    for number, x in enumerate((0.0, 300.0)):
        moved = dataclasses.replace(tracks, x=tracks.x + x, recording=f"by{x:g}")
        path, out = write_csv(moved, "ind", tmp_path), tmp_path / f"out{number}"
        call = ["data", "import", "csv", str(path), "--columns", "ind", "--out", str(out)]
        assert main([*call, "--road", str(EXAMPLES[0])]) == 0
        said = capsys.readouterr().err
        assert ("100 % of its vehicles' states are on no lane" in said) == (x > 0)


@pytest.mark.parametrize("option", ["--out", "--demonstrations"])
def test_a_world_is_no_csv_file(tmp_path, capsys, option):
    files.save(tmp_path / "r.safetensors", files_of_example())
    names = {"--out": tmp_path / "w.safetensors"} | {option: tmp_path / "w.csv"}
    words = [word for pair in names.items() for word in map(str, pair)]
    assert main(["data", "world", str(tmp_path / "r.safetensors"), *words]) == 2
    assert "would not be a .csv file: name it .safetensors" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["r.safetensors"]


def test_inspect_counts_sites_chains_and_vehicles(tmp_path, capsys):
    out = tmp_path / "out"
    call = ["data", "import", "commonroad", *map(str, EXAMPLES), "--out", str(out), "--json"]
    assert main(call) == 0
    capsys.readouterr()
    paths = sorted(map(str, out.glob("*.safetensors")))
    assert main(["data", "inspect", *paths, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["counts"]["recordings"] == 2 and told["counts"]["sites"] == 1
    assert "no noise" in told["recordings"][0]["simulated"]
    assert main(["data", "inspect", *paths]) == 0
    assert "number of" in capsys.readouterr().out
    assert main(["data", "inspect", paths[0], paths[0]]) == 2
    assert "two recordings are named" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["../evil", "/etc/evil", "a\x1b[2Jb"])
def test_names_of_recordings_stay_inside_the_folder(tmp_path, capsys, name):
    escaped = name.replace("\x1b", "&#27;")
    text = EXAMPLES[0].read_text().replace("ZAM_Crossing-1_1_T-1", escaped)
    path, out = tmp_path / "s.xml", tmp_path / "out"
    path.write_text(text)
    if "\x1b" in name:  # XML itself has no such character
        assert "not XML" in refused(capsys, "commonroad", path, "--out", out)
        return
    assert main(["data", "import", "commonroad", str(path), "--out", str(out)]) == 0
    assert len(list(out.glob("*evil.safetensors"))) == 1
