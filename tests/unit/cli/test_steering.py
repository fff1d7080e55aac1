"""A policy that steers, from the command line, with and without the ending off the road."""

import dataclasses
import json
from pathlib import Path

import jax
import numpy as np
import pytest

from socialiq.cli.drivers import driver_of
from socialiq.cli.evaluate import target_of
from socialiq.cli.main import main
from socialiq.nn.actor import Actor
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.worlds.grammar import build

WORLD = "intersection-continuous-steering"
ENDS = f"{WORLD}-offroad"
NAMED = "socialiq/IntersectionContinuousSteering-v1"
ALL = "intersection,control=continuous or control=steering"

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


def actor(features: int, bias: float, provenance: dict | None = None) -> ActorPolicy:
    """Policy whose answer hardly depends on what it sees."""
    made = ActorPolicy.of(Actor.initialise(jax.random.key(0), features, (4,), 2), provenance or {})
    last = made.weights[-1] * 0.01
    biases = (*made.biases[:-1], np.full_like(made.biases[-1], bias))
    return dataclasses.replace(made, weights=(*made.weights[:-1], last), biases=biases)


@pytest.fixture(scope="module")
def policies(tmp_path_factory):
    """Files by name: a dial and two policies that see the time, and one that does not."""
    folder = tmp_path_factory.mktemp("policies")
    ActorDial(actor(71 + 2, 0.2), 0.0, 90.0).save(folder / "dial.safetensors")
    for name, angle in (("first", 30.0), ("second", 30.0)):
        actor(71, 0.4, {"angle": angle}).save(folder / f"{name}.safetensors")
    actor(70, 0.4).save(folder / "timeless.safetensors")
    return {path.stem.upper(): str(path) for path in folder.iterdir()}


def printed(words: list[str], policies: dict[str, str], capsys) -> dict:
    assert main([policies.get(word, word) for word in (*words, "--json")]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("world", [WORLD, ENDS])
def test_the_share_off_the_road_stands_beside_collisions(world, policies, capsys):
    words = ["evaluate", "FIRST", "--world", world, "--episodes", "20"]
    found = printed(words, policies, capsys)
    assert list(found).index("off_road") < list(found).index("ego_struck")
    assert found["off_road_low"] < found["off_road"] == 1.0
    ended = found["collision"] + found["arrival"] + found["timeout"]
    assert (ended == pytest.approx(1.0)) == (world == WORLD)
    assert main(["evaluate", policies["FIRST"], "random", *words[2:]]) == 0
    _title, names, *_ = capsys.readouterr().out.splitlines()
    assert "off road" in names


def test_discrete_actions_have_no_such_share(capsys, policies):
    found = printed(["evaluate", "go", "--world", "intersection", "--episodes", "3"], {}, capsys)
    assert "off_road" not in found


def test_policies_of_one_angle_are_pooled(policies, capsys):
    for name, angle in (("FIRST", 30.0), ("TIMELESS", None)):
        assert target_of(driver_of(str(policies[name]), build(WORLD)).record) == angle
    words = ["evaluate", "FIRST", "SECOND", "--world", WORLD, "--episodes", "3"]
    assert "angle" in printed(words, policies, capsys)["pooled"]
    words[2] = "TIMELESS"
    assert "angle_not_pooled" in printed(words, policies, capsys)["pooled"]


@pytest.mark.parametrize("world", [WORLD, ENDS])
def test_a_dial_is_driven_at_every_angle(world, policies, capsys):
    words = ["dial", world, "--policy", "DIAL", "--every", "45", "--episodes", "6"]
    rows = printed(words, policies, capsys)["angles"]
    assert [row["angle"] for row in rows] == [0.0, 45.0, 90.0]
    assert all(row["off_road"] == 1.0 for row in rows)
    alone = ["evaluate", "DIAL", "--world", world, "--angle", "45", "--episodes", "6"]
    same = printed(alone, policies, capsys)
    assert (rows[1]["r_env"], rows[1]["arrival"]) == (same["r_env"], same["arrival"])


def test_an_environment_shows_the_time_to_a_policy_that_takes_it(policies, capsys):
    named = "socialiq/IntersectionContinuousSteeringOffroad-v1"
    words = ["evaluate", "FIRST", "--world", named, "--episodes", "3"]
    found = printed(words, policies, capsys)
    words[3] = ENDS
    assert found["r_env"] == pytest.approx(printed(words, policies, capsys)["r_env"])
    words[1], words[3] = "TIMELESS", named
    assert printed(words, policies, capsys)["length"] >= 1.0


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            ["train", "dial", "--world", WORLD, "--out", "run"],
            f"`socialiq train sac --world {WORLD} --set dial=true` trains a dial of them",
        ),
        (["dial", "intersection", "--policy", "DIAL"], f"continuous actions: choose {ALL}"),
        (["dial", "crossing7", "--policy", "DIAL"], f"continuous actions: choose {ALL}"),
        (
            ["dial", "intersection-continuous", "--policy", "DIAL"],
            "the world has 70 and actions of 1 number (a clock adds a feature)",
        ),
        (["dial", WORLD, "--policy", "DIAL", "--calibrated", "c.safetensors"], "--calibrated is"),
        (["dial", WORLD, "--policy", "FIRST"], "holds actor, not actor-dial"),
        (
            ["evaluate", "atlas:expert_prosocial", "--world", WORLD, "--episodes", "2"],
            "atlas:expert_prosocial accelerates and doesn't steer: name a rule",
        ),
        (["render", ENDS, "--driver", "expert_prosocial", "--out", "x.png"], "doesn't steer"),
        (
            ["collect", NAMED, "--driver", "FIRST", "--out", "x.safetensors"],
            "the world has 70 and actions of 2 numbers (a clock adds a feature)",
        ),
    ],
)
def test_mistakes_are_one_line(words, says, policies, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([policies.get(word, word) for word in words]) == 2
    line = capsys.readouterr().err
    assert says in line and line.count("\n") == 1
    assert not list(Path().iterdir())


def test_an_audit_counts_no_arrival_off_the_road(policies, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["profile", "new", "--world", ENDS, "--angle", "45", "--out", "p.toml"]) == 0
    given = ["--profile", "p.toml", "--episodes", "20", "--seed", "7", "--no-log", "--out", "out"]
    assert main(["audit", policies["FIRST"], *given]) == 1
    report = json.loads(Path("out/report.json").read_text())
    assert {one["ending"] for one in report["episodes"]["worst"]} == {"other"}
    assert report["policy"]["means"]["arrival"] == 0.0
    rerun = ["audit", "verify", "out", "--rerun", "--policy", policies["FIRST"]]
    assert main(rerun) == 0
