"""The shipped JSON Schema and the reader accept and refuse the same."""

import json
import math
from pathlib import Path

import pytest

import socialiq.audit.profile as package
from socialiq.audit.profile.fields import CLIP, RULE, schema
from socialiq.audit.profile.reader import parse
from socialiq.errors import UserError

SHIPPED = json.loads((Path(package.__file__).parent / "profile.schema.json").read_text())
TABLES = [
    name
    for name, one in SHIPPED["properties"].items()
    if one["type"] == "object" and name not in (CLIP, RULE)  # test_profile, test_declared_rule
]
FIELDS = {
    (table, name): one
    for table in ("", *TABLES)
    for name, one in (SHIPPED["properties"][table] if table else SHIPPED)["properties"].items()
    if name not in (*TABLES, CLIP, RULE)
}


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
    return found


def accepted(content):
    try:
        parse(toml(content).encode())
    except UserError as error:
        assert "must be" in str(error) or "missing" in str(error) or "unknown" in str(error)
        return False
    return True


def test_the_shipped_file_is_the_generated_one():
    assert schema() == SHIPPED


def test_the_declaration_itself_is_accepted(content):
    assert accepted(content)
    assert set(content) == set(SHIPPED["properties"]) - {CLIP, RULE} == set(SHIPPED["required"])
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

    from socialiq.worlds.registry import WORLDS

    one = FIELDS["scenario", "world"]
    assert all(re.search(one["pattern"], name) for name in WORLDS)
    names = {"mine.py:make": True, "mine:Mine-v0": True, "CartPole-v1": True, "elsewhere": False}
    for name, good in {**names, "a b:make": False, "mine:" + "x" * 200: False}.items():
        content["scenario"]["world"] = name
        fits = len(name) <= one["maxLength"] and bool(re.search(one["pattern"], name))
        assert accepted(content) == fits == good, name
