"""`effects`: tables and folder of what drivers cause, and calls that it refuses."""

import json

import pytest

from socialiq.cli.main import main

CLOCKED = "results/caused-effects/dial.safetensors"
DIAL = "results/dial-short/dial.safetensors"
GO = ["effects", "intersection", "--policy", "go", "--episodes", "6"]


def test_effects_of_a_rule_on_a_road(tmp_path, capsys):
    out = tmp_path / "effects"
    assert main([*GO, "--policy", "wait", "--out", str(out), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    go, wait = result["drivers"]
    assert (go["policy"], wait["policy"]) == ("go", "wait")
    assert wait["collision"] == 0
    assert go["delay_low"] <= go["delay"] <= go["delay_high"]
    names = {"effects.csv", "episodes.csv", "effects.json", "effects.png"}
    assert {path.name for path in out.iterdir()} == names
    assert len((out / "episodes.csv").read_text().splitlines()) == 1 + 12
    assert (out / "effects.png").read_bytes().startswith(b"\x89PNG")


def test_effects_under_a_shift_are_those_of_what_is_shown(capsys):
    delays = []
    for more in ([], ["--shift", "none"], ["--shift", "late"], ["--front-end", "latency=1"]):
        words = ["effects", "intersection", "--policy", "gap_3s", "--episodes", "40", "--json"]
        assert main([*words, *more]) == 0
        result = json.loads(capsys.readouterr().out)
        assert result.get("shift", "none") == (more[1] if "--shift" in more else "none")
        delays.append(result["drivers"][0]["delay"])
    assert delays[0] == delays[1] and len(set(delays)) == 3


def test_exact_effects_of_a_dial_in_a_gridworld(capsys):
    words = ["effects", "crossing7", "--policy", DIAL, "--angle", "0", "45", "--json"]
    assert main(words) == 0
    egoist, prosocial = json.loads(capsys.readouterr().out)["drivers"]
    assert (egoist["angle"], egoist["delay"]) == (0.0, pytest.approx(2.0))
    assert prosocial["delay"] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["effects", "crossing7"], "no driver is named"),
        (["effects", "mars", "--policy", "go"], "unknown world 'mars'"),
        ([*GO[:-1], "1"], "give 2 or more"),
        ([*GO, "--horizon", "3"], "horizon must be at least the duration"),
        ([*GO, "--horizon=-1"], "horizon must be a number of seconds of at least 0"),
        ([*GO, "--policy", "nowhere"], "nowhere"),
        ([*GO, "--shift", "mars"], "mars"),
        ([*GO, "--demand", "day.rou.xml"], "demand is of SUMO: choose sumo"),
        ([*GO, "--shield", "2"], "no one walks here"),
        (
            ["effects", "merge", "--policy", "go", "--shift", "dense"],
            "no option initial_vehicle_count",
        ),
        (["effects", "crossing7", "--policy", "go", "--shift", "late"], "which has no sensor"),
        (["effects", "crosswalk7", "--policy", "go", "--shield", "2"], "no seconds to a collision"),
        (["effects", "sumo", "--policy", "go", "--shift", "late"], "its own code makes of a state"),
        ([*GO, "--angle", "45"], "--angle is of dials"),
        ([*GO, "--policy", CLOCKED, "--angle", "200"], "200"),
        ([*GO, "--policy", DIAL], "takes 7 features and 3 actions, the world has 70"),
        (["effects", "crossing7", "--policy", DIAL, "--horizon", "30"], "--horizon is of a road"),
    ],
)
def test_bad_calls_leave_nothing(words, message, tmp_path, capsys):
    out = tmp_path / "effects"
    assert main([*words, "--out", str(out)]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
