import json

import jax
import numpy as np
import pytest

from socialiq.audit.evidence.drive import Course
from socialiq.cli.main import main
from socialiq.evaluation.classes import ClassGround
from socialiq.evaluation.simulate import ScriptedActor
from socialiq.nn.class_dial import ClassDial
from socialiq.nn.dial_network import DialNetwork
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid


@pytest.fixture(name="dial")
def dial_file(tmp_path):
    places = make_grid("crosswalk7").one_hot
    network = DialNetwork.initialise(jax.random.key(0), 7, (8,), 3, one_hot=places, classes=True)
    ClassDial.of(network, 0.5, 0.0, 90.0, {}).save(tmp_path / "dial.safetensors")
    return str(tmp_path / "dial.safetensors")


def test_a_dial_of_two_angles_is_evaluated_turned_and_driven(dial, tmp_path, capsys):
    assert main(["dial", "crosswalk7", "--policy", dial, "--every", "45", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    rows = {(row["angle"], row["class_angle"]): row for row in found["angles"]}
    assert len(rows) == 9
    assert found["worst_regret"] == max(row["regret"] for row in rows.values()) > 0.0
    both, policy = ["--class-angle", "90", "--angle", "45"], str(tmp_path / "policy.safetensors")
    assert main(["turn", dial, *both, "--out", policy]) == 0
    capsys.readouterr()
    evaluate = ["evaluate", policy, "--world", "crosswalk7-90", "--angle", "45", "--json"]
    assert main(evaluate) == 0
    regret = json.loads(capsys.readouterr().out)["regret"]
    assert regret == pytest.approx(rows[45.0, 90.0]["regret"], abs=1e-5)


def test_a_dial_of_two_angles_is_trained_and_driven_on_a_road(tmp_path, capsys, each_once):
    out, world = tmp_path / "out", "intersection-crosswalk"
    short = ["--updates", "2", "--set", "states_per_update=1", "--set", "first_rounds=1"]
    train = ["train", "improve-dial", "--world", world, "--out", str(out), *short]
    assert main([*train, "--environments", "8", "--set", "hidden=4", "--seed", "3"]) == 0
    dial = str(out / "dial_0.safetensors")
    assert ClassDial.load(dial).pairs and ClassDial.load(dial).n_features == 113
    capsys.readouterr()
    sweep = ["dial", world, "--policy", dial, "--every", "90", "--episodes", "8", "--json"]
    assert main(sweep) == 0
    rows = json.loads(capsys.readouterr().out)["angles"]
    assert [(row["class_angle"], row["angle"]) for row in rows] == [
        (0.0, 0.0), (0.0, 90.0), (90.0, 0.0), (90.0, 90.0),
    ]  # fmt: skip
    evaluate = ["evaluate", dial, "--world", f"{world}-90", "--angle", "90", "--json"]
    assert main([*evaluate, "--episodes", "8", "--shield", "2"]) == 0
    row = json.loads(capsys.readouterr().out)
    assert row["pedestrian_hit"] <= rows[3]["pedestrian_hit"]
    again = each_once(*train[:2], dial, *train[2:], "--out", str(tmp_path / "again"))
    assert main(again) == 2
    assert "begins with no dial" in capsys.readouterr().err


def test_a_dial_that_observes_vehicles_alone_drives_among_people_and_is_told(capsys):
    dial = "results/intersection-dial-clock/iterated.safetensors"
    words = ["evaluate", dial, "--world", "intersection-crosswalk", "--episodes", "8", "--json"]
    assert main(words) == 0
    captured = capsys.readouterr()
    assert "does not see pedestrians" in captured.err
    assert json.loads(captured.out)["arrival"] > 0.0
    assert (
        main(["evaluate", "go", "--world", "intersection", "--episodes", "2", "--shield", "2"]) == 2
    )
    assert "people on foot" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--angle", "45"], ["--class-angle", "91"]])
def test_a_class_angle_is_asked_for_and_checked(words, dial, tmp_path, capsys):
    assert main(["turn", dial, *words, "--out", str(tmp_path / "policy.safetensors")]) == 2
    assert "class" in capsys.readouterr().err


def test_an_audit_measures_what_a_driver_causes_each_class():
    table = tabulate(make_grid("crosswalk7-90"))
    course = Course(table.world, np.arange(400), measured=("delay", "waiting"))
    fast = ScriptedActor(lambda _, __, rows: np.full(len(rows), 2))
    driven, ground = course.outcomes("fast", fast), ClassGround(table)
    exact = ground.measured(np.tile([0.0, 0.0, 1.0], (ground.part.mdp.n_states, 1)))
    for name, column in (("delay", "vehicles_delayed"), ("waiting", "pedestrians_waiting")):
        values = driven.episodes[name]
        error = values.std() / np.sqrt(len(values))
        assert exact[column] > 0.0
        assert abs(values.mean() - exact[column]) <= 4 * error + 1e-12
