"""A report read from a file is held against its schema before anything is made from it."""

from __future__ import annotations

import json
import re
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from socialiq.errors import UserError

LARGEST_REPORT = 16 * 1024 * 1024  # bytes; a report with its cloud has about 100,000
_TYPES: dict[str, Any] = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "integer": int,
    "number": (int, float),
    "null": type(None),
}


@cache
def shipped_schema() -> dict[str, Any]:
    """The schema that comes with the package."""
    return json.loads(files("socialiq.audit.report").joinpath("report.schema.json").read_text())


def read_report(path: Path) -> dict[str, Any]:
    """Read a `report.json` and check it.

    Raises:
        UserError: If it is missing, too large, no JSON, or doesn't follow the schema.
    """
    if not path.is_file():
        raise UserError(f"no such file: {path}: name a folder that `socialiq audit` wrote")
    with path.open("rb") as file:
        content = file.read(LARGEST_REPORT + 1)
    if len(content) > LARGEST_REPORT:
        raise UserError(f"{path} has more than {LARGEST_REPORT:,} bytes: it is no report")
    try:
        report = json.loads(content, parse_constant=_refuse)
        # Half of a surrogate pair is JSON, but no text: no page could be written with it.
        json.dumps(report, ensure_ascii=False).encode()
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} is no JSON: restore it, or audit anew") from error
    fault = fault_of(report, shipped_schema())
    if fault:
        raise UserError(f"{path} is no report of this version: {fault}; audit anew")
    return report


def _refuse(word: str) -> None:
    raise ValueError(word)


def fault_of(value: Any, schema: dict[str, Any], place: str = "the report") -> str:
    """What is wrong with a value, or "" if nothing is.

    Args:
        value: Of JSON.
        schema: With the words of JSON Schema that `layout` uses, and no others.
        place: Where the value stands, for the fault.
    """
    if "anyOf" in schema:
        faults = [fault_of(value, one, place) for one in schema["anyOf"]]
        return "" if "" in faults else faults[0]
    if "const" in schema or "enum" in schema:
        known = schema.get("enum", [schema.get("const")])
        return "" if any(_same(value, one) for one in known) else f"{place} is none of {known}"
    if not _is(value, schema["type"]):
        return f"{place} is no {schema['type']}"
    if isinstance(value, str):
        fits = re.search(schema.get("pattern", ""), value)
        return "" if fits else f"{place} has another form"
    if isinstance(value, int | float) and not isinstance(value, bool):
        inside = schema.get("minimum", value) <= value <= schema.get("maximum", value)
        return "" if inside else f"{place} is out of range"
    return _of_parts(value, schema, place)


def _of_parts(value: Any, schema: dict[str, Any], place: str) -> str:
    if isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            return f"{place} has another length"
        pairs = ((one, schema["items"], f"{place}[{row}]") for row, one in enumerate(value))
    elif isinstance(value, dict):
        known, others = schema.get("properties", {}), schema.get("additionalProperties", True)
        missing = [name for name in schema.get("required", ()) if name not in value]
        strange = [name for name in value if name not in known] if others is False else []
        if missing or strange:
            return f"{place} {'lacks ' + missing[0] if missing else 'has an unknown field'}"
        free = others if isinstance(others, dict) else None
        pairs = (
            (one, known.get(name, free), f"{place}.{name}")
            for name, one in value.items()
            if name in known or free
        )
    else:
        return ""
    return next((fault for one in pairs if (fault := fault_of(*one))), "")


def _is(value: Any, kind: str) -> bool:
    if isinstance(value, bool):
        return kind == "boolean"
    return isinstance(value, _TYPES[kind])


def _same(value: Any, known: Any) -> bool:
    return type(value) is type(known) and value == known
