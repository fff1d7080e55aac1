"""Every message that names a setting names the option, or an argument that no command has."""

import ast
import contextlib
import importlib
import math
import re
from pathlib import Path

import pytest

import socialiq
from socialiq.learners.settings import Settings, _rules

ROOT = Path(socialiq.__file__).parent
FILES = [path for folder in ("cli", "learners") for path in sorted((ROOT / folder).rglob("*.py"))]
WORDS = {"angle", "demonstrations", "dial", "high", "loss", "low", "online", "seed", "strength"}
"""Settings whose names are words of the language, too, or of another thing."""


def kinds() -> list[type]:
    """All settings of learners."""
    for path in sorted((ROOT / "learners").rglob("*.py")):
        importlib.import_module(
            ".".join(("socialiq", *path.relative_to(ROOT).with_suffix("").parts))
        )
    waiting, found = [Settings], []
    while waiting:
        found.append(waiting.pop())
        waiting += found[-1].__subclasses__()
    return [*dict.fromkeys(found)]


FIELDS = {name for kind in kinds() for name in getattr(kind, "__dataclass_fields__", {})}


def messages() -> list[tuple[str, str]]:
    """Place and text of each message of `UserError`, without what is put into it."""
    found = []
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "UserError":
                parts = [
                    one.value for one in ast.walk(node.args[0]) if isinstance(one, ast.Constant)
                ]
                found.append((f"{path.name}:{node.lineno}", " ".join(map(str, parts))))
    return found


MESSAGES = [
    pytest.param(text, id=place)
    for place, text in messages()
    if {*re.findall(r"[a-z0-9_]+", text)} & (FIELDS - WORDS)
]


def test_messages_name_settings():
    assert len(MESSAGES) > 20


@pytest.mark.parametrize("text", MESSAGES)
def test_a_message_that_names_a_setting_names_its_option(text):
    assert re.search(r"--[a-z]|`[a-z_]+`", text), text


@pytest.mark.parametrize("kind", kinds(), ids=lambda kind: kind.__name__)
def test_a_value_out_of_range_is_answered_with_the_option(kind):
    for name, rule in _rules(kind).items():
        said = []
        for value in (-1.0, "no", math.nan, (-1.0,)):
            with contextlib.suppress(TypeError):  # not of the field's type
                try:
                    rule(name, value)
                except socialiq.UserError as error:
                    said.append(str(error))
        angles = name in ("low", "high", "demonstrators") or "angle" in name
        assert said and all("--" in line or angles for line in said), said
