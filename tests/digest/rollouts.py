"""Whole episodes of rule-based and shipped drivers: sums, effects, fleets, evidence of an audit."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from tests.digest.batches import world_named
from tests.digest.digest import Hashes, Item, of_array, of_arrays, of_plain

SEEDS = range(100, 108)

RULES: dict[str, tuple[str, ...]] = {
    "intersection": (
        "go", "idle", "stop_line", "gap_2s", "gap_3s", "gap_4s", "wait", "idm", "random",
    ),
    "intersection-continuous": ("go", "gap_3s", "idm", "wait"),
    "intersection-continuous-steering": ("go", "gap_3s", "idm", "wait", "random"),
    "intersection-crosswalk": ("go", "gap_3s", "wait", "idm"),
    "intersection-crosswalk-bicycles": ("go", "gap_3s", "idm"),
}  # fmt: skip
"""Rule-based drivers of each intersection."""

CONSTANT = {"merge": 5, "roundabout": 5, "two_way": 5}
"""Number of actions of each road without rules."""

ATLAS = {
    "intersection": ("expert_egoistic", "set_prosocial", "baseline", "prosocial", "altruistic"),
    "intersection-continuous": ("expert_prosocial",),
}
"""Shipped policies that drive; the rewards of a network's driver are rounded."""

MEASURED: dict[str, tuple[str, ...]] = {
    "intersection": ("go", "gap_3s", "wait"),
    "intersection-crosswalk": ("go", "gap_3s", "idm"),
    "intersection-crosswalk-bicycles": ("go", "gap_3s"),
    "merge": ("2", "3"),
    "roundabout": ("1", "3"),
    "two_way": ("1", "3"),
}
"""Drivers whose effects on others are measured; a number is a constant action."""

FLEETS = {
    "intersection": ("intersection", ("gap_3s", "go")),
    "merge": ("merge", ("2", "3")),
    "roundabout": ("roundabout", ("1", "3")),
}
"""Road and drivers of each fleet."""

EVIDENCE = (
    "crossing7",
    "intersection",
    "intersection-caused",
    "intersection-continuous",
    "intersection-crosswalk-bicycles",
    "merge",
    "roundabout-caused",
)
"""Worlds in which an audit drives its references and its trivial drivers."""


class Always:
    """Policy of one action in every state."""

    def __init__(self, action: int) -> None:
        self.action = action

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[np.ndarray, None]:
        """Return the action for each row of a batch."""
        del state, episode_start, deterministic
        return np.full(len(observation), self.action, np.int64), None


def driver_in(world: Any, name: str) -> Any:
    """Return a rule-based driver of a world, or the constant action of a number."""
    return Always(int(name)) if name.isdigit() else world.driver(name, 0)


def numbers(prefix: str, value: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the arrays of numbers in nested tuples, mappings and dataclasses, by their names."""
    if dataclasses.is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, dict):
        for name, entry in value.items():
            yield from numbers(f"{prefix}/{name}", entry)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        wide = {"f": np.float64, "b": np.bool_}.get(value.dtype.kind, np.int64)
        yield prefix, value.astype(wide)


def of_columns(value: Any, exact: bool = True) -> str:
    """Return the SHA-256 of all columns of numbers of a result."""
    columns = dict(numbers("", value))
    assert columns
    return of_arrays(columns, exact)


SUMMED = ("ending", "length", "speed", "stopped", "off_road")
"""Columns of the episodes of any road."""

AT_INTERSECTION = ("contact", "neighbours_collided", "entered", "conflicts", "pressed")
"""Further columns of the episodes of the intersection."""

CAUSED = (
    "r_eq_4_2", "ending", "at_fault", "braking", "gap", "helped", "harmed", "charged",
    "not_caused", "caused", "missed", "credited", "gained", "lost",
)  # fmt: skip
"""Columns of what a driver causes."""


def of_episodes(episodes: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """Return columns of episodes, with both sums of rewards."""
    totals = {"env": episodes.r_env, "social": episodes.r_social}
    return {"totals": totals} | {name: episodes[name] for name in names}


def at_the_intersection(world: Any, episodes: Any) -> dict[str, Any]:
    """Return the columns of episodes of the intersection."""
    names = world.batch(1).signal_names
    classical = {"env": episodes.classical_own, "social": episodes.classical_others}
    signals = {
        kind: np.stack([episodes[f"{prefix}_{name}"] for name in names], axis=1)
        for kind, prefix in (("signals", "signal"), ("active", "active"))
    }
    columns = of_episodes(episodes, (*SUMMED, *AT_INTERSECTION))
    return columns | {"classical": classical} | signals


def of_effects(effects: Any) -> dict[str, Any]:
    """Return the columns of what a driver causes."""
    from socialiq.evaluation.effects import PEOPLE
    from socialiq.worlds.highway.effects import RELATIONS

    columns = of_episodes(effects, CAUSED)
    columns["eq_4_2"] = columns.pop("r_eq_4_2")
    delay = np.stack([effects[f"delay_{name}"] for name in RELATIONS], axis=1)
    on_foot = np.stack([effects[f"signal_{name}"] for name in PEOPLE], axis=1)
    return columns | {"delay": delay, "on_foot": on_foot}


def by_rules(name: str, _folder: Path) -> Hashes:
    """Hash the sums and metrics of the episodes of each rule-based driver."""
    from socialiq.evaluation.episodes import episodes_of, policy_row

    world = world_named(name)
    hashes = {}
    for rule in RULES[name]:
        episodes = episodes_of(world.batch(len(SEEDS)), driver_in(world, rule), SEEDS)
        row = policy_row(rule, "greedy", episodes, world.action_size > 1)
        hashes[rule] = of_plain([of_columns(at_the_intersection(world, episodes)), row])
    return hashes


def by_constants(name: str, _folder: Path) -> Hashes:
    """Hash the sums and metrics of the episodes of each constant action."""
    from socialiq.evaluation.episodes import episodes_of
    from socialiq.evaluation.measures import DECISION

    world = world_named(name)
    hashes = {}
    for action in range(CONSTANT[name]):
        driver = driver_in(world, str(action))
        episodes = episodes_of(world.batch(len(SEEDS)), driver, SEEDS, quantities=DECISION)
        metrics = episodes.metrics()._asdict()
        hashes[str(action)] = of_plain([of_columns(of_episodes(episodes, SUMMED)), metrics])
    return hashes


def by_atlas(name: str, _folder: Path) -> Hashes:
    """Hash the sums and endings of the episodes of shipped policies, rounded."""
    from socialiq.evaluation.episodes import episodes_of
    from socialiq.worlds.intersection import atlas

    world = world_named(name)
    load = atlas.load_continuous if world.action_size else atlas.load
    hashes = {}
    for policy in ATLAS[name]:
        driver = load(policy)
        episodes = episodes_of(world.batch(len(SEEDS)), driver, SEEDS)
        hashes[policy] = of_columns(at_the_intersection(world, episodes), False)
    return hashes


def with_effects(name: str, _folder: Path) -> Hashes:
    """Hash what drivers cause, by episode and in the mean, and the quantities of an audit."""
    from socialiq.evaluation.effects import measure, measuring, summary

    world = measuring(world_named(name))
    begun: Any = {}
    hashes = {}
    for rule in MEASURED[name]:
        effects = measure(world, driver_in(world, rule), SEEDS, begun)
        hashes[rule] = of_plain([of_columns(of_effects(effects)), summary(effects)])
    return hashes


def with_shield(_folder: Path) -> Hashes:
    """Hash the episodes of a driver that a shield brakes for people."""
    from socialiq.evaluation.episodes import episodes_of
    from socialiq.evaluation.shield import shielded

    world = world_named("intersection-crosswalk-bicycles")
    batch = world.batch(len(SEEDS))
    driver = shielded(driver_in(world, "go"), batch, 2.0)
    episodes = episodes_of(batch, driver, SEEDS)
    return {"go": of_columns(at_the_intersection(world, episodes))}


def in_fleets(road: str, drivers: tuple[str, ...], _folder: Path) -> Hashes:
    """Hash the episodes of fleets of two drivers, by agent."""
    from socialiq.evaluation.fleet import drive
    from socialiq.worlds.registry import make_fleet

    world = make_fleet(road, 4)
    chosen = [driver_in(world, name) for name in drivers]
    episodes = drive(world.batch(len(SEEDS)), chosen, SEEDS)
    columns = {name.removeprefix("signal_"): column for name, column in episodes.items()}
    agents = {
        "rewards": {"env": episodes.r_env, "social": episodes.r_social},
        "ending": episodes.ending,
        "decisions": episodes.length,
        "signals": {name: columns[name] for name in columns if f"signal_{name}" in episodes},
    }
    return {"agents": of_columns(agents)}


def branched(_folder: Path) -> Hashes:
    """Hash the returns of each action in states of the intersection, by rollouts in copies."""
    from socialiq.evaluation.branching import branched_returns

    world = world_named("intersection")
    batch = world.batch(4)
    batch.reset(3)
    driver = driver_in(world, "gap_3s")
    returns = []
    for _ in range(6):
        actions = driver.predict(batch.observation)[0]
        returns.append(np.stack(branched_returns(batch, lambda seen: driver.predict(seen)[0])))
        batch.step(actions)
    return {"returns": of_array(np.array(returns, np.float64), exact=True)}


def as_evidence(name: str, _folder: Path) -> Hashes:
    """Hash the evidence of an audit in a world by its name."""
    return evidence_in(world_named(name))


def in_environment(name: str, effects: tuple[str, ...], episodes: int, _folder: Path) -> Hashes:
    """Hash the evidence of an audit in an environment, whose episodes run one by one."""
    from socialiq.audit.profile.profile import world_of

    return evidence_in(world_of(name, {}), effects, episodes)


def evidence_in(world: Any, effects: tuple[str, ...] | None = None, episodes: int = 12) -> Hashes:
    """Hash the outcomes of all drivers of an audit: references, optima and trivial drivers."""
    from socialiq.audit.evidence.drive import Course, exact_optima, trivial_drivers
    from socialiq.audit.evidence.outcomes import Reference

    if effects is None:
        quantities = ("delay",) if world.is_exact else ("delay", "braking", "gap_below_1_s")
        effects = () if world.action_size else quantities
    course = Course(world, np.arange(300, 300 + episodes), measured=effects)
    references = [Reference(rule, world.driver(rule)) for rule in world.references]
    outcomes = [course.drive(reference) for reference in references]
    outcomes += exact_optima(course) if world.is_exact else ()
    outcomes += trivial_drivers(course)
    hashes = {}
    for driver in outcomes:
        names = ("ending", "contact", "length", "at_fault", *driver.measured)
        columns = {"totals": driver.totals} | {name: driver.episodes[name] for name in names}
        hashes[driver.name] = of_columns(columns, exact=not world.is_exact)
    return hashes


ITEMS = [
    *(Item(f"rules/{name}", functools.partial(by_rules, name), quick=True) for name in RULES),
    *(
        Item(f"rules/{name}", functools.partial(by_constants, name), quick=True)
        for name in CONSTANT
    ),
    *(Item(f"atlas/{name}", functools.partial(by_atlas, name), quick=True) for name in ATLAS),
    *(
        Item(f"effects/{name}", functools.partial(with_effects, name), quick=True)
        for name in MEASURED
    ),
    Item("shield/intersection-crosswalk-bicycles", with_shield, quick=True),
    *(
        Item(f"fleet-of-rules/{name}", functools.partial(in_fleets, *fleet), quick=True)
        for name, fleet in FLEETS.items()
    ),
    Item("branched-returns/intersection", branched, quick=True),
    *(
        Item(f"evidence/{name}", functools.partial(as_evidence, name), quick=True)
        for name in EVIDENCE
    ),
    Item(
        "evidence/two_way-environment",
        functools.partial(in_environment, "two_way", ("delay",), 6),
        quick=True,
    ),
    Item(
        "evidence/sumo",
        functools.partial(in_environment, "sumo", ("delay", "waiting"), 1),
        ("libsumo",),
    ),
]
