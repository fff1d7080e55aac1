"""Resolve names to drivers: the policy under audit, and the references to compare it with."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from socialiq.audit.evidence.collect import RULES
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.profile.scenario import World
from socialiq.errors import UserError
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.foreign import one_line
from socialiq.nn.dial_policy import DialPolicy
from socialiq.policies.interface import Interface
from socialiq.policies.load import KINDS, load_policy
from socialiq.policies.process.load import Limits
from socialiq.policies.record import Loaded, Record
from socialiq.provenance import package_sha256
from socialiq.storage import kind_of
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.intersection import atlas, policies
from socialiq.worlds.intersection.world import Intersection

ATLAS = "atlas:"

GAPS = ("gap_2s", "gap_3s", "gap_4s")

EVERY = 15.0  # degrees between the references that are made of a dial

_RULE_COVERS = "the rule's name and this package's code"


@dataclasses.dataclass(frozen=True)
class Trust:
    """Permissions of a policy under audit.

    Attributes:
        allow_code: Import a Python module.
        limits: What a process may take.
    """

    allow_code: bool = False
    limits: Limits = dataclasses.field(default_factory=Limits)


def resolve_policy(spec: str, world: World, angle: float, trust: Trust) -> Loaded:
    """The policy under audit.

    Args:
        spec: What `policies.load.load_policy` takes, `atlas:NAME`, or a rule-based driver's name.
        world: Of the declaration.
        angle: Declared, degrees; a dial is turned there.
        trust: What it may do.

    Raises:
        UserError: If it can't be read, or doesn't fit the world.
    """
    if spec.startswith(ATLAS):
        path = atlas.path_of(spec.removeprefix(ATLAS))
        found = _file(str(path), world, angle, trust)
        return dataclasses.replace(found, record=dataclasses.replace(found.record, source=spec))
    if spec in policies.NAMES and isinstance(world, Intersection):
        return _rule(spec, world)
    if ":" not in spec and not Path(spec).exists():
        named = (*KINDS, "atlas:NAME", f"a rule-based driver ({', '.join(policies.NAMES)})")
        raise UserError(f"no policy '{one_line(spec)}': name one of {', '.join(named)}")
    return _file(spec, world, angle, trust)


def resolve_references(
    world: World,
    handed: Sequence[str | Path],
    policy_sha256: str,
    policy_source: str = "",
    trust: Trust | None = None,
) -> tuple[list[Reference], dict[str, dict[str, Any]], list[str]]:
    """Drivers to compare with, beside those that an audit always has.

    Args:
        world: Of the declaration.
        handed: Further policies: files, of which a dial gives one for every 15 degrees from 0 to
            90, or "python:MODULE:ATTRIBUTE".
        policy_sha256: Of the policy under audit.
        policy_source: What it was loaded from.
        trust: What drivers may do.

    Returns:
        References, their records by name, and the names of those that are the policy itself.
    """
    found = [*(_shipped(world) if isinstance(world, Intersection) else [])]
    for spec in handed:
        found += _handed(str(spec), world, trust or Trust())
    itself = [one.name for one, record in found if _same(record, policy_sha256, policy_source)]
    return [one for one, _ in found], {one.name: record for one, record in found}, itself


def rules_that_are_the_policy(policy_sha256: str, world: World) -> list[str]:
    """Name of the audit's standard driver that is the policy itself."""
    if not isinstance(world, Intersection):
        return []
    return [name for name in RULES if _rule_sha256(name) == policy_sha256]


def _shipped(world: Intersection) -> list[tuple[Reference, dict[str, Any]]]:
    """Gap rules, and the experts of the atlas where it came along and they fit the world."""
    found = []
    for name in GAPS:
        one = _rule(name, world)
        found.append((Reference(name, one.policy), one.record.as_json()))
    for family, (mode, angle) in itertools.product(("expert", "set"), MODES.items()):
        name = f"{family}_{mode}"
        if name in atlas.names() and _fits(name, world):
            one = resolve_policy(f"{ATLAS}{name}", world, angle, Trust())
            # The reference curve is of one family, the better one.
            shown = angle if family == "set" else None
            found.append((Reference(name, one.policy, shown), one.record.as_json()))
    return found


def _fits(name: str, world: World) -> bool:
    policy = atlas.load(name)
    return (policy.n_features, policy.n_actions) == (world.n_features, world.n_actions)


def _same(record: dict[str, Any], sha256: str, source: str) -> bool:
    """Whether a reference is the policy itself; a Python module may hold several drivers."""
    return record["sha256"] == sha256 and (record["kind"] != "python" or record["source"] == source)


def _handed(spec: str, world: World, trust: Trust) -> list[tuple[Reference, dict[str, Any]]]:
    if spec.startswith("python:"):
        one = _file(spec, world, 0.0, trust)
        return [(Reference(spec.rpartition(":")[2], one.policy), one.record.as_json())]
    path = Path(spec)
    if ":" in spec:
        raise UserError(
            f"{one_line(spec)} is no file: a reference is a policy's file, or "
            "python:MODULE:ATTRIBUTE"
        )
    if kind_of(path) != "dial":
        one = _file(str(path), world, 0.0, Trust())
        return [(Reference(one_line(path.stem), one.policy), one.record.as_json())]
    dial, found = DialPolicy.load(path), []
    for step in range(7):
        angle = EVERY * step
        if dial.low <= angle <= dial.high:
            one = _file(str(path), world, angle, Trust())
            name = f"{one_line(path.stem)} at {angle:g}"
            # One file, several drivers: the angle belongs to who it is.
            sha256 = hashlib.sha256(f"{one.record.sha256}@{angle:g}".encode()).hexdigest()
            record = {**one.record.as_json(), "sha256": sha256}
            found.append((Reference(name, one.policy, angle), record))
    return found


def _file(spec: str, world: World, angle: float, trust: Trust) -> Loaded:
    """Load a policy's file; the policy of a gridworld may read the clock too."""
    more = {"angle": angle, "allow_code": trust.allow_code, "limits": trust.limits}
    try:
        return load_policy(spec, world.n_features, world.n_actions, **more)
    except UserError:
        clocked = isinstance(world, GridWorld) and spec.endswith(".safetensors")
        if not clocked or kind_of(Path(spec)) not in ("policy", "dial"):
            raise
        try:
            return load_policy(spec, world.n_features + 1, world.n_actions, **more)
        except UserError:
            pass
        raise


def _rule(name: str, world: Intersection) -> Loaded:
    interface = Interface(world.n_features, world.n_actions)
    record = Record("rule", name, _rule_sha256(name), _RULE_COVERS, interface, False)
    return Loaded(policies.policy(name), record)


def _rule_sha256(name: str) -> str:
    return hashlib.sha256(f"rule {name}\n{package_sha256()}\n".encode()).hexdigest()
