"""Fields of a declaration, defined once for the reader, the writer and the JSON Schema."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Literal

from socialiq.social.angle_rule import FORMAT as RULE_FORMAT
from socialiq.social.angle_rule import LARGEST, MOST_CASES, MOST_CONDITIONS, MOST_POINTS
from socialiq.worlds import SCENE_IDS
from socialiq.worlds.environment import NAME_PATTERN
from socialiq.worlds.highway.options import MOST_SPEEDS
from socialiq.worlds.registry import NAMES

Kind = Literal["number", "text", "sha256", "world", "date", "options", "rule", "range"]
FORMAT = 1

RULE, CLIP = "angle_rule", "clip"
"""Tables that a declaration may lack: of a rule of the angle, and of limits of the rewards."""

LONGEST_TEXT = 200  # characters
MOST_OPTIONS = 64
LAST_DIRECTION = 90.0  # angles from 0 to this one, in degrees, may have a width
LARGEST_NUMBER = 1e6  # of a reward or an option; usual numbers are far smaller

# No control characters (C0, C1) and none that reorder or hide text of a report.
_HIDDEN = r"\u0000-\u001f\u007f-\u009f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff"
TEXT_PATTERN = rf"^[^{_HIDDEN}]+$"
SHA256_PATTERN = r"^[0-9a-f]{64}$"

WORLD_PATTERN = (
    f"^(?:{'|'.join([*NAMES, *SCENE_IDS])}|{NAME_PATTERN}|[^{_HIDDEN}:]+\\.safetensors)$"
)


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

    @property
    def demand(self) -> str:
        """Description of the expected value."""
        if self.kind == "number":
            start = f"above {self.low:g}" if self.above_low else f"of at least {self.low:g}"
            end = f"below {self.high:g}" if self.below_high else f"at most {self.high:g}"
            return f"a number {start} and {end}"
        return {
            "text": f"1 to {LONGEST_TEXT} characters of visible text in quotes",
            "sha256": "64 hexadecimal digits (0-9, a-f) in quotes",
            "world": f"one of {', '.join([*NAMES, *SCENE_IDS])}, a file of `socialiq data world`, "
            "a Gymnasium id, MODULE:ID or MODULE:FUNCTION",
            "date": "a date as 2026-01-31, without quotes",
            "options": "a table of the world's options",
            "range": "a list of two numbers, the smaller one first",
            "rule": "a table with format, world, default and [[angle_rule.when]]",
        }[self.kind]


def _share(path: str, meaning: str) -> Field:
    return Field(path, "number", meaning, high=1.0)


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

BY_PATH = {field.path: field for field in FIELDS}
TABLES = tuple(dict.fromkeys(field.path.split(".")[0] for field in FIELDS if "." in field.path))


def visible(text: str) -> bool:
    """Whether text is not empty, not too long, and free of characters that hide or reorder."""
    return len(text) <= LONGEST_TEXT and re.fullmatch(TEXT_PATTERN, text) is not None


def schema() -> dict[str, Any]:
    """Return the content of `profile.schema.json` (JSON Schema 2020-12)."""
    top = [field for field in FIELDS if "." not in field.path]
    properties = {field.path: _schema_of(field) for field in top}
    for table in TABLES:
        inside = {
            field.path.split(".")[1]: field
            for field in FIELDS
            if field.path.startswith(f"{table}.")
        }
        needed = [name for name, field in inside.items() if field.required or table == CLIP]
        properties[table] = _table(
            {name: _schema_of(field) for name, field in inside.items()}, needed
        )
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Declaration of a driving policy's social angle (profile.toml)",
        "description": "Dates are TOML dates; as JSON they are texts of the form 2026-01-31.",
        **_table(properties, [name for name in properties if name not in (RULE, CLIP)]),
    }


def _table(properties: dict[str, Any], required: list[str]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": False,
    }


def _schema_of(field: Field) -> dict[str, Any]:
    degrees = {"type": "number", "minimum": 0, "exclusiveMaximum": 360}
    bound = {"type": "number", "minimum": -LARGEST, "maximum": LARGEST}
    points = {"type": "array", "minItems": 2, "maxItems": MOST_POINTS}
    interpolated = {
        "by": {"type": "string"},
        "at": {**points, "items": bound},
        "degrees": {**points, "items": degrees},
    }
    angle = {"anyOf": [degrees, _table(interpolated, list(interpolated))]}
    limits = {**_table({"at_least": bound, "at_most": bound}, []), "minProperties": 1}
    case = {
        "type": "object",
        "properties": {"angle": angle},
        "required": ["angle"],
        "additionalProperties": limits,
        "minProperties": 2,
        "maxProperties": MOST_CONDITIONS + 1,
    }
    rule = {
        "format": {"const": RULE_FORMAT},
        "world": {"type": "string"},
        "default": angle,
        "when": {"type": "array", "items": case, "maxItems": MOST_CASES},
    }
    low = "exclusiveMinimum" if field.above_low else "minimum"
    high = "exclusiveMaximum" if field.below_high else "maximum"
    text = {"type": "string", "maxLength": LONGEST_TEXT}
    number = {"type": "number", "minimum": -LARGEST_NUMBER, "maximum": LARGEST_NUMBER}
    numbers = {"type": "array", "items": number, "maxItems": MOST_SPEEDS}
    option = {"anyOf": [text, {"type": "boolean"}, number, numbers]}
    constraints: dict[Kind, dict[str, Any]] = {
        "number": {"type": "number", low: field.low, high: field.high},
        "range": {"type": "array", "items": number, "minItems": 2, "maxItems": 2},
        "rule": _table(rule, ["format", "world", "default"]),  # as `social.angle_rule` says
        "text": {**text, "minLength": 1, "pattern": TEXT_PATTERN},
        "sha256": {"type": "string", "pattern": SHA256_PATTERN},
        "world": {**text, "pattern": WORLD_PATTERN},
        "date": {"type": "string", "format": "date"},
        "options": {
            "type": "object",
            "maxProperties": MOST_OPTIONS,
            "additionalProperties": option,
        },
    }
    return {"description": field.meaning, **constraints[field.kind]}
