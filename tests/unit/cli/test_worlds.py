"""Every command over every world: it runs, or says why in the nature of the thing."""

import json

import pytest

from socialiq.cli.main import main
from socialiq.worlds import catalogue, grammar

WORLDS = (
    "crossing7",
    "crosswalk7,class_angle=60,people=.1",
    "intersection",
    "intersection,exit=right,people=.1,class_angle=60",
    "intersection,people=.1,cyclists=.1,reward=caused",
    "intersection,control=continuous",
    "intersection,control=steering,people=.1",
    "intersection,latency=1,unseen=.3",
    "intersection,agents=3",
    "merge",
    "merge,late",
    "roundabout,reward=caused",
    "roundabout,noise=1,front_end=[track=2]",
    "two_way,agents=2",
)

COMMANDS = {
    "worlds": ["worlds", "{world}"],
    "solve": ["solve", "{world}", "--angle", "45"],
    "front": ["front", "{world}"],
    "collect": ["collect", "{world}", "--driver", "go", "--episodes", "2", "--out", "{out}.st"],
    "effects": ["effects", "{world}", "--policy", "go", "--episodes", "2"],
    "evaluate": ["evaluate", "go", "--world", "{world}", "--episodes", "2"],
    "render": ["render", "{world}", "--driver", "go", "--out", "{out}.png"],
    "population": ["population", "{world}", "--policy", "go", "--policy", "wait"],
    "profile new": ["profile", "new", "--world", "{world}", "--angle", "45", "--out", "{out}.toml"],
}

LISTED = "can't be listed, so nothing about it is exact"
NO_RULES = "has no rule-based drivers"


def refusal(command, text):
    """The reason that a cell is refused for, "" where it runs."""
    written = grammar.parse(text)
    is_grid = written.name in catalogue.GRIDS
    fleet = "agents" in written.options
    if command in ("solve", "front"):
        return "" if is_grid else LISTED
    if command == "worlds":
        return ""
    if is_grid:
        reasons = {"render": "has no --driver: use --angle", "population": "choose one of inter"}
        reasons |= {"profile new": "", "effects": "is of a road as the world"}
        return reasons.get(command, NO_RULES)
    if command == "population":
        return "set agents=1" if written.caused else ""
    if fleet:
        return "agents are driven by `socialiq population`"
    return ""


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("command", COMMANDS)
def test_each_cell_runs_or_says_why(command, world, tmp_path, capsys):
    words = [word.format(world=world, out=tmp_path / "out") for word in COMMANDS[command]]
    if command == "population":
        words += ["--episodes", "2", "--invaders", "1"]
        words += [] if "agents" in world else ["--agents", "2"]
    why = refusal(command, world)
    status = main(words)
    error = capsys.readouterr().err
    assert status == (2 if why else 0), error
    if why:
        assert why in error
        assert len(error.splitlines()) == 1


@pytest.mark.slow
@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("command", ["collect", "effects", "evaluate", "render"])
def test_the_driver_drives_where_a_rule_does(command, world, tmp_path, capsys):
    words = [word.format(world=world, out=tmp_path / "out") for word in COMMANDS[command]]
    words = ["driver@45" if word == "go" else word for word in words]
    written = grammar.parse(world)
    why = refusal(command, world)
    if written.name in catalogue.GRIDS:
        why = f"driver drives on roads, at recorded junctions and in SUMO, not in {written.name}"
    elif written.control:
        why = "takes 674 features and 5 discrete actions"
    status = main(words)
    error = capsys.readouterr().err
    assert status == (2 if why else 0), error
    assert why in error


def test_the_list_has_every_world(capsys):
    assert main(["worlds", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    names = [row["world"] for row in listed["worlds"]]
    assert set(catalogue.NAMES) <= set(names)
    assert listed["old_names"] == catalogue.OLD


def test_options_have_defaults_and_meanings(capsys):
    assert main(["worlds", "intersection", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    rows = {row["key"]: row for row in printed["options"]}
    assert rows["people, pedestrian_rate"]["meaning"] == "arrivals at each arm per s"
    assert rows["duration"] == {
        "key": "duration", "default": "20", "needs": "",
        "meaning": "seconds after which an episode times out",
    }  # fmt: skip
    assert rows["ends"]["needs"] == "agents"
    assert "gap_3s" in printed["can"]["rule drivers"]
    keys = {word for key in rows for word in key.split(", ")}
    assert keys >= set(catalogue.keys_of("intersection"))
    assert all(row["meaning"] for row in printed["options"])


def test_an_old_name_is_forwarded_with_one_line(capsys):
    words = ["evaluate", "go", "--episodes", "3", "--json", "--world"]
    assert main([*words, "intersection-crosswalk-60"]) == 0
    old = capsys.readouterr()
    assert old.err == (
        "socialiq: intersection-crosswalk-60 is now written "
        "intersection,people=0.1,class_angle=60\n"
    )
    assert main([*words, "intersection,people=0.1,class_angle=60"]) == 0
    new = capsys.readouterr()
    assert (new.out, new.err) == (old.out, "")


def test_options_and_words_of_the_world_are_one(capsys):
    plain = ["evaluate", "go", "--episodes", "3", "--json", "--world"]
    assert main([*plain, "intersection", "--shift", "late", "--front-end", "latency=1"]) == 0
    by_options = capsys.readouterr().out
    assert main([*plain, "intersection,late,front_end=[latency=1]"]) == 0
    assert capsys.readouterr().out == by_options
    assert main([*plain, "intersection,late", "--shift", "near"]) == 2
    assert "--shift and shift of the world: leave one out" in capsys.readouterr().err
