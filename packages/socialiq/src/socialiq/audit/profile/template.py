"""Write a declaration: its canonical text, and the largest loss that its world allows."""

from __future__ import annotations

import datetime
import json
import math
import textwrap
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from socialiq.audit.profile import profile as declared
from socialiq.audit.profile.fields import CAUSED, FIELDS, FORMAT, RULE
from socialiq.audit.profile.profile import Bound, Clip, Floor, Margin, Profile
from socialiq.audit.profile.reader import parse
from socialiq.social.angle import exact_weights
from socialiq.social.angle_rule import AngleRule
from socialiq.types import Json
from socialiq.worlds import grammar
from socialiq.worlds.catalogue import GRIDS, base
from socialiq.worlds.road_users import ROAD_USERS
from socialiq.worlds.spelled_out import declared as spelled_out
from socialiq.worlds.world import World

_WIDTH = 88

_HEADING = """\
A declaration: how a driving policy behaves, stated by its owner before any test.
`socialiq audit` tests a policy against it. One changed byte makes another declaration.
profile.schema.json describes the same fields for other programs."""

FLOOR = Floor(max_at_fault=0.05, max_struck=0.1, min_arrival=0.8, max_timeout=0.2)
"""Default safety floor; it is not a recommendation for any road.

At the intersection a rule that goes at gaps of 2 s is at fault in 6 % of episodes, one that waits
for 3 s in 2 % (docs/worlds/intersection.md). A policy whose true share is on a limit is never
decided, so the limits differ from the shares of the atlas' experts.
"""

NO_FLOOR = Floor(max_at_fault=1.0, max_struck=1.0, min_arrival=0.0, max_timeout=1.0)
"""Floor of a world whose episodes end neither in arrivals nor in collisions."""
_NO_ENDING = "Episodes of this world don't end so: the limit excludes nothing."

FLOORS = ((67.5, 0.8), (77.5, 0.5), (90.0, 0.0))
"""Smallest share of arrivals that is asked for up to an angle in degrees. Of the shipped dial
76 % of episodes arrive at 75 degrees, 45 % at 80 and none at 90, where only others count."""


def floor_at(angle: float) -> Floor:
    """Return the default floor at an angle in degrees; beyond 90 it is that of 90."""
    egoism = min(angle, 360.0 - angle)  # degrees from 0
    arrival = next((least for last, least in FLOORS if egoism <= last), 0.0)
    return replace(FLOOR, min_arrival=arrival, max_timeout=round(1.0 - arrival, 9))


MOST_DELAY = 25.0
GRID_LIMITS = {"max_delay": 2.5, "max_waiting": 0.75}
"""Default bounds of effects where pedestrians cross: of the delay of vehicles on a road, m, and by
field in a gridworld (docs/audit.md#bounds-of-effects). Those of people on a road are in the table
`road_users.ROAD_USERS`, and are the same for every angle."""


def limits_at(world: str, angle: float, options: Json | None = None) -> dict[str, float]:
    """Return the default bounds of effects.

    A policy whose floor asks for no arrivals may cost vehicles on a road three times as much.

    Args:
        world: Name of the world.
        angle: Declared angle in degrees.
        options: Options of the world by name; a class but the first has bounds if its rate is
            above 0.

    Returns:
        Limits by name of the field in `[caused]`; none where no pedestrians cross.
    """
    if not grammar.parse(world).walks:
        return {}
    if base(world) in GRIDS:
        return GRID_LIMITS
    waits = floor_at(angle).min_arrival == 0.0
    limits = {"max_delay": 3 * MOST_DELAY if waits else MOST_DELAY}
    for number, user in enumerate(ROAD_USERS):
        if number == 0 or (options or {}).get(user.rate):
            limits |= user.limits
    return limits


class Usual(NamedTuple):
    """Defaults of a declaration in a world."""

    margin: float  # of regret, reward per episode
    width: float | None = None  # degrees
    beyond: float | None = None  # share of episodes
    clip: Clip | None = None


USUAL = {
    "intersection": Usual(0.5, 15.0, 0.075, Clip((-8.0, 12.0), (-12.0, 12.0))),
    "intersection-caused": Usual(0.5, 30.0, 0.075, Clip((-8.0, 12.0), (-30.0, 30.0))),
    "crossing5": Usual(0.15, 15.0, 0.075),
    "crossing7": Usual(0.5, 15.0, 0.075),
    "crosswalk7": Usual(0.5, 15.0, 0.075),
    # No episode of the shipped dial is beyond.
    "intersection-crosswalk": Usual(0.5, None, 0.075, Clip((-30.0, 12.0), (-30.0, 12.0))),
}
"""Defaults by world (docs/audit.md#the-defaults); elsewhere no reference dial is shipped."""

_WIDTHS = ((0.0, 30.0), (45.0, 45.0))
"""Width where people walk, in degrees, up to a class angle. Beyond, no width can be shown: there
the dial drives nearly alike from 0 to 60 degrees."""


def usual_in(world: str, options: Json) -> Usual:
    """Return the defaults of a declaration in a world.

    Args:
        world: Name of the world.
        options: Options of the world, spelled out (`spelled_out`).
    """
    world = spelled_out(world)[0]
    usual = USUAL.get(world, Usual(1.0))
    further = any(options.get(user.rate) for user in ROAD_USERS[1:])
    if world != "intersection-crosswalk" or further:  # the dial sees the first class alone
        return usual
    widths = (width for last, width in _WIDTHS if options["class_angle"] <= last)
    return usual._replace(width=next(widths, None))


def declare(
    angle: float,
    owner: str,
    world: str,
    margin: Margin,
    date: datetime.date,
    options: Json | None = None,
    confidence: float = 0.95,
    competence: Floor = FLOOR,
    allow_code: bool = False,
    rule: AngleRule | None = None,
    clip: Clip | None = None,
    caused: Sequence[Bound] = (),
) -> Profile:
    """Return a profile whose `source` is its canonical text, with the hashes of the world.

    Args:
        angle: Social angle, degrees.
        owner: Name of the owner.
        world: Name of the world.
        margin: Margins within which a policy counts as declared.
        date: Date of the declaration.
        options: Options of the world that differ from its defaults.
        confidence: Confidence of the verdict.
        competence: Safety floor.
        allow_code: Whether an environment's module may be imported, to be hashed.
        rule: Rule that gives the angle by the situation.
        clip: Limits of the rewards of an episode.
        caused: Bounds of what the policy causes.

    Raises:
        UserError: If a value is invalid, as in `reader.parse`.
    """
    world, options = spelled_out(world, options or {})
    options = dict(sorted(options.items()))
    built = declared.world_of(world, options, allow_code)
    values: dict[str, Any] = {
        "format": FORMAT,
        "angle": angle,
        "confidence": confidence,
        "owner": owner,
        "date": date,
        **declared.identity(built),
        "scenario.world": world,
        "scenario.options": options,
        RULE: rule,
    }
    for table, limits in (("margin", margin), ("competence", competence), ("clip", clip)):
        fields = {} if limits is None else vars(limits)
        values |= {f"{table}.{name}": value for name, value in fields.items()}
    for bound in caused:
        values[bound.path] = bound.limit
        values[f"{CAUSED}.{bound.quantity}_range"] = bound.range
    unlimited = [f"competence.{name}" for name in vars(NO_FLOOR)] if competence is NO_FLOOR else []
    return parse(_text(values, unlimited).encode())


def _text(values: Json, unlimited: Collection[str] = ()) -> str:
    lines = [*_comment(_HEADING), ""]
    table = ""
    for field in FIELDS:
        if not field.required and values.get(field.path) is None:
            continue
        if field.kind == "rule":  # a table of its own, the last one
            lines += [*_comment(field.meaning), values[field.path].as_toml(field.path)]
            continue
        parent, _, key = field.path.rpartition(".")
        if parent != table:
            table = parent
            lines += [f"[{table}]"]
        lines += _comment(_NO_ENDING if field.path in unlimited else field.meaning)
        if field.kind == "options":
            pairs = values[field.path].items()
            lines += [f"[{field.path}]", *(f"{name} = {_toml(value)}" for name, value in pairs)]
        else:
            lines += [f"{key} = {_toml(values[field.path])}"]
        lines += [""]
    return "\n".join(lines)


def _comment(text: str) -> list[str]:
    paragraphs = text.split("\n")
    return [f"# {line}" for paragraph in paragraphs for line in textwrap.wrap(paragraph, _WIDTH)]


def _toml(value: Any) -> str:
    """Return a scalar or a list of numbers as TOML."""
    if isinstance(value, datetime.date):
        return value.isoformat()
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml(number) for number in value)}]"
    # Texts, booleans and finite numbers are the same in JSON and TOML; the reader checks the rest.
    return json.dumps(value, ensure_ascii=False)


_DIGITS = 4  # to which the limit is rounded up, so that a profile shows a short number


def possible_loss(world: World, angle: float) -> float | None:
    """Return the most by which R(α) of two drivers can differ in one episode, rounded up.

    It is the range of R(α) over all drivers and episodes. It is exact in a gridworld; at the
    intersection it follows from the limits of each signal, the largest number of vehicles and the
    time limit.

    Args:
        world: The world.
        angle: Angle α in degrees.

    Returns:
        Reward of an episode, rounded up to four digits. None where the limits are not known: in an
        environment, at a recorded junction, and where the ego steers along a turn.
    """
    difference = world.largest_difference(exact_weights(angle))
    if difference is None or difference <= 0.0:
        return difference
    unit = 10.0 ** (math.floor(math.log10(difference)) - _DIGITS + 1)
    # Well above rounding errors.
    return round(math.ceil(difference * (1.0 + 1e-9) / unit) * unit, 12)
