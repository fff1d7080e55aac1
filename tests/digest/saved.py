"""Every saved form: arrays and plain values after save, and actions after load."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file
from tests.digest.commands import EXAMPLES, actions_of, observations, of_csv
from tests.digest.digest import Hashes, Item, of_array, of_arrays

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


def foreign(name: str, _folder: Path) -> Hashes:
    """Hash the actions of a policy that another library saved."""
    path = EXAMPLES / "policies" / name
    return {"predict": actions_of(path, (70, 3), None, observations(70, 256))}


ITEMS = [
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
