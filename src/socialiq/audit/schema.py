"""The JSON Schema of a declaration, from the same fields as the reader."""

from __future__ import annotations

from typing import Any

from socialiq.audit.fields import (
    FIELDS,
    LARGEST_NUMBER,
    LONGEST_TEXT,
    MOST_OPTIONS,
    SHA256_PATTERN,
    TABLES,
    TEXT_PATTERN,
    WORLD_PATTERN,
    Field,
)
from socialiq.worlds.intersection.options import MOST_SPEEDS


def schema() -> dict[str, Any]:
    """What `profile.schema.json` holds (JSON Schema 2020-12)."""
    top = [field for field in FIELDS if "." not in field.path]
    properties: dict[str, Any] = {field.path: _of(field) for field in top}
    for table in TABLES:
        inside = [field for field in FIELDS if field.path.startswith(f"{table}.")]
        properties[table] = _table({field.path.split(".")[1]: _of(field) for field in inside})
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Declaration of a driving policy's social angle (profile.toml)",
        "description": "Dates are TOML dates; as JSON they are texts of the form 2026-01-31.",
        **_table(properties),
    }


def _table(properties: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def _of(field: Field) -> dict[str, Any]:
    return {"description": field.meaning, **_constraints(field)}


def _constraints(field: Field) -> dict[str, Any]:
    if field.kind == "number":
        low = "exclusiveMinimum" if field.above_low else "minimum"
        high = "exclusiveMaximum" if field.below_high else "maximum"
        return {"type": "number", low: field.low, high: field.high}
    number = {"type": "number", "minimum": -LARGEST_NUMBER, "maximum": LARGEST_NUMBER}
    return {
        "text": {
            "type": "string",
            "minLength": 1,
            "maxLength": LONGEST_TEXT,
            "pattern": TEXT_PATTERN,
        },
        "sha256": {"type": "string", "pattern": SHA256_PATTERN},
        "world": {"type": "string", "maxLength": LONGEST_TEXT, "pattern": WORLD_PATTERN},
        "date": {"type": "string", "format": "date"},
        "options": {
            "type": "object",
            "maxProperties": MOST_OPTIONS,
            "additionalProperties": {
                "anyOf": [
                    {"type": "string", "maxLength": LONGEST_TEXT},
                    {"type": "boolean"},
                    number,
                    {"type": "array", "items": number, "maxItems": MOST_SPEEDS},
                ]
            },
        },
    }[field.kind]
