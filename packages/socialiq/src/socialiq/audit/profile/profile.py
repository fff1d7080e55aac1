"""Declaration of a policy's behaviour (the data of `profile.toml`), and the world that it names."""

from __future__ import annotations

import datetime
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from socialiq.audit.profile import fields
from socialiq.audit.profile.environment import Environment
from socialiq.audit.profile.fields import Range
from socialiq.errors import UserError, one_of
from socialiq.evaluation.effects import IN_SUMO, QUANTITIES
from socialiq.foreign import one_line
from socialiq.reading import sha256_of
from socialiq.social.angle import exact_weights
from socialiq.social.angle_rule import AngleRule
from socialiq.types import Json
from socialiq.worlds import IDS, OLD_IDS
from socialiq.worlds.catalogue import (
    GRIDS,
    INTERSECTION,
    KNOWN,
    base,
    in_sumo,
    is_road,
    scene_named,
)
from socialiq.worlds.environment import is_environment
from socialiq.worlds.grammar import build, parse
from socialiq.worlds.highway.options import MOST_SPEEDS
from socialiq.worlds.spelled_out import defaults
from socialiq.worlds.world import World

# A declaration may be untrusted; these bound the memory and the time of its scenario.
MOST_VEHICLES = 200
MOST_SUB_STEPS = 100  # per second
WORLD_SUFFIX = ".safetensors"


def is_recorded(name: str) -> bool:
    """Whether a world's name is that of a file, which only recorded junctions have.

    The file itself is not needed: a report is verified without it.
    """
    return name.endswith(WORLD_SUFFIX)


def world_of(name: str, options: Json, allow_code: bool = False) -> World:
    """Build a world from unchecked values of a file: its name, or a file of a recorded junction.

    Args:
        name: Name of the world, or file of a recorded junction.
        options: Options as read from TOML.
        allow_code: Whether an environment's module may be imported.

    Raises:
        UserError: If the world or an option is unknown, a value has the wrong type or size, or an
            environment can't be made.
    """
    for plain, identity in (IDS | OLD_IDS).items():
        if name == identity:
            raise UserError(f"{name} is the id of an environment: declare the world {plain}")
    if is_environment(name):
        check_options(options)
        return Environment.of(name, options, allow_code)
    if is_recorded(name) and not Path(name).exists():
        raise UserError(
            f"no such file: {name}: the declaration names its world by this path, from the current "
            "folder"
        )
    if base(name) in KNOWN:
        known = defaults(name)
        for option in options:
            one_of(f"option of {name}", option, tuple(known))
        options = {name: _typed(name, value, known[name]) for name, value in options.items()}
    world: Any = build(name, options)
    if world.agents > 1:
        raise UserError(
            f"{world.agents} agents are driven by `socialiq population`, and an audit is of one: "
            "leave agents out"
        )
    if base(name) == INTERSECTION:  # refuse what would need too much memory or time
        built = world.options
        vehicles = "initial_vehicle_count and duration"
        for what, value, most in (
            ("observed_vehicles", built.observed_vehicles, MOST_VEHICLES),
            (f"vehicles of an episode ({vehicles})", built.capacity, MOST_VEHICLES),
            ("simulation_frequency", built.simulation_frequency, MOST_SUB_STEPS),
        ):
            if value > most:
                raise UserError(f"{what} must be at most {most} in an audit, got {value}")
    return world


def scenario_sha256(world: World) -> str:
    """Return the SHA-256 of a world's description: its name and every option."""
    return sha256_of(world.description)


def identity(world: World) -> dict[str, str]:
    """Return the identity of a world, by field of the declaration.

    The reward's hash covers the weights and units that define r_env and r_social, as JSON with
    sorted keys. Two worlds with equal ones give the same rewards for the same event, whatever their
    traffic. Those of an environment have the hashes of its code.
    """
    reward = {"id": world.reward_id, **world.reward}
    text = json.dumps(reward, sort_keys=True, separators=(",", ":"))
    return {
        "reward.id": world.reward_id,
        "reward.sha256": sha256_of(text),
        "scenario.sha256": scenario_sha256(world),
    }


def check_options(options: Json) -> None:
    """Check that options of an environment, whose types are not known, have a moderate size.

    Raises:
        UserError: If one is too large, or is not text, a boolean, a number or a list of numbers.
    """
    for option, value in options.items():
        default = 0.0 if type(value) is float else value
        if not isinstance(value, str | bool | int | float | list):
            raise UserError(f"{option} must be text, true, false, a number or a list of numbers")
        _typed(option, value, (0.0,) if isinstance(value, list) else default)


def _typed(option: str, value: Any, default: Any) -> Any:
    """Return a value of the default's type; an integer may be a float, a list a tuple."""
    if isinstance(default, tuple):
        if not isinstance(value, list) or len(value) > MOST_SPEEDS:
            raise UserError(f"{option} must be a list of at most {MOST_SPEEDS} numbers")
        return tuple(_typed(option, number, 0.0) for number in value)
    if isinstance(default, str):
        if not isinstance(value, str) or len(value) > fields.LONGEST_TEXT:
            raise UserError(f"{option} must be text in quotes")
        return value
    if isinstance(default, bool):
        if not isinstance(value, bool):
            raise UserError(f"{option} must be true or false")
        return value
    numeric = int if isinstance(default, int) else (int, float)
    if isinstance(value, bool) or not isinstance(value, numeric):
        what = "whole number" if isinstance(default, int) else "number"
        raise UserError(f"{option} must be a {what}")
    most = fields.LARGEST_WHOLE if isinstance(default, int) else fields.LARGEST_NUMBER
    if not -most <= value <= most:
        shown = f"{most:,}" if isinstance(most, int) else f"{most:g}"
        raise UserError(f"{option} must be within plus or minus {shown}")
    return type(default)(value)


def whole_error(confidence: float) -> float:
    """Return the error of a verdict of one look, 1 - confidence."""
    return round(1.0 - confidence, 9)  # 0.05, not 0.050000000000000044


WRONG_WORLD = '{path} is of another world: this scenario has "{value}"'


@dataclass(frozen=True)
class Margin:
    """Margins within which a policy counts as declared.

    A largest loss is the most by which one driver's R(α) can lie below another's in an episode;
    None if no bound is declared. Without a width the direction is not tested.
    """

    regret: float  # largest regret at the declared angle, in reward per episode
    degrees: float | None = None  # of older declarations; nothing is tested by it
    largest_loss: float | None = None
    width: float | None = None  # degrees between the declared angle and either end of the direction
    beyond: float | None = None  # largest share of episodes beyond either end


@dataclass(frozen=True)
class Clip:
    """Limits at which the rewards of an episode are counted, of every driver alike."""

    r_env: Range
    r_social: Range

    @property
    def ends(self) -> tuple[Range, Range]:
        """The smallest rewards (env, social) that count, and the largest."""
        lows, highs = zip(self.r_env, self.r_social, strict=True)
        return lows, highs

    def largest_loss(self, angle: float) -> float:
        """Return the most by which R(α) of two drivers differs in an episode; α in degrees."""
        env, social = exact_weights(angle)
        low, high = self.r_env
        least, most = self.r_social
        return abs(env) * (high - low) + abs(social) * (most - least)


@dataclass(frozen=True)
class Reward:
    """Reward pair that the angle weighs: name, and SHA-256 of weights and units."""

    id: str
    sha256: str


@dataclass(frozen=True)
class Scenario:
    """Scenario of the audit: world, options that differ from the defaults, SHA-256."""

    world: str
    options: Json
    sha256: str


@dataclass(frozen=True)
class Bound:
    """Limit of the mean of a quantity of an episode: an event of the floor, or an effect."""

    quantity: str
    side: str  # one of `fields.SIDES`
    limit: float
    range: Range | None = None  # within which an episode counts; None of an event

    @staticmethod
    def of(name: str, limit: float, limits: Sequence[float] | None = None) -> Bound:
        """Return the bound of a field by its name, as max_delay.

        Args:
            name: Name of the field, as max_delay: a side of `fields.SIDES` and a quantity.
            limit: Limit of the mean.
            limits: Range within which an episode counts; None for an event.
        """
        side, _, quantity = name.partition("_")
        ends = None if limits is None else (limits[0], limits[1])
        return Bound(quantity, fields.SIDES[side], limit, ends)

    @property
    def path(self) -> str:
        """Path of its field, as caused.max_delay."""
        side = next(name for name, side in fields.SIDES.items() if side == self.side)
        table = fields.CAUSED if self.quantity in fields.QUANTITIES else "competence"
        return f"{table}.{side}_{self.quantity}"


def measured_in(world: str) -> dict[str, str]:
    """Return the unit of each effect that a world of this name measures; none where it can't."""
    name = base(world)
    walks = parse(world).walks
    if name in GRIDS:
        return {"delay": "cells"} | ({"waiting": "steps"} if walks else {})
    if in_sumo(world):
        return {name: fields.QUANTITIES[name].unit for name in IN_SUMO}
    discrete = name == INTERSECTION and not parse(world).control
    is_road = discrete or is_recorded(world) or scene_named(world) is not None
    return {
        name: fields.QUANTITIES[name].unit
        for name in QUANTITIES
        if walks or (is_road and fields.QUANTITIES[name].of == "vehicles")
    }


@dataclass(frozen=True)
class Floor:
    """Safety floor, independent of the angle; shares of episodes."""

    max_at_fault: float  # largest share of collisions caused by the ego's motion
    max_struck: float  # largest share of collisions caused by another's motion
    min_arrival: float  # smallest share of arrivals
    max_timeout: float  # largest share of timeouts

    @property
    def bounds(self) -> tuple[Bound, ...]:
        """The bounds of its shares."""
        return tuple(Bound.of(name, limit) for name, limit in vars(self).items())


@dataclass(frozen=True)
class Profile:
    """Declaration of a policy's social angle.

    A rule gives the angle by the situation. If a width holds all its angles, the policy is tested
    as one of `angle`; else `angle` weighs whole episodes in tables and pictures without deciding.
    """

    angle: float  # degrees in [0, 360)
    confidence: float  # of the verdict
    owner: str
    date: datetime.date
    margin: Margin
    reward: Reward
    scenario: Scenario
    competence: Floor
    source: bytes = field(repr=False, compare=False)  # the file's bytes
    rule: AngleRule | None = None
    clip: Clip | None = None
    caused: tuple[Bound, ...] = ()  # of what the policy causes

    @property
    def bounds(self) -> tuple[Bound, ...]:
        """Bounds of the safety floor, and of what the policy causes."""
        return (*self.competence.bounds, *self.caused)

    @property
    def effects(self) -> tuple[str, ...]:
        """Quantities of effects that have bounds."""
        return tuple(dict.fromkeys(bound.quantity for bound in self.caused))

    @property
    def losses_decide(self) -> bool:
        """Whether decision losses decide: a rule is declared whose angles no width holds."""
        return self.rule is not None and self.margin.width is None

    @property
    def largest_loss(self) -> float | None:
        """Largest loss of an episode: by the clip, which decision losses lack, or as declared."""
        if self.clip is None or self.losses_decide:
            return self.margin.largest_loss
        return self.clip.largest_loss(self.angle)

    @property
    def error(self) -> float:
        """Error of a verdict of one look, a wrong pass or a wrong fail: 1 - confidence."""
        return whole_error(self.confidence)

    @property
    def sha256(self) -> str:
        """SHA-256 of the file's bytes: one changed byte, and it is another declaration."""
        return sha256_of(self.source)

    def world(self, allow_code: bool = False) -> World:
        """Build the world of the scenario; an environment's module is imported if that is allowed.

        Raises:
            UserError: If an environment can't be made, or differs from the declared environment.
        """
        world = world_of(self.scenario.world, self.scenario.options, allow_code)
        declared = (self.reward.id, self.reward.sha256, self.scenario.sha256)
        for (path, value), declared_value in zip(identity(world).items(), declared, strict=True):
            if value != declared_value:
                raise UserError(WRONG_WORLD.format(path=path, value=value))
        return world


class Traffic(NamedTuple):
    """Another traffic in the declared world, by the options that differ from the declaration's."""

    name: str
    options: Json
    world: World


def other_traffic(profile: Profile, shifts: Sequence[str] = ()) -> tuple[Traffic, ...]:
    """Return further traffic of the declared world, or the declared world with shifts.

    Args:
        profile: The declaration.
        shifts: Shifts of a road, each another traffic; none for the world's variants.

    Raises:
        UserError: If the world has one traffic only, a shift is unknown, or a rule is declared.
    """
    declared = profile.scenario
    if profile.rule is not None:
        raise UserError("a declared rule is not tested in other traffic: leave out --shift")
    # Making an environment may run code; it has one traffic only.
    variants = profile.world().other_traffic() if base(declared.world) in KNOWN else {}
    if shifts:
        if not (is_road(base(declared.world)) or is_recorded(declared.world)):
            raise UserError(f"{one_line(declared.world)} is no road with shifts: leave out --shift")
        variants = {f"the shift {text}": {"shift": text} for text in shifts}
    if not variants:
        raise UserError(f"{declared.world} has one traffic only: leave out --shift")
    return tuple(
        Traffic(name, changed, world_of(declared.world, {**declared.options, **changed}))
        for name, changed in variants.items()
    )
