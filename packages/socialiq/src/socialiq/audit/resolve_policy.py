"""Resolve names to drivers: the policy under audit, and the references to compare it with."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

from socialiq.audit.evidence.outcomes import Reference
from socialiq.errors import UserError
from socialiq.evaluation.rollout import MODES
from socialiq.foreign import one_line
from socialiq.nn.actor_policy import ActorDial
from socialiq.nn.dial_policy import DialPolicy
from socialiq.policies.interface import Interface, Loaded, Record
from socialiq.policies.isolation import IsolationMode, isolation_of
from socialiq.policies.load import KINDS, load_policy
from socialiq.policies.process import Limits
from socialiq.provenance import package_sha256
from socialiq.storage import kind_of
from socialiq.worlds.intersection import atlas
from socialiq.worlds.registry import INTERSECTIONS
from socialiq.worlds.world import World

ATLAS = "atlas:"

GAPS = ("gap_2s", "gap_3s", "gap_4s")

EVERY = 15.0  # degrees between the references that are made of a dial

RULE = "rule"
"""Kind of a rule-based driver, in its record."""

_RULE_COVERS = "the rule's name and this package's code"


@dataclasses.dataclass(frozen=True)
class Trust:
    """Permissions of a policy under audit.

    Attributes:
        allow_code: Whether a Python module may run without isolation, and an environment's module
            be imported.
        limits: Time and memory of a process.
        isolation: Isolation of processes and Python modules.
        files: Further files and folders of these.
    """

    allow_code: bool = False
    limits: Limits = dataclasses.field(default_factory=Limits)
    isolation: IsolationMode = "auto"
    files: tuple[str, ...] = ()


SUFFIXES = (".safetensors", ".zip", ".onnx")
"""Names of files that may be policies end so."""


def is_code(spec: str) -> bool:
    """Whether a policy is a program of its owner, and not data that this package's code runs."""
    return spec.startswith(("process:", "python:"))


def resolve_policy(spec: str, world: World, angle: float, trust: Trust) -> Loaded:
    """Load the policy under audit.

    Args:
        spec: As for `policies.load.load_policy`, `atlas:NAME`, or a rule-based driver's name.
        world: World of the declaration.
        angle: Declared angle in degrees, at which a dial is set.
        trust: Permissions.

    Raises:
        UserError: If it can't be read, or doesn't fit the world.
    """
    if spec.startswith(ATLAS):
        path = _shipped_file(spec.removeprefix(ATLAS), world)
        loaded = _file(str(path), world, angle, trust)
        return dataclasses.replace(loaded, record=dataclasses.replace(loaded.record, source=spec))
    if spec in world.drivers:
        return rule_of(spec, world)
    if ":" not in spec and not Path(spec).exists():
        if Path(spec).suffix in SUFFIXES:
            raise UserError(f"no such file: {one_line(spec)}")
        choices = list(KINDS)
        choices += ["atlas:NAME"] if world.name in INTERSECTIONS else []
        if world.drivers:
            choices.append(f"a rule-based driver ({', '.join(world.drivers)})")
        raise UserError(f"no policy '{one_line(spec)}': name one of {', '.join(choices)}")
    return _file(spec, world, angle, trust)


class References(NamedTuple):
    """Reference drivers besides those of `collect_evidence`.

    Attributes:
        drivers: The drivers.
        records: Their records by name.
        itself: Names of all references that are the policy under audit itself.
        close: Ends the processes of those in Python.
    """

    drivers: list[Reference]
    records: dict[str, dict[str, Any]]
    itself: list[str]
    close: Callable[[], None]


def resolve_references(
    world: World, specs: Sequence[str | Path], policy: Record, trust: Trust
) -> References:
    """Load the drivers to compare with.

    Args:
        world: World of the episodes.
        specs: The user's references: files, of which a dial gives one for every 15 degrees from 0
            to 90, or "python:MODULE:ATTRIBUTE".
        policy: Record of the policy under audit.
        trust: Permissions of Python modules.
    """
    drivers = _shipped(world) if world.name in INTERSECTIONS else []
    with contextlib.ExitStack() as started:
        for spec in specs:
            drivers += _named(str(spec), world, trust, started)
        close = started.pop_all().close
    records = {driver.name: record for driver, record in drivers}
    audited, names = policy.as_json(), (*world.references, *records)
    itself = [name for name in names if is_itself(name, records.get(name), audited)]
    return References([driver for driver, _ in drivers], records, itself, close)


def reference_dial(specs: Sequence[str | Path]) -> DialPolicy:
    """Return the one dial among the user's references, with which a declared rule is tested.

    Raises:
        UserError: If there is none, or more than one.
    """
    dials = [Path(spec) for spec in specs if kind_of(Path(spec)) == "dial"]
    if len(dials) != 1:
        raise UserError(
            "a declared rule is tested against one dial at the intersection: add "
            "--reference DIAL.safetensors, once"
        )
    return DialPolicy.load(dials[0])


def is_itself(name: str, reference: Mapping[str, Any] | None, policy: Mapping[str, Any]) -> bool:
    """Whether a reference is the policy under audit itself, by their records as JSON.

    Args:
        name: Name of the reference.
        reference: Its record; None for those of `collect_evidence`, which have none.
        policy: Record of the policy.
    """
    if reference is None:
        return policy["kind"] == RULE and policy["source"] == name
    # A Python module may hold several drivers.
    several = reference["kind"] == "python"
    same = reference["sha256"] == policy["sha256"]
    return same and (not several or reference["source"] == policy["source"])


def _shipped(world: World) -> list[tuple[Reference, dict[str, Any]]]:
    """Return gap rules, and the experts of the atlas if they are installed and fit the world."""
    drivers, shipped = [], atlas.names(_studies(world))
    better = "expert" if world.action_size else "set"
    for name in GAPS:
        loaded = rule_of(name, world)
        drivers.append((Reference(name, loaded.policy), loaded.record.as_json()))
    for family, (mode, angle) in itertools.product(("expert", "set"), MODES.items()):
        name = f"{family}_{mode}"
        if name in shipped and _fits(name, world):
            loaded = resolve_policy(f"{ATLAS}{name}", world, angle, Trust())
            # The calibration curve is of one family, the better one.
            on_curve = angle if family == better else None
            drivers.append((Reference(name, loaded.policy, on_curve), loaded.record.as_json()))
    return drivers


def _shipped_file(name: str, world: World) -> Path:
    if world.name in INTERSECTIONS:
        return atlas.path_for(name, cast(Any, world).options)
    return atlas.path_of(name, _studies(world))


def _studies(world: World) -> tuple[str, ...]:
    """Return the studies of the atlas whose policies have the world's kind of actions."""
    return atlas.CONTINUOUS_STUDIES if world.action_size else atlas.STUDIES


def _fits(name: str, world: World) -> bool:
    interface = Interface.of(world)
    if not interface.action_size:
        policy = atlas.load(name)
        return Interface(policy.n_features, policy.n_actions) == interface
    actor = atlas.load_continuous(name)
    clocked = actor.n_features - interface.n_features in (0, 1)
    return clocked and actor.action_size == interface.action_size


_DIALS: dict[str, Callable[[Path], DialPolicy | ActorDial]] = {
    DialPolicy.KIND: DialPolicy.load,
    ActorDial.KIND: ActorDial.load,
}
"""Readers of dials by the kind of file."""


def _named(
    spec: str, world: World, trust: Trust, started: contextlib.ExitStack
) -> list[tuple[Reference, dict[str, Any]]]:
    if spec.startswith("python:"):
        loaded = started.enter_context(_file(spec, world, 0.0, trust))
        return [(Reference(spec.rpartition(":")[2], loaded.policy), loaded.record.as_json())]
    path = Path(spec)
    if ":" in spec:
        raise UserError(
            f"{one_line(spec)} is not a file: a reference is a policy's file, or "
            "python:MODULE:ATTRIBUTE"
        )
    kind = kind_of(path)
    if kind not in _DIALS:
        loaded = _file(str(path), world, 0.0, Trust())
        return [(Reference(one_line(path.stem), loaded.policy), loaded.record.as_json())]
    dial, drivers = _DIALS[kind](path), []
    for step in range(7):
        angle = EVERY * step
        if dial.low <= angle <= dial.high:
            loaded = _file(str(path), world, angle, Trust())
            name = f"{one_line(path.stem)} at {angle:g}"
            # One file, several drivers: the hash covers the angle too.
            sha256 = hashlib.sha256(f"{loaded.record.sha256}@{angle:g}".encode()).hexdigest()
            record = {**loaded.record.as_json(), "sha256": sha256}
            drivers.append((Reference(name, loaded.policy, angle), record))
    return drivers


def _file(spec: str, world: World, angle: float, trust: Trust) -> Loaded:
    """Load a policy's file; its input may have the time as a further feature.

    The time is that of a world that `shows_time`.
    """
    interface = Interface.of(world)
    keywords: dict[str, Any] = {
        "angle": angle,
        "allow_code": trust.allow_code,
        "limits": trust.limits,
    }
    keywords["action_size"] = interface.action_size
    if is_code(spec):
        keywords |= {"isolation": isolation_of(trust.isolation), "files": trust.files}
    keywords["clock"] = world.shows_time
    return load_policy(spec, interface.n_features, interface.n_actions, **keywords)


def rule_of(name: str, world: World, seed: int = 0) -> Loaded:
    """Return a rule-based driver of a world, with its record.

    Args:
        name: One of its `drivers`.
        world: The world; with continuous actions a rule accelerates and does not steer.
        seed: Seed of the random driver.
    """
    sha256 = hashlib.sha256(f"rule {name}\n{package_sha256()}\n".encode()).hexdigest()
    record = Record(RULE, name, sha256, _RULE_COVERS, Interface.of(world), False)
    return Loaded(world.driver(name, seed), record)
