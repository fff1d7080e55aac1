"""Every saved form: arrays and plain values after save, and actions after load."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load_file
from tests.digest.commands import EXAMPLES, actions_of, call, observations, of_csv
from tests.digest.digest import Hashes, Item, of_array, of_arrays, of_plain

POLICIES = ("policy", "ensemble", "dial", "context", "table")
COMMITTED = {
    "intersection/atlas/prosocial": 70,
    "intersection-networks/atlas/set_prosocial": 70,
    "intersection-policy-iteration/atlas/iterated_prosocial": 70,
    "intersection-dial/dial": 70,
    "intersection-offline/dial": 70,
    "intersection-dial-clock/iterated": 71,
}
"""Number of features by name of a committed policy of the intersection."""
ACTORS = ("intersection-continuous/atlas/expert_prosocial",)


@functools.cache
def samples() -> Path:
    """Make a sample of every kind of file, once for a process; return their folder."""
    from tests.fuzz.samples import make_samples

    holder = tempfile.TemporaryDirectory()
    HOLDERS.append(holder)
    make_samples(Path(holder.name))
    return Path(holder.name)


HOLDERS: list[tempfile.TemporaryDirectory] = []
"""Folders that are removed when the process ends."""


def contents(_folder: Path) -> Hashes:
    """Hash the arrays of every sample, whatever its header says."""
    folder = samples()
    hashes = {
        path.stem: of_arrays(load_file(path)) for path in sorted(folder.glob("*.safetensors"))
    }
    for path in sorted(folder.glob("*.npz")):
        with np.load(path, allow_pickle=False) as arrays:
            hashes[path.name] = of_arrays({name: arrays[name] for name in arrays.files})
    return hashes | {path.name: of_csv(path) for path in sorted(folder.glob("*.csv"))}


def predictions(_folder: Path) -> Hashes:
    """Hash the actions of every policy among the samples in states of the 5x5 world."""
    import socialiq

    world = socialiq.make("crossing5")
    states = np.array(socialiq.tabulate(world).states, np.float32)
    sizes = world.n_features, world.n_actions
    return {
        f"{name}/predict": actions_of(samples() / f"{name}.safetensors", sizes, 30.0, states)
        for name in POLICIES
    }


def committed(_folder: Path) -> Hashes:
    """Hash the actions of committed policies."""
    from socialiq.storage import packaged_results

    hashes = {}
    for name, features in COMMITTED.items():
        path = packaged_results() / f"{name}.safetensors"
        states = observations(features, 256)
        states[:, 70:] = 3.0
        hashes[f"{name}/predict"] = actions_of(path, (features, 3), 30.0, states)
    return hashes


def actors(_folder: Path) -> Hashes:
    """Hash the actions of committed policies of continuous actions."""
    from socialiq.nn.actor_policy import ActorDial, ActorPolicy
    from socialiq.storage import packaged_results

    folder = packaged_results()
    policies = {name: ActorPolicy.load(folder / f"{name}.safetensors") for name in ACTORS}
    dial = ActorDial.load(folder / "intersection-continuous" / "dial.safetensors")
    policies["intersection-continuous/dial"] = dial.at(30.0)
    hashes = {}
    for name, policy in policies.items():
        actions, _ = policy.predict(observations(policy.n_features, 256), deterministic=True)
        # Networks round as the processor adds: more digits would hang on it.
        hashes[f"{name}/predict"] = of_array(np.rint(100.0 * np.asarray(actions)).astype(np.int64))
    return hashes


def forms(_folder: Path) -> dict[str, Any]:
    """Return a small object of every saved form that acts, by its kind."""
    import jax
    from tests.fuzz.samples import RULE

    from socialiq.nn.actor_policy import ActorDial, ActorPolicy
    from socialiq.nn.class_dial import ClassDial
    from socialiq.nn.dial_network import DialNetwork
    from socialiq.nn.dial_policy import DialPolicy
    from socialiq.nn.ensemble import EnsemblePolicy
    from socialiq.nn.q_policy import QPolicy
    from socialiq.social.angle_rule import load_rule
    from socialiq.worlds.enumerate import tabulate
    from socialiq.worlds.registry import make_grid
    from socialiq.worlds.situation import ContextPolicy
    from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy

    grid = make_grid("crossing5")
    features = grid.n_features
    random = np.random.default_rng(0)

    def layers(inputs: int, outputs: int) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        shapes = [(4, inputs), (outputs, 4)]
        weights = tuple(random.normal(size=shape).astype(np.float32) for shape in shapes)
        return weights, tuple(np.zeros(shape[0], np.float32) for shape in shapes)

    policies = [QPolicy(*layers(features, 2), "relu", 1.0) for _ in range(2)]
    network = DialNetwork.initialise(jax.random.key(0), features, (4,), 2)
    dial = DialPolicy.of(network, 1.0, 0.0, 90.0, {})
    rule = _folder / "rule.toml"
    rule.write_text(RULE)
    return {
        "policy": policies[0],
        "ensemble": EnsemblePolicy.of(policies),
        "dial": dial,
        "class-dial": ClassDial(QPolicy(*layers(features + 3, 2), "relu", 1.0), 0.0, 90.0),
        "actor": ActorPolicy(*layers(features, 4), "elu", 2),
        "actor-dial": ActorDial(ActorPolicy(*layers(features + 2, 2), "relu", 1), 0.0, 90.0),
        "context-policy": ContextPolicy.of(dial, load_rule(rule)),
        "table": TabularPolicy(grid, expert_policy(tabulate(grid), 30.0)),
    }


def reloaded(kind: str, folder: Path) -> Hashes:
    """Write a form and read it; hash the file's arrays and what the form does that was read."""
    import socialiq

    form = forms(folder)[kind]
    path = folder / "form.safetensors"
    form.save(path)
    states = np.array(socialiq.tabulate(socialiq.make("crossing5")).states, np.float32)
    read = type(form).load(path)
    hashes = {"arrays": of_arrays(load_file(path), True)}
    read = read.of_class(60.0) if kind == "class-dial" else read
    read = read.at(30.0) if kind.endswith("dial") else read
    actions, _ = read.predict(states, deterministic=True)
    chances = getattr(read, "probabilities", actions)
    chances = chances(states) if callable(chances) else chances
    return hashes | {"actions": of_array(actions), "chances": of_array(chances)}


def demonstrations(folder: Path) -> Hashes:
    """Hash files of demonstrations of discrete and continuous actions, and with a clock."""
    calls = {
        "discrete": ("crossing5", "--episodes", 2),
        "clock": ("crossing5", "--episodes", 2, "--clock"),
        "continuous": (
            "intersection-continuous", "--driver", "idm", "--driver", "go", "--episodes", 2,
        ),
    }  # fmt: skip
    from socialiq.demonstrations import files

    hashes = {}
    for name, (world, *words) in calls.items():
        path = folder / f"{name}.safetensors"
        call("collect", world, *words, "--out", path)
        data = files.load(path, continuous=name == "continuous")
        totals = data.totals()
        columns = {"r_env": totals.env, "r_social": totals.social, "ending": data.ending}
        hashes[name] = of_plain([of_arrays(load_file(path)), of_arrays(columns)])
    return hashes


def class_dials(_folder: Path) -> Hashes:
    """Hash the actions of the committed dials of two angles at several of them."""
    from socialiq.nn.class_dial import ClassDial
    from socialiq.storage import packaged_results

    hashes = {}
    for name in ("crosswalk", "crosswalk-intersection"):
        dial = ClassDial.load(packaged_results() / name / "dial.safetensors")
        states = observations(dial.n_features, 256)
        if name == "crosswalk":
            states = np.abs(np.rint(2.0 * states)).astype(np.float32)
        rows = [
            dial.of_class(of_class).at(angle).predict(states, deterministic=True)[0]
            for of_class in (0.0, 45.0, 90.0)
            for angle in (0.0, 45.0, 90.0)
        ]
        hashes[f"{name}/predict"] = of_array(np.array(rows))
    return hashes


def foreign(name: str, _folder: Path) -> Hashes:
    """Hash the actions of a policy that another library saved."""
    path = EXAMPLES / "policies" / name
    return {"predict": actions_of(path, (70, 3), None, observations(70, 256))}


FORMS = (
    "policy", "ensemble", "dial", "class-dial", "actor", "actor-dial", "context-policy", "table",
)  # fmt: skip
"""Kinds of files that hold a policy."""

ITEMS = [
    *(Item(f"form/{kind}", functools.partial(reloaded, kind), quick=True) for kind in FORMS),
    Item("form/demonstrations", demonstrations, quick=True),
    Item("saved/class-dials", class_dials, quick=True),
    Item("saved/content", contents, ("shapely",), quick=True),
    Item("saved/samples", predictions, ("shapely",), quick=True),
    Item("saved/committed", committed, quick=True),
    Item("saved/actors", actors, quick=True),
    Item("saved/sb3", functools.partial(foreign, "dqn_intersection.zip")),
    Item(
        "saved/onnx",
        functools.partial(foreign, "dqn_intersection.onnx"),
        ("onnx", "onnxruntime"),
    ),
]
