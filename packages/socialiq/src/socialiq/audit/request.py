"""Request of an audit, and the drivers that it names: the policy, and its references."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.profile.profile import Profile
from socialiq.audit.seeds import LARGEST_SEED, Nonce, Round, check_episodes
from socialiq.errors import UserError
from socialiq.evaluation.rollout import MODES
from socialiq.foreign import one_line
from socialiq.isolation import IsolationMode, isolation_of
from socialiq.nn.actor_policy import ActorDial
from socialiq.nn.class_dial import ClassDial
from socialiq.nn.dial_policy import DialPolicy
from socialiq.policies.drivers import (
    ATLAS,
    RULE,
    atlas_file,
    file_of,
    finished,
    of_classes,
    parse,
    rule_of,
    schema_of,
    showing,
)
from socialiq.policies.interface import Interface, Loaded
from socialiq.policies.load import KINDS, load_policy
from socialiq.policies.process import GIB, Limits
from socialiq.reading import sha256_of
from socialiq.storage import kind_of, packaged_results
from socialiq.types import Json, Row
from socialiq.worlds.intersection import atlas
from socialiq.worlds.world import World

Recorded = tuple[Reference, Row]
"""A driver to compare with, and its record as JSON."""

GAPS = ("gap_2s", "gap_3s", "gap_4s")
EVERY = 15.0  # degrees between the references that are made of a dial
FINE = 5.0  # degrees between them near the declared angle
SHIPPED_DIAL = "intersection-dial-clock/iterated.safetensors"
SHIPPED_DIALS = {
    "intersection": SHIPPED_DIAL,
    "intersection-caused": "caused-effects/dial.safetensors",
    "intersection-crosswalk": "crosswalk-intersection/dial.safetensors",
}
"""Dial that was trained for the rewards of a world."""
DIALS = {kind.KIND: kind for kind in (DialPolicy, ActorDial, ClassDial)}
DIAL = "dial_"  # beginning of the names of the shipped dial's policies, before their angles
SUFFIXES = (".safetensors", ".zip", ".onnx")  # names of files that may be policies end so


@dataclasses.dataclass(frozen=True)
class Trust:
    """Permissions of a policy under audit.

    Code that is allowed may run without isolation, and an environment's module may be imported.
    """

    allow_code: bool = False
    limits: Limits = dataclasses.field(default_factory=Limits)  # time and memory of a process
    isolation: IsolationMode = "auto"  # isolation of processes and Python modules
    files: tuple[str, ...] = ()  # further files and folders of these


@dataclasses.dataclass(frozen=True)
class Request:
    """Request of an audit."""

    policy: str  # a specification as for `resolve_policy`
    profile: Path | Profile  # declaration, or its file
    episodes: int  # of every driver
    seed: int | Nonce | Round | None = None  # what the auditor gives (`origin_of`); None draws it
    references: tuple[str, ...] = ()  # files, or "python:FILE.py:NAME"
    soft: bool = False  # whether the policy draws its actions
    trust: Trust = dataclasses.field(default_factory=Trust)
    threads: int = 1  # of the intersection
    films: bool = False  # whether to draw six episodes
    # shifts in which the policy runs too; none for the world's other traffic, None for neither
    shift: tuple[str, ...] | None = None
    log: Path | None = None  # folder of the audit log; None keeps none

    def check(self) -> None:
        """Refuse, by a `UserError`, numbers and options that no audit can have."""
        check_episodes(self.episodes)
        if isinstance(self.seed, int) and not 0 <= self.seed <= LARGEST_SEED:
            raise UserError(f"seed must be from 0 to {LARGEST_SEED}, got {self.seed}")
        if self.films and self.soft:
            raise UserError("films show a policy's best actions: leave out --films or --soft")
        self.trust.limits.check()
        if self.trust.files and not any(map(is_code, (self.policy, *self.references))):
            raise UserError("--files is of a process or Python: leave it out")
        if self.threads < 1:
            raise UserError(f"threads must be at least 1, got {self.threads}")


def command_of(request: Request, seed: int) -> str:
    """Return the command that repeats an audit, without its output folder.

    Args:
        request: Request of the audit.
        seed: Seed of the whole audit.

    Returns:
        One line for a shell. Options at their defaults are left out.
    """
    file = str(request.profile) if isinstance(request.profile, Path) else "profile.toml"
    words = ["socialiq", "audit", request.policy, "--profile", file]
    words += ["--episodes", str(request.episodes), "--seed", str(seed)]
    words += [word for reference in request.references for word in ("--reference", reference)]
    words += [f"--{flag}" for flag in ("films", "soft") if getattr(request, flag)]
    words += [] if request.shift is None else ["--shift", *request.shift]
    trust = request.trust
    words += ["--allow-code"] if trust.allow_code else []
    words += [word for file in trust.files for word in ("--files", file)]
    usual = Trust()
    if trust.isolation != usual.isolation:
        words += ["--isolation", trust.isolation]
    if trust.limits.step != usual.limits.step:
        words += ["--step-seconds", f"{trust.limits.step:g}"]
    if trust.limits.memory != usual.limits.memory:
        words += ["--memory-gib", f"{trust.limits.memory / GIB:g}"]
    return shlex.join(words)


def is_code(spec: str) -> bool:
    """Whether a policy is a program of its owner, and not data that this package's code runs."""
    return spec.startswith(("process:", "python:"))


def resolve_policy(spec: str, world: World, angle: float, trust: Trust) -> Loaded:
    """Load the policy under audit.

    Args:
        spec: Driver in the grammar of `policies.drivers`.
        world: World of the declaration.
        angle: Declared angle in degrees, at which a dial is set.
        trust: Permissions of a policy that is code.

    Raises:
        UserError: If it can't be read, or doesn't fit the world.
    """
    driver = parse(spec)
    text = spec
    spec = driver.spec
    if driver.is_rule_of(world):
        return finished(driver, rule_of(spec, world), world)
    spec = file_of(spec)
    file = spec
    name = spec.removeprefix(ATLAS)
    if name != spec:
        file = atlas_file(name, world)
    elif ":" not in spec and not Path(spec).exists():
        if Path(spec).suffix in SUFFIXES:
            raise UserError(f"no such file: {one_line(spec)}")
        choices = list(KINDS)
        choices += ["atlas:NAME"] if world.shipped else []
        if world.drivers:
            choices.append(f"a rule-based driver ({', '.join(world.drivers)})")
        raise UserError(f"no policy '{one_line(spec)}': name one of {', '.join(choices)}")
    turned = angle if driver.angle is None else driver.angle
    loaded = _file(file, world, turned, trust, driver.class_angle)
    loaded = finished(driver, loaded, showing(world, loaded.record.interface.schema))
    record = loaded.record if file == text else dataclasses.replace(loaded.record, source=text)
    return dataclasses.replace(loaded, record=record)


class References(NamedTuple):
    """Reference drivers that are not those of `collect_evidence`, and their records by name.

    `itself` has the names of all references that are the policy under audit itself.
    """

    drivers: list[Reference]
    records: dict[str, Row]
    itself: list[str]


def resolve_references(
    world: World,
    specs: Sequence[str | Path],
    policy: Json,
    trust: Trust,
    closing: contextlib.ExitStack,
    angles: Sequence[float],
) -> References:
    """Load the drivers to compare with, and say which are the policy under audit, by its record.

    At the intersection the gap rules, and the shipped dial and experts that are installed and fit
    the world, come before the user's.

    Args:
        world: World of the declaration.
        specs: The user's references: files, or "python:FILE.py:NAME". A dial gives several drivers.
        policy: Record of the policy under audit, as JSON.
        trust: Permissions of references that are code.
        closing: Ends the processes of references that are code.
        angles: Angles in degrees at which dials are set, where their range has them.

    Raises:
        UserError: If a reference can't be read, or doesn't fit the world.
    """
    drivers = list[Recorded]()
    if world.shipped:
        shipped = atlas.names(world.shipped)
        interface = Interface.of(world)
        rules_and_experts = [(name, rule_of(name, world)) for name in GAPS]
        for family, (mode, angle) in itertools.product(("expert", "set"), MODES.items()):
            name = f"{family}_{mode}"
            load = atlas.load_continuous if interface.action_size else atlas.load
            if name in shipped and _fits(load(name), interface):
                expert = resolve_policy(f"{ATLAS}{name}", world, angle, Trust())
                rules_and_experts.append((name, expert))
        drivers += shipped_dial(world, angles)
        drivers += [_recorded(name, loaded) for name, loaded in rules_and_experts]
    for spec in specs:
        drivers += _named(str(spec), world, trust, closing, angles)
    records = {driver.name: record for driver, record in drivers}
    names = (*world.references, *records)
    itself = [name for name in names if is_itself(name, records.get(name), policy)]
    return References([driver for driver, _ in drivers], records, itself)


def reference_dial(specs: Sequence[str | Path]) -> DialPolicy:
    """Return the dial by which a rule is tested; `UserError` unless the references have one."""
    dials = [Path(spec) for spec in specs if kind_of(Path(spec)) == "dial"]
    if len(dials) != 1:
        raise UserError(
            "a declared rule is tested against one dial at the intersection: add "
            "--reference DIAL.safetensors, once"
        )
    return DialPolicy.load(dials[0])


def is_itself(name: str, reference: Json | None, policy: Json) -> bool:
    """Whether a reference is the policy under audit itself, by their records as JSON.

    Args:
        name: Name of the reference.
        reference: Its record; None for a reference of `collect_evidence`, which has only a name.
        policy: Record of the policy.
    """
    if reference is None:
        return policy["kind"] == RULE and policy["source"] == name
    # A Python module may hold several drivers.
    several = reference["kind"] == "python"
    same = reference["sha256"] == policy["sha256"]
    return same and (not several or reference["source"] == policy["source"])


def dial_angles(angle: float, width: float | None) -> tuple[float, ...]:
    """Return the angles at which an audit sets a dial.

    Args:
        angle: Declared angle in degrees.
        width: Declared width in degrees, which adds angles near the declared one; None if there is
            none.

    Returns:
        Angles from 0 to 90 degrees, rising.
    """
    angles = {EVERY * step for step in range(7)}
    if width is not None:
        angles |= {angle - width, angle + width, *(angle + step * FINE for step in range(-2, 3))}
    return tuple(sorted(angle for angle in angles if 0.0 <= angle <= 90.0))


def shipped_dial(world: World, angles: Sequence[float]) -> list[Recorded]:
    """Return the drivers of the shipped dial.

    Args:
        world: World of the declaration.
        angles: Angles in degrees.

    Returns:
        A reference and its record for each angle; none if no shipped dial fits the world.
    """
    dial = packaged_results() / SHIPPED_DIALS.get(world.name, "")
    if not dial.is_file() or not _fits(DIALS[kind_of(dial)].load(dial), Interface.of(world)):
        return []
    turned = _turned(dial, DIAL, angles, world)
    return [(driver, {**record, "source": f"{ATLAS}dial"}) for driver, record in turned]


def _fits(policy: Any, interface: Interface) -> bool:
    """Whether a policy has a world's actions and observations; it may take the time too."""
    size = getattr(policy, "action_size", 0)
    actions = size if interface.action_size else policy.n_actions
    clocked = policy.n_features - interface.n_features in (0, 1)
    return clocked and actions == (interface.action_size or interface.n_actions)


def _turned(path: Path, prefix: str, angles: Sequence[float], world: World) -> list[Recorded]:
    """Return the drivers that are made of a dial, at angles in degrees."""
    drivers = []
    for angle in angles:
        loaded = _file(str(path), world, angle, Trust())
        # One file, several drivers: the hash covers the angle too.
        sha256 = sha256_of(f"{loaded.record.sha256}@{angle:g}")
        driver, record = _recorded(f"{prefix}{angle:g}", loaded, angle)
        drivers.append((driver, record | {"sha256": sha256}))
    return drivers


def _recorded(name: str, loaded: Loaded, angle: float | None = None) -> Recorded:
    """Return a loaded policy as a reference of this name, with its record."""
    schema = loaded.record.interface.schema
    return Reference(name, loaded.policy, angle, schema), loaded.record.as_json()


def _named(
    spec: str, world: World, trust: Trust, closing: contextlib.ExitStack, angles: Sequence[float]
) -> list[Recorded]:
    """Return the drivers of one of the user's references."""
    if spec.startswith("python:"):
        loaded = closing.enter_context(_file(spec, world, 0.0, trust))
        return [_recorded(spec.rpartition(":")[2], loaded)]
    if ":" in spec:
        raise UserError(
            f"{one_line(spec)} is not a file: a reference is a policy's file, or "
            "python:FILE.py:NAME"
        )
    path = Path(spec)
    kind = kind_of(path)
    if kind not in DIALS:
        return [_recorded(one_line(path.stem), _file(str(path), world, 0.0, Trust()))]
    dial = DIALS[kind].load(path)
    angles = [angle for angle in angles if dial.low <= angle <= dial.high]
    return _turned(path, f"{one_line(path.stem)} at ", angles, world)


def _file(
    spec: str, world: World, angle: float, trust: Trust, class_angle: float | None = None
) -> Loaded:
    """Load a policy's file; where the world `shows_time`, its input may have the time too."""
    world = showing(world, schema_of(spec))
    interface = Interface.of(world)
    code = is_code(spec)
    return load_policy(
        spec,
        interface.n_features,
        interface.n_actions,
        angle=angle,
        allow_code=trust.allow_code,
        limits=trust.limits,
        action_size=interface.action_size,
        isolation=isolation_of(trust.isolation) if code else None,
        files=trust.files if code else (),
        clock=world.shows_time,
        **of_classes(world, class_angle),
    )
