"""Short trainings of every learner: weights, metrics, and greedy actions in fixed observations."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
from tests.digest.commands import (
    actions_of,
    call,
    collected,
    junction_file,
    networks_of,
    observations,
    of_networks,
)
from tests.digest.digest import Hashes, Item

SMALL = ("--updates", 6, "--hidden", 8, "--set", "batch_size=8")
OFFLINE = (*SMALL, "--value-term", "value_expert")
ONLINE = (*SMALL, "--world", "crossing7")
DIAL = ("--updates", 6, "--hidden", 8, "--set", "expert_batch=8")
ACTS = ("--set", "replay_batch=8")
ANGLES = ("--angle", 0, 45, "--strength", 2, "--seed", 0, 1)

IQ_LEARN: dict[str, tuple[object, ...]] = {
    **{
        f"online/{prior}": (*ONLINE, *ANGLES, "--prior", prior)
        for prior in ("none", "reward", "bellman_shift", "reweighting", "shifted_chi2")
    },
    **{
        f"offline/{prior}": (*OFFLINE, *ANGLES, "--prior", prior)
        for prior in ("none", "reward", "bellman_shift", "reweighting", "shifted_chi2")
    },
    **{
        f"returns/{kind}": (*ONLINE, "--angle", 45, "--set", f"target_kind={kind}")
        for kind in ("to_go", "trajectory", "instantaneous", "advantage", "advantage_fitted")
    },
    **{
        f"divergence/{name}": (*ONLINE, "--prior", "none", "--divergence", name)
        for name in ("kl", "reverse_kl", "hellinger", "js")
    },
    "dueling": (*OFFLINE, "--set", "form=dueling"),
    "value/v0": (*SMALL, "--value-term", "v0"),
    "chi2/mixture": (*ONLINE, "--set", "chi2_on=mixture", "--prior", "none"),
    "next/online": (*ONLINE, "--set", "next_value=online"),
    **{
        f"preset/{name}": ("--preset", name, *(ONLINE if online else SMALL))
        for name, online in {
            "table-c1": True,
            "poc": True,
            "grid": True,
            "lambda-sweep": True,
            "few-offline": False,
            "few-online": True,
        }.items()
    },
}
"""Options of `train iq-learn` with demonstrations of the 7x7 world."""

OTHERS: dict[str, tuple[object, ...]] = {
    "behaviour-cloning": SMALL,
    "cql": (*SMALL, *ANGLES),
}

CONTINUOUS: dict[str, tuple[object, ...]] = {
    "iq_learn": ("iq-learn", *OFFLINE),
    "iq_learn-online": ("iq-learn", *SMALL, "--world", "intersection-continuous"),
    "td3-bc": ("td3-bc", *SMALL),
    "behaviour-cloning": ("behaviour-cloning", *SMALL),
    "standardised": ("iq-learn", *OFFLINE, "--standardise"),
    "preset/iq-learn": (
        "iq-learn", *SMALL, "--preset", "intersection-continuous",
        "--world", "intersection-continuous",
    ),
    "iq_learn-dial": ("iq-learn", *OFFLINE, "--set", "dial=true"),
}  # fmt: skip
"""Learner and options, with demonstrations of continuous actions."""

WITHOUT_DATA: dict[str, tuple[object, ...]] = {
    "sac": ("sac", *SMALL, "--world", "intersection-continuous"),
    "sac-dial": ("sac", *SMALL, "--world", "intersection-continuous", "--set", "dial=true"),
}

DIALS: dict[str, tuple[object, ...]] = {
    "online": ("--preset", "online", *DIAL, *ACTS),
    "online-short": ("--preset", "online-short", *DIAL, *ACTS),
    "online-quick": ("--preset", "online-quick", *DIAL, *ACTS),
    "online-clockless": ("--preset", "online-clockless", *DIAL, *ACTS),
    "offline": ("--preset", "offline", *DIAL),
    "offline-redrawn": ("--preset", "offline-redrawn", *DIAL),
    "offline-regularised": DIAL[:4],
    "one-angle": ("--preset", "offline", "--angle", 30, *DIAL),
    "pair": ("--preset", "online", "--set", "heads=pair", "backup=double", *DIAL, *ACTS),
}
"""Options of `train dial` or `train offline-dial` in the 7x7 world, by name of the item."""


ROAD_DATA = (
    "--driver", "a=results/intersection/atlas/prosocial.safetensors",
    "--driver", "b=results/intersection/atlas/egoistic.safetensors",
)  # fmt: skip
"""Drivers of demonstrations on the road."""

ON_ROADS: dict[str, tuple[object, ...]] = {
    **{
        f"iq_learn/preset/{name}": ("iq-learn", *OFFLINE, "--preset", name)
        for name in ("intersection-thesis", "intersection-calibrated")
    },
    "iq_learn/preset/intersection-shifted": (
        "iq-learn", *SMALL, "--preset", "intersection-shifted",
        "--world", "socialiq/Intersection-v1",
    ),
    **{
        f"view/{view}": ("behaviour-cloning", *SMALL, "--set", f"view={view}")
        for view in ("flat_relative_scaled", "set_ahead")
    },
}  # fmt: skip
"""Learner and options, with demonstrations of the intersection."""

ACTED = ("--updates", 4, "--hidden", 8, "--set", "environments=2", "replay_batch=8")
LABELLED = (
    "--updates", 2, "--environments", 4, "--set", "states_per_update=2", "batch_size=8",
    "first_rounds=1",
)  # fmt: skip
CLOCK_DIAL = "results/intersection-dial-clock/iterated.safetensors"

ALONE: dict[str, tuple[object, ...]] = {
    "dial/online-classes": (
        "dial", "--world", "crosswalk7", "--preset", "online-classes", *ACTED,
    ),
    "dial/intersection": ("dial", "--world", "intersection", *ACTED, "demonstrations=false"),
    "dqn": ("dqn", "--world", "crossing7", "--updates", 6, "--hidden", 8, "--angle", 0, 45),
    "dial/merge": ("dial", "--world", "merge", *ACTED, "demonstrations=false"),
    "improve-dial/intersection": ("improve-dial", CLOCK_DIAL, *LABELLED),
    "improve-dial/caused": (
        "improve-dial", CLOCK_DIAL, "--world", "intersection-caused", *LABELLED,
    ),
    "improve-dial/fleet": ("improve-dial", CLOCK_DIAL, "--agents", 3, *LABELLED),
    "improve-dial/shifted": (
        "improve-dial", CLOCK_DIAL, "--shift", "none or late", "straight", *LABELLED,
    ),
    "improve-dial/bicycles": (
        "improve-dial", "--world", "intersection-crosswalk-bicycles", *LABELLED,
    ),
    "driver": (
        "driver", "--set", "hidden=8", "updates=2", "states_per_update=1", "batch_size=8",
        "first_rounds=1", "replay_capacity=400",
    ),
    "continuous/preset/sac": (
        "sac", "--world", "intersection-continuous", "--preset", "intersection-continuous", *SMALL,
    ),
}  # fmt: skip
"""Words of trainings without demonstrations."""

OWN = """
import dataclasses

import jax
import jax.numpy as jnp

from socialiq import Learner


@dataclasses.dataclass(frozen=True)
class Numbers:
    angle: float = 0.0
    strength: float = 1.0
    learning_rate: float = 1e-3
    polyak: float = 0.01
    seed: int = 0
    dataset: int = 0


class Weighted(Learner):
    name = "weighted"
    Hyperparameters = Numbers

    def loss(self, network, target_network, batch, hyperparameters):
        pair, weights = batch.target, hyperparameters.weights
        score = weights.env * pair.env + weights.social * pair.social
        counts = jax.nn.softmax(hyperparameters.strength * score)
        logits = jax.nn.log_softmax(jax.vmap(network)(batch.observation))
        taken = jnp.take_along_axis(logits, batch.action[:, None], axis=1)[:, 0]
        likelihood = -jnp.sum(counts * taken)
        return likelihood, {"likelihood": likelihood, "loss": likelihood}
"""
"""A learner of a user, as docs/extend.md has it."""


def hashes_of(folder: Path, sizes: tuple[int, int], angle: float | None) -> Hashes:
    """Hash a folder of trained networks, and their greedy actions."""
    states = observations(sizes[0])
    if sizes[1] == 3 and sizes[0] < 20:
        states = np.abs(np.rint(3.0 * states)).astype(np.float32)  # integers, as gridworlds show
    actions = {
        f"actions/{name}": actions_of(path, sizes, angle, states)
        for name, path in networks_of(folder).items()
    }
    return of_networks(folder) | actions


def trained(learner: str, words: tuple[object, ...], folder: Path) -> Hashes:
    """Train with demonstrations of the 7x7 world."""
    data = collected(folder, "crossing7")
    call("train", learner, data, *words, "--out", folder / "run")
    return hashes_of(folder / "run", grid_sizes(), None)


def grid_sizes(clock: bool = False) -> tuple[int, int]:
    """Return the numbers of features and actions of the 7x7 world."""
    import socialiq

    world = socialiq.make("crossing7")
    return world.n_features + clock, world.n_actions


def trained_continuously(words: tuple[object, ...], shown: bool, folder: Path) -> Hashes:
    """Train at the intersection with continuous actions, with or without demonstrations."""
    world = "intersection-continuous"
    drivers = ("--driver", "atlas:expert_prosocial", "--driver", "idm")
    data = [collected(folder, world, *drivers, episodes=2)] if shown else []
    learner, *options = words
    call("train", learner, *data, *options, "--out", folder / "run")
    return of_networks(folder / "run")


def dialled(name: str, words: tuple[object, ...], folder: Path) -> Hashes:
    """Train a dial of the 7x7 world."""
    clock = "online-clockless" not in words
    data = collected(folder, "crossing7", *(["--clock"] if clock else []))
    learner = "offline-dial" if name == "offline-regularised" else "dial"
    call("train", learner, data, "--world", "crossing7", *words, "--out", folder / "run")
    angle = 30.0
    return hashes_of(folder / "run", grid_sizes(clock), angle)


def dialled_alone(folder: Path) -> Hashes:
    """Train a dial of the 7x7 world without demonstrations."""
    words = ("--preset", "online-alone", "--updates", 6, "--hidden", 8, *ACTS)
    call("train", "dial", "--world", "crossing7", *words, "--out", folder / "run")
    return hashes_of(folder / "run", grid_sizes(True), 30.0)


def trained_on_road(words: tuple[object, ...], folder: Path) -> Hashes:
    """Train with demonstrations of the intersection."""
    data = folder / "data.safetensors"
    call("collect", "socialiq/Intersection-v1", *ROAD_DATA, "--episodes", 3, "--out", data)
    learner, *options = words
    call("train", learner, data, *options, "--out", folder / "run")
    return of_networks(folder / "run")


def trained_alone(words: tuple[object, ...], folder: Path) -> Hashes:
    """Train in a world without demonstrations."""
    call("train", *words, "--out", folder / "run")
    return of_networks(folder / "run")


def trained_by_own(folder: Path) -> Hashes:
    """Train by a learner of a user's file."""
    (folder / "mine.py").write_text(OWN)
    data = collected(folder, "crossing7")
    words = ("--updates", 6, "--hidden", 8, "--set", "batch_size=8", *ANGLES, "--allow-code")
    call("train", "own", f"{folder / 'mine.py'}:Weighted", data, *words, "--out", folder / "run")
    return hashes_of(folder / "run", grid_sizes(), None)


def trained_by_practice(folder: Path) -> Hashes:
    """Train a dial of a recorded junction that practises there."""
    world = junction_file(folder)
    (recording,) = (folder / "imported").glob("*.safetensors")
    call("data", "demonstrations", recording, "--out", folder / "data.safetensors")
    words = ("--updates", 4, "--hidden", 8, "--rounds", 1, "--episodes", 2)
    data = folder / "data.safetensors"
    call("train", "practised-dial", data, "--world", world, *words, "--out", folder / "run")
    return of_networks(folder / "run")


ITEMS = [
    *(
        Item(f"learner/{name}", functools.partial(trained_on_road, words))
        for name, words in ON_ROADS.items()
    ),
    *(
        Item(f"learner/{name}", functools.partial(trained_alone, words))
        for name, words in ALONE.items()
    ),
    Item("learner/own", trained_by_own),
    Item("learner/practised-dial", trained_by_practice, ("shapely",)),
    *(
        Item(
            f"learner/iq_learn/{name}",
            functools.partial(trained, "iq-learn", words),
            quick=name in ("online/reward", "offline/shifted_chi2"),
        )
        for name, words in IQ_LEARN.items()
    ),
    *(
        Item(f"learner/{name}", functools.partial(trained, name, words), quick=True)
        for name, words in OTHERS.items()
    ),
    *(
        Item(
            f"learner/continuous/{name}",
            functools.partial(trained_continuously, words, data is CONTINUOUS),
            quick=name == "td3-bc",
        )
        for data in (CONTINUOUS, WITHOUT_DATA)
        for name, words in data.items()
    ),
    *(
        Item(
            f"learner/dial/{name}", functools.partial(dialled, name, words), quick=name == "offline"
        )
        for name, words in DIALS.items()
    ),
    Item("learner/dial/online-alone", dialled_alone),
]
