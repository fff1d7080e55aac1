"""The shipped JSON Schema and the reader accept and refuse the same."""

import json
import math
from pathlib import Path

import pytest

import socialiq.audit.profile as package
from socialiq.audit.profile import fields as code
from socialiq.audit.profile.fields import CAUSED, CLIP, RULE
from socialiq.audit.profile.reader import parse
from socialiq.errors import UserError
from socialiq.social import angle_rule as rules
from socialiq.worlds.highway.options import MOST_SPEEDS

SHIPPED = json.loads((Path(package.__file__).parent / "profile.schema.json").read_text())
TABLES = [
    name
    for name, one in SHIPPED["properties"].items()
    if one["type"] == "object" and name not in (CAUSED, CLIP, RULE)  # test_reader
]
FIELDS = {
    (table, name): one
    for table in ("", *TABLES)
    for name, one in (SHIPPED["properties"][table] if table else SHIPPED)["properties"].items()
    if name not in (*TABLES, CAUSED, CLIP, RULE)
}


def generated():
    """Return the content of profile.schema.json: print it as JSON after a field has changed."""
    top = [field for field in code.FIELDS if "." not in field.path]
    properties = {field.path: schema_of(field) for field in top}
    for table in filter(None, code.TABLES):
        inside = {
            field.path.split(".")[1]: field
            for field in code.FIELDS
            if field.path.startswith(f"{table}.")
        }
        needed = [name for name, field in inside.items() if field.required or table == CLIP]
        properties[table] = object_of(
            {name: schema_of(field) for name, field in inside.items()}, needed
        )
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Declaration of a driving policy's social angle (profile.toml)",
        "description": "Dates are TOML dates; as JSON they are texts of the form 2026-01-31.",
        **object_of(properties, [name for name in properties if name not in (RULE, CLIP, CAUSED)]),
    }


def object_of(properties, required):
    return {
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": False,
    }


def schema_of(field):
    degrees = {"type": "number", "minimum": 0, "exclusiveMaximum": 360}
    bound = {"type": "number", "minimum": -rules.LARGEST, "maximum": rules.LARGEST}
    points = {"type": "array", "minItems": 2, "maxItems": rules.MOST_POINTS}
    interpolated = {
        "by": {"type": "string"},
        "at": {**points, "items": bound},
        "degrees": {**points, "items": degrees},
    }
    angle = {"anyOf": [degrees, object_of(interpolated, list(interpolated))]}
    limits = {**object_of({"at_least": bound, "at_most": bound}, []), "minProperties": 1}
    case = {
        "type": "object",
        "properties": {"angle": angle},
        "required": ["angle"],
        "additionalProperties": limits,
        "minProperties": 2,
        "maxProperties": rules.MOST_CONDITIONS + 1,
    }
    rule = {
        "format": {"const": rules.FORMAT},
        "world": {"type": "string"},
        "default": angle,
        "when": {"type": "array", "items": case, "maxItems": rules.MOST_CASES},
    }
    low = "exclusiveMinimum" if field.above_low else "minimum"
    high = "exclusiveMaximum" if field.below_high else "maximum"
    text = {"type": "string", "maxLength": code.LONGEST_TEXT}
    number = {"type": "number", "minimum": -code.LARGEST_NUMBER, "maximum": code.LARGEST_NUMBER}
    numbers = {"type": "array", "items": number, "maxItems": MOST_SPEEDS}
    option = {"anyOf": [text, {"type": "boolean"}, number, numbers]}
    constraints = {
        "number": {"type": "number", low: field.low, high: field.high},
        "range": {"type": "array", "items": number, "minItems": 2, "maxItems": 2},
        "rule": object_of(rule, ["format", "world", "default"]),  # as `social.angle_rule` says
        "text": {**text, "minLength": 1, "pattern": code.TEXT_PATTERN},
        "sha256": {"type": "string", "pattern": code.SHA256_PATTERN},
        "world": {**text, "pattern": code.WORLD_PATTERN},
        "date": {"type": "string", "format": "date"},
        "options": {
            "type": "object",
            "maxProperties": code.MOST_OPTIONS,
            "additionalProperties": option,
        },
    }
    return {"description": field.meaning, **constraints[field.kind]}


def required(table):
    return (SHIPPED["properties"][table] if table else SHIPPED)["required"]


def toml(content):
    """A declaration as JSON, written as TOML by other means than the template."""
    top = {name: one for name, one in content.items() if not isinstance(one, dict)}
    lines = [f"{name} = {value(one, name)}" for name, one in top.items()]
    for table, fields in content.items():
        if isinstance(fields, dict):
            pairs = {name: one for name, one in fields.items() if not isinstance(one, dict)}
            lines += [f"[{table}]", *(f"{name} = {value(one)}" for name, one in pairs.items())]
            nested = [name for name in fields if name not in pairs]
            lines += [f"[{table}.{name}]" for name in nested]
    return "\n".join(lines)


def value(one, name=""):
    return one if name == "date" else json.dumps(one)


@pytest.fixture
def content(declared):
    from socialiq.to_json import to_json

    found = {"format": 1, **to_json(declared())}
    assert found["margin"].pop("degrees") == 10.0
    assert {found["margin"].pop(name) for name in ("largest_loss", "width", "beyond")} == {None}
    assert found.pop("rule") is found.pop("clip") is None
    assert found.pop("caused") == []
    return found


def accepted(content):
    try:
        parse(toml(content).encode())
    except UserError as error:
        assert "must be" in str(error) or "missing" in str(error) or "unknown" in str(error)
        return False
    return True


def test_the_shipped_file_is_the_generated_one():
    assert generated() == SHIPPED, json.dumps(generated(), indent=2)


def test_the_declaration_itself_is_accepted(content):
    assert accepted(content)
    assert (
        set(content)
        == set(SHIPPED["properties"]) - {CAUSED, CLIP, RULE}
        == set(SHIPPED["required"])
    )
    for table in TABLES:
        assert set(content[table]) == set(required(table))


def test_optional_fields_are_of_the_margin(content):
    optional = [field for field in FIELDS if field[1] not in required(field[0])]
    names = ("largest_loss", "width", "beyond", "degrees")
    assert optional == [("margin", name) for name in names]
    content["margin"] |= {"largest_loss": 100.0, "width": 15.0, "beyond": 0.05, "degrees": 10.0}
    assert accepted(content)


@pytest.mark.parametrize(
    "field", [one for one in FIELDS if one[1] in required(one[0])], ids=".".join
)
def test_required_means_required(content, field):
    table, name = field
    del (content[table] if table else content)[name]
    assert not accepted(content)


@pytest.mark.parametrize("table", ["", *TABLES])
def test_nothing_else_is_allowed(content, table):
    assert (SHIPPED["properties"][table] if table else SHIPPED)["additionalProperties"] is False
    (content[table] if table else content)["more"] = 1
    assert not accepted(content)


NUMBERS = [field for field, one in FIELDS.items() if one["type"] == "number"]


@pytest.mark.parametrize("field", NUMBERS, ids=".".join)
def test_numbers_have_the_same_bounds(content, field):
    (table, name), one = field, FIELDS[field]
    holder = content[table] if table else content
    if field == ("margin", "largest_loss"):
        content["margin"]["regret"] = 1e-300  # the reader compares the two
    if field == ("margin", "beyond"):
        content["margin"]["width"] = 15.0
    low = one.get("minimum", one.get("exclusiveMinimum"))
    high = one.get("maximum", one.get("exclusiveMaximum"))
    expected = {
        low: "minimum" in one,
        high: "maximum" in one,
        math.nextafter(low, -math.inf): False,
        math.nextafter(high, math.inf): False,
        (low + high) / 2: True,
    }
    for number, good in expected.items():
        holder[name] = number
        assert accepted(content) == good, number


def test_texts_have_the_same_pattern_and_length(content):
    import re

    one = FIELDS["", "owner"]
    for text in (
        "a",
        "é ü 漢",
        "x" * one["maxLength"],
        "x" * (one["maxLength"] + 1),
        "a\tb",
        "\x85",
    ):
        content["owner"] = text
        fits = one["minLength"] <= len(text) <= one["maxLength"]
        assert accepted(content) == (fits and bool(re.search(one["pattern"], text))), ascii(text)
    for number in (7, 1.5, True):
        content["owner"] = number
        assert not accepted(content)


def test_the_worlds_are_those_of_the_schema(content):
    import re

    from socialiq.worlds.catalogue import KNOWN, OLD, base

    one = FIELDS["scenario", "world"]
    assert all(re.search(one["pattern"], name) for name in (*KNOWN, *OLD) if base(name) in KNOWN)
    names = {"mine.py:make": True, "mine:Mine-v0": True, "CartPole-v1": True, "elsewhere": False}
    for name, good in {**names, "a b:make": False, "mine:" + "x" * 200: False}.items():
        content["scenario"]["world"] = name
        fits = len(name) <= one["maxLength"] and bool(re.search(one["pattern"], name))
        assert accepted(content) == fits == good, name
