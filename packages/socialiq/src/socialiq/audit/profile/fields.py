"""Fields of a declaration, defined once for the reader, the writer and `profile.schema.json`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

from socialiq.worlds import ENVIRONMENT_PATTERN, SCENE_IDS, SUMO_IDS
from socialiq.worlds.catalogue import KNOWN, OLD, base
from socialiq.worlds.road_users import ROAD_USERS

Kind = Literal["number", "text", "sha256", "world", "date", "options", "rule", "range"]
FORMAT = 1

Range = tuple[float, float]
"""Lower and upper end."""

RULE = "angle_rule"
CLIP = "clip"
CAUSED = "caused"
"""Tables that a declaration may lack: a rule of the angle, limits of the rewards, and bounds of
what the policy causes."""


class Quantity(NamedTuple):
    """Quantity of an episode (`evaluation.effects.QUANTITIES`)."""

    words: str  # in reports, before its amount
    unit: str  # on a road; "" of an event, whose mean is a share of episodes
    meaning: str
    range: Range  # within which an episode counts by default
    of: str = "vehicles"  # class of road users


_METRES = "metres that others drive less than without the policy (cells in a gridworld)"
_BRAKINGS = "decisions in which others brake harder than 4 m/s^2, less those without the policy"
_WAITING = "seconds (steps in a gridworld) that pedestrians at crosswalks wait for the policy"
_CLOSE = "episodes in which it is where a vehicle of another approach is within 1 s"
QUANTITIES = {
    "delay": Quantity("costs others", "m", _METRES, (-700.0, 700.0)),
    "braking": Quantity("causes", "hard brakings", _BRAKINGS, (-40.0, 40.0)),
    "waiting": Quantity("makes pedestrians wait", "s", _WAITING, (0.0, 100.0), "pedestrians"),
    "gap_below_1_s": Quantity("passes within 1 s of a crossing vehicle", "", _CLOSE, (0.0, 1.0)),
    **{
        user.delay: Quantity(
            f"makes {user.plural} wait",
            "s",
            f"seconds that {user.plural} wait because of the policy",
            (0.0, 100.0),
            user.plural,
        )
        for user in ROAD_USERS[1:]
    },
    **{
        f"{user.name}_hit": Quantity(
            f"hits a {user.name}",
            "",
            f"episodes in which it hits a {user.name}",
            (0.0, 1.0),
            user.plural,
        )
        for user in ROAD_USERS
    },
}
"""Effects of a policy on others that a declaration can bound. No episode of the shipped drivers of
the intersection is beyond the ranges (docs/audit.md#bounds-of-effects)."""

IN_GRIDWORLDS = {"delay": (-100.0, 100.0), "waiting": (0.0, 25.0)}
"""Ranges in a gridworld, in cells and steps; no episode has more."""

IN_SUMO = {user.delay: (-100.0, 100.0) for user in ROAD_USERS if user.sumo.name}
"""Ranges in SUMO, where people may wait less too than in the same episode without the policy."""

SIDES = {"max": "at most", "min": "at least"}
"""Side of a limit, by the beginning of its field's name."""

LONGEST_TEXT = 200  # characters
MOST_OPTIONS = 64
LAST_DIRECTION = 90.0  # angles from 0 to this one, in degrees, may have a width
LARGEST_NUMBER = 1e6  # of a reward or an option; usual numbers are far smaller
LARGEST_WHOLE = 2**31 - 1  # of an option that is a whole number, as the seed of a road

# No control characters (C0, C1) and none that reorder or hide text of a report.
_HIDDEN = r"\u0000-\u001f\u007f-\u009f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff"
TEXT_PATTERN = rf"^[^{_HIDDEN}]+$"
SHA256_PATTERN = r"^[0-9a-f]{64}$"

_DECLARED = [name for name in (*KNOWN, *OLD) if base(name) in KNOWN]
_WORLDS = [*sorted(_DECLARED, key=lambda name: KNOWN.index(base(name))), *SCENE_IDS, *SUMO_IDS]
_FILE = rf"[^{_HIDDEN}:]+\.(?:safetensors|net\.xml)"
WORLD_PATTERN = f"^(?:{'|'.join(_WORLDS)}|{ENVIRONMENT_PATTERN}|{_FILE})$"


@dataclass(frozen=True)
class Field:
    """One field of `profile.toml`."""

    path: str  # table and key, joined by a dot; a key of the top level has no table
    kind: Kind
    meaning: str  # comment above the field, one or two sentences
    low: float = 0.0
    high: float = LARGEST_NUMBER
    below_high: bool = False  # whether `high` itself is refused
    above_low: bool = False  # whether `low` itself is refused
    required: bool = True
    unit: str = ""

    @property
    def demand(self) -> str:
        """Description of the expected value."""
        if self.kind == "number":
            start = f"above {self.low:g}" if self.above_low else f"of at least {self.low:g}"
            end = f"below {self.high:g}" if self.below_high else f"at most {self.high:g}"
            return f"a number {start} and {end}" + (f" ({self.unit})" if self.unit else "")
        return {
            "text": f"1 to {LONGEST_TEXT} characters of visible text in quotes",
            "sha256": "64 hexadecimal digits (0-9, a-f) in quotes",
            "world": f"one of {', '.join(_WORLDS)}, a file of `socialiq data world`, "
            "a network of SUMO, a Gymnasium id, MODULE:ID or MODULE:FUNCTION",
            "date": "a date as 2026-01-31, without quotes",
            "options": "a table of the world's options",
            "range": "a list of two numbers, the smaller one first",
            "rule": "a table with format, world, default and [[angle_rule.when]]",
        }[self.kind]


def _share(path: str, meaning: str) -> Field:
    return Field(path, "number", meaning, high=1.0)


def _bounds_of(name: str, quantity: Quantity) -> Iterator[Field]:
    """Yield the fields of a quantity in `[caused]`: two limits of its mean, and its range."""
    unit = quantity.unit
    meaning = quantity.meaning
    low, high = (-LARGEST_NUMBER, LARGEST_NUMBER) if unit else (0.0, 1.0)
    for side, size in zip(SIDES, ("Largest", "Smallest"), strict=True):
        text = f"{size} mean of {meaning}." if unit else f"{size} share of {meaning}."
        path = f"{CAUSED}.{side}_{name}"
        yield Field(
            path, "number", text, low, high, required=False, unit=unit or "share of episodes"
        )
    if unit:
        text = f"Limits at which the {name} of an episode is counted. They bound its mean."
        yield Field(f"{CAUSED}.{name}_range", "range", text, low, required=False)


FIELDS = (
    Field("format", "number", "Version of this file's format.", float(FORMAT), float(FORMAT)),
    Field(
        "angle",
        "number",
        "The declared social angle in degrees: 0 weighs the ego's own reward alone (egoistic), "
        "90 the others' alone (altruistic), 45 both alike.",
        high=360.0,
        below_high=True,
    ),
    Field(
        "confidence",
        "number",
        "Confidence of the verdict: 0.95 means that a wrong pass, and a wrong fail, each come "
        "in at most 5 % of audits.",
        low=0.8,
        high=0.9999,
    ),
    Field("owner", "text", "Who declares this: a person or an organisation."),
    Field("date", "date", "Day of the declaration, which comes before the audit's seed is drawn."),
    Field(
        "margin.regret",
        "number",
        "How much worse than the best reference driver the policy may be at the declared angle: "
        "in units of reward, per episode. This margin decides.",
        above_low=True,
    ),
    Field(
        "margin.largest_loss",
        "number",
        "The most by which one driver's reward of an episode, weighed by the declared angle, can "
        "lie below another's on the same episode. With it the verdict's confidence holds however "
        "rare the losses are; without it, if none is too rare to show.",
        above_low=True,
        required=False,
    ),
    Field(
        "margin.width",
        "number",
        "How far the direction of the driving may lie from the declared angle on either side, in "
        "degrees: between the reference drivers of the angles that are so far away. It decides.",
        high=LAST_DIRECTION,
        above_low=True,
        required=False,
    ),
    Field(
        "margin.beyond",
        "number",
        "Largest share of episodes in which the policy may drive beyond either end of the width, "
        "by more than twice margin.regret: a policy that draws its character by the episode does. "
        "It decides.",
        high=1.0,
        above_low=True,
        below_high=True,
        required=False,
    ),
    Field(
        "margin.degrees",
        "number",
        "Of declarations before 0.3: nothing is tested by it.",
        high=180.0,
        above_low=True,
        required=False,
    ),
    *(
        Field(
            f"clip.{name}",
            "range",
            f"Limits at which {name} of an episode is counted, of every driver alike. They bound "
            "the loss of an episode.",
            low=-LARGEST_NUMBER,
            required=False,
        )
        for name in ("r_env", "r_social")
    ),
    Field("reward.id", "text", "Name of the reward pair (r_env, r_social) that the angle weighs."),
    Field(
        "reward.sha256",
        "sha256",
        "SHA-256 of its weights and units: an angle means nothing without them.",
    ),
    Field(
        "scenario.world",
        "world",
        "The world in which the policy is audited: one of this package's, or an environment.",
    ),
    Field(
        "scenario.sha256",
        "sha256",
        "SHA-256 of the world's description with all its options, and of an environment's sources.",
    ),
    Field(
        "scenario.options",
        "options",
        "Options of the world that differ from its defaults; may be empty.",
    ),
    _share(
        "competence.max_at_fault",
        "Largest share of episodes in which the policy drives into another vehicle.",
    ),
    _share(
        "competence.max_struck",
        "Largest share of episodes in which another vehicle drives into it.",
    ),
    _share("competence.min_arrival", "Smallest share of episodes that arrive."),
    _share("competence.max_timeout", "Largest share of episodes that run out of time."),
    *(field for row in QUANTITIES.items() for field in _bounds_of(*row)),
    Field(
        RULE,
        "rule",
        "Rule that gives the angle of each decision by the situation: the first case whose "
        "conditions hold, or the default. With it the field angle doesn't decide; it is the angle "
        "at which tables and pictures weigh whole episodes.",
        required=False,
    ),
)
"""Every field in the order of a profile. Their meanings are part of a profile's bytes: changing one
changes the hash of every new declaration."""

TABLES: dict[str, dict[str, Field]] = {}
"""Fields by table and key; those of the top level are in the table ""."""
for _field in FIELDS:
    _table, _, _key = _field.path.rpartition(".")
    TABLES.setdefault(_table, {})[_key] = _field


def visible(text: str) -> bool:
    """Whether text is not empty, not too long, and free of characters that hide or reorder."""
    return len(text) <= LONGEST_TEXT and re.fullmatch(TEXT_PATTERN, text) is not None
