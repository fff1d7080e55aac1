"""The driver that ships, by its name in every command."""

import json
import shutil

import pytest

from socialiq.cli.main import main
from socialiq.functions import worlds


@pytest.mark.parametrize(
    "world", ["intersection", "merge", "roundabout", "two_way", "road,seed=1000003"]
)
def test_it_drives_on_every_road(world, capsys):
    assert main(["evaluate", "driver@30", "--world", world, "--episodes", "4", "--json"]) == 0
    assert "r_env" in json.loads(capsys.readouterr().out)


def test_it_drives_on_a_road_where_no_driver_is_named(capsys):
    worlds = ["merge", "roundabout,reward=caused"]
    for world in worlds:
        for angle, driver in (([], "driver@45"), (["--angle", "20"], "driver@20")):
            words = ["--world", world, "--episodes", "4", "--json"]
            assert main(["evaluate", *words, *angle]) == 0
            unnamed = capsys.readouterr().out
            assert main(["evaluate", driver, *words]) == 0
            assert json.loads(unnamed) == json.loads(capsys.readouterr().out)
    assert main(["effects", "merge", "--angle", "0", "90", "--episodes", "4", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["drivers"]
    assert [row["policy"] for row in rows] == ["driver@0", "driver@90"]


@pytest.mark.parametrize(
    "words",
    [["effects", "crossing7"], ["evaluate", "--world", "Pendulum-v1", "--episodes", "2"]],
)
def test_elsewhere_a_driver_must_be_named(words, capsys):
    assert main(words) == 2
    assert "no driver is named" in capsys.readouterr().err


def test_both_angles_turn_it_where_people_walk(capsys):
    world = "intersection,people=.3,exit=straight"
    outcomes = []
    for turn in ("0", "90/90", "90/0"):
        words = ["--world", world, "--episodes", "40", "--json"]
        assert main(["evaluate", f"driver@{turn}", *words]) == 0
        outcomes.append(json.loads(capsys.readouterr().out)["r_env"])
    assert len({*outcomes}) == 3


@pytest.mark.parametrize(
    "words",
    [
        ["effects", "merge", "--policy", "driver@45", "--policy", "idm", "--episodes", "4"],
        ["effects", "merge", "--policy", "driver", "--angle", "0", "90", "--episodes", "4"],
        ["population", "--policy", "driver", "--angle", "0", "90", "--episodes", "2"],
        ["collect", "roundabout", "--driver", "a=driver@0", "--episodes", "2", "--out", "OUT"],
        ["render", "merge", "--driver", "driver@0", "--out", "OUT.png"],
        ["export", "driver@45/0", "--format", "torch", "--out", "OUT"],
        ["turn", "driver", "--angle", "30", "--class-angle", "0", "--out", "OUT"],
        ["dial", "merge", "--policy", "driver", "--every", "90", "--episodes", "4"],
    ],
    ids=lambda words: " ".join(words[:3]),
)
def test_every_command_takes_its_name(words, tmp_path, capsys):
    out = str(tmp_path / "out")
    assert main([word.replace("OUT", out) for word in words]) == 0
    capsys.readouterr()


def test_drivers_that_observe_rows_drive_beside_it(capsys):
    other = "results/intersection-dial-clock/iterated.safetensors@45"
    words = ["effects", "intersection", "--policy", "driver@45", "--policy", other]
    assert main([*words, "--episodes", "4", "--json"]) == 0
    together = json.loads(capsys.readouterr().out)["drivers"]
    for policy, row in zip(("driver@45", other), together, strict=True):
        assert main([*words[:2], "--policy", policy, "--episodes", "4", "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["drivers"] == [row]


def test_a_file_that_observes_its_route_needs_no_option(tmp_path, capsys):
    file = str(tmp_path / "dial.safetensors")
    shutil.copy("results/driver/driver.safetensors", file)
    outcomes = []
    for policy, world in ((f"{file}@30", "merge"), ("driver@30", "merge,observation=route")):
        assert main(["evaluate", policy, "--world", world, "--episodes", "4", "--json"]) == 0
        outcomes.append(json.loads(capsys.readouterr().out)["r_env"])
    assert outcomes[0] == outcomes[1]


def test_an_audit_drives_it_beside_references_that_observe_rows(tmp_path, capsys):
    profile = tmp_path / "profile.toml"
    declared = ["--world", "intersection", "--angle", "45", "--owner", "A", "--out", str(profile)]
    assert main(["profile", "new", *declared]) == 0
    out = tmp_path / "audit"
    words = ["--profile", str(profile), "--episodes", "60", "--seed", "1", "--out", str(out)]
    assert main(["audit", "driver", *words]) in (0, 1, 3)
    report = json.loads((out / "report.json").read_text())
    assert report["policy"]["record"]["schema"] == "route-1"
    names = {reference["name"] for reference in report["references"]}
    assert {"dial_0", "dial_45", "dial_90", "gap_3s"} <= names
    assert report["policy"]["means"]["r_env"] > 6.0
    capsys.readouterr()
    assert main(["audit", "verify", str(out), "--rerun"]) == 0


@pytest.mark.parametrize("world", ["merge", "road,seed=1000003"])
def test_an_audit_on_another_road_shows_it_the_route(world, tmp_path, capsys):
    profile = tmp_path / "profile.toml"
    declared = ["--world", world, "--angle", "45", "--owner", "A", "--out", str(profile)]
    assert main(["profile", "new", *declared]) == 0
    out = tmp_path / "audit"
    words = ["--profile", str(profile), "--episodes", "20", "--seed", "1", "--out", str(out)]
    reference = ["--reference", "results/driver/driver.safetensors"]
    assert main(["audit", "driver@45", *words, *reference]) in (0, 1, 3)
    means = json.loads((out / "report.json").read_text())["policy"]["means"]
    capsys.readouterr()
    evaluated = ["--world", world, "--episodes", "200", "--json"]
    assert main(["evaluate", "driver@45", *evaluated]) == 0
    row = json.loads(capsys.readouterr().out)
    assert means["r_env"] == pytest.approx(row["r_env"], abs=1.0 + row["r_env_sd"])


def test_the_function_takes_it_too():
    with worlds.driver("driver@60", "merge") as loaded:
        assert loaded.record.interface.schema == "route-1"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            ["evaluate", "driver@45", "--world", "crossing7"],
            "driver drives on roads, at recorded junctions and in SUMO",
        ),
        (["evaluate", "driver@45", "--world", "merge,observation=rows"], "add observation=route"),
        (["export", "driver@45", "--format", "onnx", "--out", "x.onnx"], "write @45/0"),
        (["export", "driver", "--format", "onnx", "--out", "x.onnx"], "is a dial"),
    ],
)
def test_where_it_can_not_drive_one_line_says_so(words, line, capsys):
    episodes = ["--episodes", "2"] if words[0] == "evaluate" else []
    assert main([*words, *episodes]) == 2
    message = capsys.readouterr().err.strip()
    assert line in message
    assert "\n" not in message
