"""Labels of the driver's training over its mixture."""

import dataclasses
import json

import jax
import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.driver_training import training
from socialiq.evaluation.parts import Workers
from socialiq.learners import policy_iteration
from socialiq.nn.class_dial import ClassDial

FILE = "results/driver/driver.safetensors"
STRUCTURE = dataclasses.replace(training.STRUCTURE, hidden=(8,))
SMALL = [
    "--set", "hidden=8", "--set", "updates=2", "--set", "states_per_update=1",
    "--set", "first_rounds=1", "--set", "replay_capacity=400",
]  # fmt: skip


@pytest.fixture(name="policy", scope="module")
def policy_of_a_new_network():
    network = policy_iteration.DialIteration(STRUCTURE, training.SIZES).network(jax.random.key(0))
    dial = policy_iteration.kind_of_dial(STRUCTURE).of(network, 1.0, 0.0, 90.0, {})
    return policy_iteration.Greedy(dial), 0.1


@pytest.mark.parametrize(
    ("world", "people"),
    [
        ("merge,observation=route,reward=caused", False),
        ("intersection,observation=route,people=.3,reward=caused", True),
        ("intersection,observation=route,agents=3", False),
        ("road,observation=route,seed=2,people=.1,agents=2", False),
    ],
)
def test_labels_have_both_classes_in_every_world(world, people, policy):
    rng = np.random.default_rng(1)
    labelled = training.label_world(STRUCTURE, world, 45, policy, rng)
    n_features, n_actions = training.SIZES
    assert labelled.observation.shape == (45, n_features + 2)  # both angles at the end
    assert np.ptp(labelled.observation[:, -2]) > 40.0
    assert np.ptp(labelled.observation[:, -1]) > 40.0
    env, (vehicle, vulnerable) = labelled.returns.env, labelled.returns.social
    assert env.shape == vehicle.shape == vulnerable.shape == (45, n_actions)
    assert np.any(vehicle)
    assert np.any(vulnerable) == people


def test_a_chunk_has_equal_shares_of_its_worlds(policy, monkeypatch):
    structure = dataclasses.replace(STRUCTURE, states_per_update=1)
    drawn = list[str]()
    label_world = training.label_world

    def noting(structure, text, *arguments):
        drawn.append(text)
        return label_world(structure, "merge,observation=route,reward=caused", *arguments)

    monkeypatch.setattr(training, "label_world", noting)
    labelled = training.labeller(structure)(*policy, np.random.default_rng(3))
    assert len(labelled.observation) == 200
    assert len(drawn) == training.WORLDS
    assert len({*drawn}) > 1


@pytest.mark.slow
def test_labels_are_the_same_in_any_number_of_processes(policy):
    structure = dataclasses.replace(STRUCTURE, states_per_update=1)
    with Workers(2) as workers:
        apart, here = (
            training.labeller(structure, split)(*policy, np.random.default_rng(3))
            for split in (workers, None)
        )
    jax.tree.map(np.testing.assert_array_equal, apart, here)


def test_one_dial_of_both_angles_is_written_and_drives_anywhere(tmp_path, capsys):
    out = tmp_path / "run"
    assert main(["train", "driver", "--out", str(out), "--seed", "3", *SMALL]) == 0
    path = out / "dial_0.safetensors"
    dial = ClassDial.load(path)
    assert dial.pairs
    assert (dial.n_features, dial.n_actions) == training.SIZES
    assert dial.provenance["observation"] == "route-1"
    capsys.readouterr()
    for world in ("merge", "road,seed=5,people=.1"):
        words = ["--world", f"{world},observation=route", "--episodes", "2"]
        assert main(["evaluate", f"{path}@30", *words]) == 0


def test_a_second_stage_begins_with_the_network_of_a_file(tmp_path, capsys):
    out = tmp_path / "run"
    small = ["states_per_update=1", "first_rounds=1", "replay_capacity=400", "batch_size=8"]
    words = ["--out", str(out), "--set", "updates=1", "learning_rate=1e-9", *small]
    assert main(["train", "driver", "--start", FILE, *words]) == 0
    capsys.readouterr()
    first, second = ClassDial.load(FILE), ClassDial.load(out / "dial_0.safetensors")
    for before, after in zip(first.turned.weights, second.turned.weights, strict=True):
        np.testing.assert_allclose(before, after, atol=1e-6)
    assert json.loads((out / "run.json").read_text())
    assert second.provenance["start"] == {"sha256": first.turned.sha256}


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--hours", "0"], "--hours 0: give more than 0"),
        (["--processes", "-1"], "processes must be at least 1"),
        (["--set", "classes=false"], "leave out --set view, classes and times"),
        (["--set", "view=flat"], "leave out --set view, classes and times"),
        (["--start", "none.safetensors"], "no such file: none.safetensors"),
        (["--start", "results/intersection-dial-clock/iterated.safetensors"], "holds dial"),
        (["--start", FILE, "--set", "hidden=8"], "has another network"),
    ],
)
def test_what_makes_no_driver_is_refused(words, line, tmp_path, capsys):
    out = tmp_path / "run"
    assert main(["train", "driver", "--out", str(out), *words]) == 2
    assert line in capsys.readouterr().err
    assert not out.exists()
