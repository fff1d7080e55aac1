"""Tiny runs of every study: every table, the summary and the other files' names."""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path
from typing import Any

from safetensors.numpy import load_file
from tests.digest.digest import Hashes, Item, of_arrays, of_plain

SMALL: dict[str, Any] = {"hidden": (8,), "updates": 2, "batch_size": 4}
FLAT: dict[str, Any] = {"view": "flat", "hidden": (8,)}
CLONE = {**FLAT, "batch_size": 8, "updates": 20}
DIAL = {
    **FLAT,
    "updates": 30,
    "expert_batch": 8,
    "replay_batch": 8,
    "replay_capacity": 5000,
}

OPTIONS: dict[str, dict[str, Any]] = {
    "worlds": {"episodes": 20},
    "poc": {"seeds": (0,), "updates": 20, "readings": False},
    "grid": {
        "seeds": (0, 1),
        "updates": 20,
        "episodes_each": 3,
        "transitions_each": 30,
        "target_kinds": ("running", "to_go", "trajectory", "instantaneous"),
        "strengths": (2.0,),
    },
    "lambda-sweep": {
        "seeds": (0, 1),
        "updates": 20,
        "checkpoint_every": 10,
        "episodes_each": 3,
        "strengths": (0.0, 5.0),
        "target_kinds": ("instantaneous",),
    },
    "alternatives": {"seeds": (0,), "updates": 10, "episodes_each": 3, "strengths": (1.0,)},
    "penalties": {"seeds": (0,), "updates": 10, "episodes_each": 3, "strengths": (1.0,)},
    "theory": {
        "seeds": (0,),
        "updates": 20,
        "episodes_each": 3,
        "angles": (0.0,),
        "random_worlds": 1,
        "target_kinds": ("instantaneous",),
        "units": (0.2, 0.8),
        "lengths": (0.0, 1.0),
    },
    "dial": {
        "seeds": (0,),
        "updates": 20,
        "episodes_each": 3,
        "runs": ("offline",),
        "budgets": (0.5,),
        "budget_seeds": (0,),
        "wanted": (0.0, 45.0, 90.0),
        "rollouts": 5,
    },
    "off-policy": {
        "worlds": ("crossing5",),
        "seeds": (0,),
        "episodes_each": 10,
        "explored": (0.0, 0.3),
        "angles": (0.0, 45.0),
        "resamples": 20,
    },
    "intersection-world": {"episodes": 30, "reading_episodes": 10},
    "intersection": {
        "parts": ("main",),
        "seeds": (0, 1),
        "expert_seed": 0,
        "expert_steps": 9600,
        "updates": 40,
        "pool_episodes": 12,
        "size": 60,
        "episodes": 20,
        "evaluation_seeds": 2,
        "group_episodes": 5,
        "highway_episodes": 0,
    },
    "intersection-dial": {
        "seeds": (0, 1),
        "key_angles": (0.0, 90.0),
        "turned": (0.0, 45.0, 90.0),
        "structure": DIAL,
        "agent_updates": 20,
        "pool_episodes": 12,
        "size": 60,
        "episodes": 12,
    },
    "intersection-offline": {
        "seeds": (0, 1),
        "angles": (0.0, 45.0, 90.0),
        "methods": (
            "clone weighted by R(α)",
            "clone weighted by advantage",
            "clone of the mode",
            "clone of all",
            "IQ-Learn, dueling, reweighted",
            "IQ-Learn online, shifted χ²",
        ),
        "method_angles": (0.0, 90.0),
        "structure": CLONE,
        "updates": 20,
        "together": 2,
        "pool_episodes": 12,
        "size": 60,
        "episodes": 12,
    },
    "intersection-continuous": {
        "seeds": (0, 1),
        "learner_seeds": (2, 3),
        "expert_seed": 4,
        "angles": (0.0, 45.0, 90.0),
        "expert": SMALL,
        "continuous": SMALL,
        "high_angles": SMALL,
        "discrete": {"hidden": (8,), "updates": 2, "replay_batch": 4},
        "learner": SMALL,
        "longer": SMALL,
        "clone": SMALL,
        "td3_bc": SMALL,
        "pool_episodes": 6,
        "size": 20,
        "environments": 4,
        "episodes": 6,
        "first_episode": 50_000_000,
    },
    "audit-power": {"episodes": 60, "replications": 4, "resamples": 100, "owners": 2},
    "audits": {
        "episodes": 20,
        "updates": 20,
        "dial_updates": 20,
        "dial_angles": (0.0, 90.0),
        "worlds": ("crossing7",),
    },
    "angle-trait": {
        "first_episode": 50_801_000,
        "repeats": 1,
        "drivers": 3,
        "lengths": (2,),
        "spreads": (0.0,),
        "step": 90.0,
    },
    "classic-control": {
        "seeds": (0,),
        "tasks": ("CartPole",),
        "protocols": ("rows",),
        "trajectories": (1,),
        "methods": ("iq_learn", "cloning"),
        "published": (),
        "variants": ("online: endings worth 0",),
        "sets": 2,
        "episodes": 2,
        "updates": 20,
    },
    "mujoco-imitation": {
        "tasks": ("Hopper",),
        "trajectories": (5,),
        "seeds": (100,),
        "variants": ("absorbing states", "regression"),
        "expert_updates": 40,
        "updates": 30,
        "every": 20,
        "judged": 1,
        "episodes": 1,
        "expert_episodes": 2,
        "data_seed": 50_000_000,
        "judging_seed": 50_100_000,
        "evaluation_seed": 50_200_000,
    },
    "compare-priors": {
        "worlds": ("crossing5",),
        "angles": (0.0, 90.0),
        "development_angles": (0.0,),
        "strengths": (1.0,),
        "development_seeds": (0,),
        "seeds": (10, 11),
        "updates": 10,
    },
    "compare-methods": {
        "worlds": ("crossing5",),
        "methods": ("clone", "clone_of_mode", "outcome_conditioned"),
        "angles": (0.0, 30.0, 90.0),
        "development_angles": (15.0,),
        "development_seeds": (0,),
        "seeds": (10, 11),
        "updates": 3,
    },
    "mo-gymnasium": {"train": False},
}
"""Options of a tiny run by study; a mapping changes fields of the default value."""

VOLATILE = ("seconds", "longest", "updates_per_second", "device", "rate")
"""Columns of times, which differ from run to run."""
VOLATILE_TABLES = ("times", "speed", "speeds")

NEEDS = {"mujoco-imitation": ("mujoco",)}
QUICK = ("audit-power", "off-policy", "mo-gymnasium")


def tiny(study: Any, options: dict[str, Any]) -> Any:
    """Return a study's configuration with some options changed, fields of dataclasses too."""
    default = study.Config()
    changed = {
        name: dataclasses.replace(getattr(default, name), **value)
        if isinstance(value, dict)
        else value
        for name, value in options.items()
    }
    return dataclasses.replace(default, **changed)


def tables_of(name: str, options: dict[str, Any], folder: Path) -> Hashes:
    """Run a study; hash each table, the summary and the names of its other files."""
    from socialiq_lab.engine import Engine
    from socialiq_lab.registry import find
    from socialiq_lab.study import run

    study = find(name)
    results = run(study, tiny(study, options), work=folder / "work", engine=Engine(processes=1))
    hashes = {
        table: of_plain([without_times(row) for row in rows])
        for table, rows in results.tables.items()
        if table not in VOLATILE_TABLES
    }
    hashes["summary"] = of_plain(without_times(results.summary))
    if results.files:
        hashes["files"] = of_plain(sorted(results.files))
    networks = sorted((folder / "work").rglob("*.safetensors"))
    if networks:
        hashes["networks"] = of_plain(sorted(of_arrays(load_file(path)) for path in networks))
    return hashes


def without_times(value: Any) -> Any:
    """Return rows or a summary without what is measured in seconds."""
    if isinstance(value, dict):
        kept = {name: one for name, one in value.items() if name not in VOLATILE}
        return {name: without_times(one) for name, one in kept.items()}
    if isinstance(value, list | tuple):
        return [without_times(one) for one in value]
    return value


ITEMS = [
    Item(
        f"study/{name}",
        functools.partial(tables_of, name, options),
        NEEDS.get(name, ()),
        name in QUICK,
    )
    for name, options in OPTIONS.items()
]
