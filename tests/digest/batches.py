"""Episodes side by side in every world: decisions, copies, places of road users, effects.

What a driver, a learner, a picture or a table reads is hashed, by names that describe it. Records
and layouts of the cores are not: `vehicles_of` and `people_of` read named columns of them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tests.digest.digest import Hashes, Item, of_array, of_arrays, of_plain

ROWS = 3
DECISIONS = 50
"""Decisions of each row, after which copies of the rows drive on."""
AFTER = 6
"""Decisions of the copies."""
CHANGED = 0.2
"""Share of the decisions in which a row draws another action."""
PLACE = ("x", "y", "heading", "speed")
"""Columns of a road user: m, rad, m/s."""

GRIDS: dict[str, dict[str, Any]] = {
    "crossing5": {},
    "crossing7": {},
    "crosswalk7": {},
    **{f"crosswalk7-{angle}": {} for angle in range(0, 91, 15)},
}
"""Options of each gridworld."""

ROADS: dict[str, dict[str, Any]] = {
    "intersection": {},
    "intersection-caused": {},
    "intersection-continuous": {},
    "intersection-continuous-steering": {},
    "intersection-continuous-steering-offroad": {},
    "intersection-crosswalk": {},
    "intersection-crosswalk-caused": {},
    "intersection-crosswalk-bicycles": {},
    **{f"intersection-crosswalk-{angle}": {} for angle in range(0, 91, 15)},
    **{
        name + ending: {}
        for name in ("merge", "roundabout", "two_way")
        for ending in ("", "-caused")
    },
    "road": {"seed": 4},
}
"""Options of each road with one ego."""

FLEETS: dict[str, tuple[str, dict[str, Any]]] = {
    **{name: (name, {"agents": 3}) for name in ("intersection", "merge", "roundabout", "two_way")},
    "intersection-joint": ("intersection", {"agents": 4, "ends": "joint"}),
    "intersection-as-highway-env": (
        "intersection",
        {
            "agents": 4,
            "simulation_frequency": 15,
            "duration": 13.0,
            "initial_vehicle_count": 10,
            "spawn_probability": 0.6,
            "observed_vehicles": 15,
            "ends": "joint",
            "frame": "world",
        },
    ),
    "intersection-frame": ("intersection", {"agents": 5, "frame": "world"}),
    "roundabout-joint": ("roundabout", {"agents": 2, "ends": "joint"}),
    "road": ("road", {"agents": 3, "seed": 3}),
}
"""Road and options of each fleet."""

GRID_OPTIONS: dict[str, tuple[dict[str, Any], ...]] = {
    "crossing5": (
        {"ends_on": "both_arrived"},
        {"ends_on": "time_limit"},
        {"social_cost": "always"},
        {"arrival": "override"},
    ),
    "crossing7": (
        {"spawn_probability": 0.8},
        {"second_slot_refills": "same_step"},
        {"second_slot_at_start": "random"},
        {"first_slot": "once"},
        {"conflict": "end_cell"},
        {"braking": "one_level"},
        {"arrival": "added"},
        {"full_stop": "flat"},
        {"yield_zone": "with_conflict"},
        {"yield_zone": "with_conflict", "slow_yield": "full"},
    ),
    "crosswalk7": (
        {"pedestrian_probability": 0.6},
        {"impatience": 0.0},
    ),
}
"""Other values of each option of a gridworld."""

NAMED: tuple[dict[str, Any], ...] = (
    {"counted": "cross"},
    {"counted": "approaching"},
    {"disruption": "literal"},
    {"crash": "add"},
)
ZONES: tuple[dict[str, Any], ...] = (
    {"zone": "last_8_m"},
    {"zone": "beyond_8_m"},
    {"zone": "travelled_8_m"},
)
"""Other values of each option of the social reward that has names."""

ROAD_OPTIONS: dict[str, tuple[dict[str, Any], ...]] = {
    "intersection": (
        *NAMED,
        *ZONES,
        {"destination": "right"},
        {"destination": "straight"},
        {"destination": "random"},
        {"population": "thesis"},
        {"population": "wet"},
        {"connected_lanes": True},
        {"canonical": True},
        {"policy_frequency": 2},
        {"simulation_frequency": 15},
        {"initial_vehicle_count": 10},
        {"observed_vehicles": 15},
        {"target_speeds": (0.0, 3.0, 6.0, 9.0)},
        {"duration": 8.0},
        {"observation": "route"},
        {"see_behind": True},
        {"progress_weight": 1.0, "yielding_weight": 0.5, "speed_cap": 3.0},
        {"left_hand": True},
    ),
    "intersection-caused": (
        {"after_timeout": "removed", "duration": 8.0},
        {"after_timeout": "traffic", "duration": 8.0},
        {"tow_after": 0.0},
        {"horizon": 25.0},
        {"population": "thesis"},
    ),
    "intersection-crosswalk": (
        {"pedestrian_rate": 0.3},
        {"impatience": 0.5},
        {"cyclist_rate": 0.3},
        {"observed_pedestrians": 2},
        {"destination": "straight"},
        {"observation": "route"},
    ),
    "merge": (
        *NAMED,
        *ZONES,
        {"observed_vehicles": 3},
        {"policy_frequency": 5},
        {"left_hand": True},
        {"observation": "route"},
    ),
    "roundabout": (*NAMED, {"duration": 20.0}, {"observation": "route"}),
    "two_way": (*NAMED, {"target_speeds": (20.0, 30.0)}),
}
"""Other values of options of a road."""

SHIFTS = {
    **{
        name: name
        for name in (
            "none", "late", "unseen-10", "unseen-30", "near", "occluded", "noise-1", "noise-3",
            "drift-2", "right", "straight", "connected", "dense", "drivers", "twice", "wet",
        )
    },
    "late-2": "latency=2",
    "drawn": "none or late,noise=2 or unseen=.3",
    "together": "dense,noise-1,near,connected",
}  # fmt: skip
"""Text of each shift of the intersection."""

FRONT_ENDS = {
    "track": ("unseen-30", "track=3"),
    "noise": ("noise-3", "track=3,noise=3"),
    "latency": ("late", "latency=1"),
    "latency-2": ("latency=2", "latency=2,track=3"),
    "rate": ("twice", "known"),
    "exit": ("straight", "exit=own"),
    "exit-named": ("none", "exit=right"),
    "known": ("late,noise=1,unseen=.3", "known,exit=own"),
    "drawn": ("none or late or noise=2", "known"),
    "wet": ("late,wet", "known"),
}
"""Shift and front end by name."""


def world_named(name: str, **options: Any) -> Any:
    """Return a world with options."""
    from socialiq.worlds.registry import open_world

    return open_world(name, **options)


def results_of(decisions: Any) -> dict[str, np.ndarray]:
    """Return the results of one decision of every row, by name."""
    social = decisions.rewards.social
    parts = social if isinstance(social, tuple) else (social,)
    columns = {
        "observations": decisions.observation,
        "r_env": decisions.rewards.env,
        **{f"r_social_{number}": part for number, part in enumerate(parts)},
        "endings": decisions.ending,
        "contacts": decisions.contact,
        **{f"signal_{name}": values for name, values in decisions.signals.items()},
    }
    further = {
        "speeds": decisions.speed,
        "others_collided": decisions.neighbours_collided,
        "off_road": decisions.off_road,
        "classical_own": decisions.classical.env,
        "classical_others": decisions.classical.social,
    }
    return columns | {name: values for name, values in further.items() if len(values)}


def stacked(rows: Sequence[dict[str, Any]]) -> dict[str, np.ndarray]:
    """Return columns of all decisions, floats as float64 but for observations."""
    columns = {name: np.stack([np.asarray(row[name]) for row in rows]) for name in rows[0]}
    return {
        name: values
        if name == "observations" or values.dtype.kind != "f"
        else values.astype(np.float64)
        for name, values in columns.items()
    }


def in_groups(columns: dict[str, np.ndarray]) -> Hashes:
    """Return a hash of observations, of rewards, of signals, and of everything else."""
    groups: dict[str, dict[str, np.ndarray]] = {}
    for name, values in columns.items():
        starts = {"r_": "rewards", "signal_": "signals", "observations": "observations"}
        group = next((starts[start] for start in starts if name.startswith(start)), "endings")
        groups.setdefault(group, {})[name] = values
    return {group: of_arrays(values, exact=True) for group, values in groups.items()}


def vehicles_of(scene: Any) -> dict[str, np.ndarray]:
    """Return the places of the vehicles of a scene, in its order."""
    return {name: scene.vehicles[name].astype(np.float64) for name in PLACE}


def people_of(scene: Any) -> dict[str, np.ndarray]:
    """Return the places of the people of a scene, in its order."""
    people = scene.people
    return {name: np.array(people[name] if len(people) else [], np.float64) for name in PLACE}


def places_of(batch: Any) -> dict[str, Any]:
    """Return the places of everybody in all rows: vehicles and people."""
    from socialiq.worlds.highway.render import present_scene

    if hasattr(batch, "places"):  # of a recorded junction, where people have high numbers
        rows = [sorted(batch.places(row)) for row in range(batch.size)]
        kinds = {"vehicles": lambda number: number < 1_000_000}
        kinds["people"] = lambda number: number >= 1_000_000
        return {
            kind: of_plain([[[*map(repr, one)] for n, one in row if has(n)] for row in rows])
            for kind, has in kinds.items()
        }
    scenes = [present_scene(batch, row) for row in range(batch.size)]
    kinds = {"vehicles": vehicles_of, "people": people_of}
    return {
        kind: of_plain([of_arrays(read(scene), exact=True) for scene in scenes])
        for kind, read in kinds.items()
    }


class Watcher:
    """Policy that observes so many features and only shows what it is given."""

    def __init__(self, features: int) -> None:
        self.n_features = features


def actions_in(world: Any, shape: tuple[int, ...]) -> Callable[[], np.ndarray]:
    """Return a function that draws actions by one fixed stream, and keeps most for a while.

    So egos stand, drive on, run out of time and collide.
    """
    rng = np.random.default_rng(0)

    def drawn() -> np.ndarray:
        if world.action_size:
            return rng.uniform(-1.0, 1.0, (*shape, world.action_size)).astype(np.float32)
        return rng.integers(world.n_actions, size=shape)

    held = drawn()

    def draw() -> np.ndarray:
        changed = rng.random(shape) < CHANGED
        held[changed] = drawn()[changed]
        return held.copy()

    return draw


def driven(batch: Any, draw: Callable[[], np.ndarray], decisions: int) -> dict[str, np.ndarray]:
    """Drive a batch by drawn actions, with resets where an episode ends; return all results."""
    return stacked([results_of(batch.step(draw())) for _ in range(decisions)])


def in_copies(world: Any, batch: Any) -> Hashes:
    """Hash what a batch, the same one restored, and copies of its rows do next."""
    rows = [0, 0, ROWS - 1]
    state = batch.save()
    copies = batch.branch(rows)
    places = places_of(copies)
    drawn = [actions_in(world, batch.shape)() for _ in range(AFTER)]
    following = []
    for _ in range(2):
        batch.restore(state)
        following.append(of_arrays(driven(batch, iter(drawn).__next__, AFTER), exact=True))
    assert following[0] == following[1]
    of_rows = iter([actions[rows] for actions in drawn])
    results = of_arrays(driven(copies, of_rows.__next__, AFTER), exact=True)
    return {"restored": following[0], "copies": of_plain([places, results])}


def followed(world: Any) -> Hashes:
    """Drive episodes of a road side by side; hash results, places, copies, and what is seen."""
    batch = world.batch(ROWS)
    first = batch.reset(7)
    columns = driven(batch, actions_in(world, batch.shape), DECISIONS)
    sizes = (world.n_features, world.n_features + 1, *getattr(world, "narrow", ()))
    seen = [batch.seen_by(Watcher(features)) for features in dict.fromkeys(sizes)]
    return {
        **in_groups(columns),
        "seen": of_plain([of_array(one, exact=True) for one in (first, batch.time, *seen)]),
        **places_of(batch),
        **({"caused": caused_in(batch)} if batch.ledger is not None else {}),
        **in_copies(world, batch),
    }


def caused_in(batch: Any) -> str:
    """Hash metres and hard brakings of each other vehicle, with and without the ego."""
    ledger = batch.ledger
    counted = ledger.relation >= 0
    columns = {"relation": ledger.relation[counted].astype(np.int64)}
    columns |= {"without": ledger.without[counted], "driven": ledger.driven[counted]}
    return of_arrays(columns, exact=True)


def on_road(name: str, options: dict[str, Any], _folder: Path) -> Hashes:
    """Follow a road by its name."""
    return followed(world_named(name, **options))


def by_class(name: str, _folder: Path) -> Hashes:
    """Follow a road whose social reward has a part for each class of road users."""
    return followed(world_named(name).with_parts())


def shifted(shift: str, front_end: str, _folder: Path) -> Hashes:
    """Follow the intersection with a shift and a front end."""
    return followed(world_named("intersection").shifted(shift, front_end))


def in_fleet(name: str, options: dict[str, Any], _folder: Path) -> Hashes:
    """Follow a road with several agents, and hash who still drives after each decision."""
    from socialiq.worlds.registry import make_fleet

    world = make_fleet(name, **options)
    batch = world.batch(ROWS)
    batch.reset(7)
    draw = actions_in(world, batch.shape)
    driving = []
    while batch.running.any():
        batch.step(draw(), auto_reset=False, rows=batch.running)
        driving.append(batch.driving)
    return followed(world) | {"driving": of_array(np.array(driving))}


def sub_steps(name: str, options: dict[str, Any], _folder: Path) -> Hashes:
    """Hash the places of everybody in each sub-step, as films show them."""
    from socialiq.worlds.highway.render import decision_scenes

    world = world_named(name, **options)
    batch = world.batch(1, traced=True)
    draw = actions_in(world, batch.shape)
    batch.reset([3])
    lines = []
    for _ in range(DECISIONS // 2):
        ending = batch.step(draw(), auto_reset=False).ending[0]
        for scene in decision_scenes(batch):
            signals = {name: repr(float(value)) for name, value in scene.signals.items()}
            braking = scene.braking.tolist()
            parts = (vehicles_of(scene), people_of(scene))
            lines.append([repr(scene.time), braking, signals, *(of_arrays(p, True) for p in parts)])
        if ending:
            batch.reset(rows=[0])
    return {"scenes": of_plain(lines)}


def in_grid(name: str, options: dict[str, Any], _folder: Path) -> Hashes:
    """Hash the exact transitions of a gridworld, its episodes side by side, and what is seen."""
    world = world_named(name, **options)
    table = world.table().reachable_part()
    mdp = table.mdp
    exact = {
        "states": table.states,
        "initial": mdp.initial,
        "successor": mdp.successor,
        "probability": mdp.probability,
        "ending": mdp.ending,
        "speed": table.speed,
        **{f"signal_{name}": values for name, values in table.signals.items()},
    }
    pair = {"r_env": mdp.rewards.env, "r_social": mdp.rewards.social}
    batch = world.batch(ROWS)
    draw = actions_in(world, (ROWS,))
    batch.reset(np.arange(ROWS))
    rows = []
    for number in range(DECISIONS):
        step = batch.step(draw(), auto_reset=False)
        seen = [batch.seen_by(Watcher(world.n_features + more)) for more in (0, 1)]
        copied = batch.branch([1, 1]).seen_by(Watcher(world.n_features))
        env, social = step.rewards
        columns = {"r_env": env, "r_social": social, "ending": np.int64(step.ending)}
        columns |= {"seen": seen[0], "seen_with_time": seen[1], "copied": copied}
        rows.append(columns | {"contact": np.int64(step.contact)})
        ended = np.flatnonzero(step.ending)
        if len(ended):
            batch.reset(ROWS * (number + 1) + ended, rows=ended)
    return {
        "transitions": of_arrays(exact, exact=True),
        "reward_pairs": of_arrays(pair, exact=True),
        "episodes": of_arrays(stacked(rows), exact=True),
    }


def spelled(options: dict[str, Any]) -> str:
    """Return options as part of the name of an item."""
    texts = {
        name: ":".join(map(str, value)) if isinstance(value, tuple) else str(value)
        for name, value in options.items()
    }
    return ",".join(f"{name}={text}" for name, text in texts.items())


QUICK = ("crossing5", "crossing7", "crosswalk7")
"""Gridworlds of `make test`; every class angle is compiled again, two seconds each."""

TRACED = ("intersection", "intersection-crosswalk-bicycles", "merge", "roundabout", "two_way")

ITEMS = [
    *(
        Item(f"world/{name}", functools.partial(in_grid, name, options), quick=name in QUICK)
        for name, options in GRIDS.items()
    ),
    *(
        Item(f"world/{name}", functools.partial(on_road, name, options), quick=True)
        for name, options in ROADS.items()
    ),
    *(
        Item(f"fleet/{name}", functools.partial(in_fleet, *fleet), quick=True)
        for name, fleet in FLEETS.items()
    ),
    *(
        Item(f"shift/{name}", functools.partial(shifted, text, ""), quick=True)
        for name, text in SHIFTS.items()
    ),
    *(
        Item(f"front-end/{name}", functools.partial(shifted, *texts), quick=True)
        for name, texts in FRONT_ENDS.items()
    ),
    *(
        Item(f"by-class/{name}", functools.partial(by_class, name), quick=True)
        for name in ("intersection-crosswalk", "intersection-crosswalk-bicycles")
    ),
    *(
        Item(f"sub-steps/{name}", functools.partial(sub_steps, name, {}), quick=True)
        for name in TRACED
    ),
    *(
        Item(
            f"option/{world}/{spelled(options)}",
            functools.partial(compute, world, options),
        )
        for table, compute in ((GRID_OPTIONS, in_grid), (ROAD_OPTIONS, on_road))
        for world, several in table.items()
        for options in several
    ),
]
