"""All scripts of the page as one, so that a page opened from a folder runs and has one hash.

Each file is an ES module. In the bundle it is a function that returns what it exports; an import
is an assignment. Node reads the files as they are, for tests.
"""

from __future__ import annotations

import re
from pathlib import Path

ASSETS = Path(__file__).with_name("assets")
START = "page"
"""Script that starts the page."""

_IMPORT = re.compile(r'^import \{ ([^}]+) \} from "\./([\w-]+)\.js";$', re.M)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const) (\w+))", re.M)


def program(start: str = START) -> str:
    """Return a program: a script with every script that it needs, each after those it needs.

    Args:
        start: Name of the script that starts it, without `.js`.
    """
    parts: dict[str, str] = {}
    _add(start, parts)
    return "\n".join(['"use strict";', *parts.values()])


def _add(name: str, parts: dict[str, str]) -> None:
    """Add a script after the scripts that it imports."""
    if name in parts:
        return
    source = (ASSETS / f"{name}.js").read_text(encoding="utf-8")
    for _, other in _IMPORT.findall(source):
        _add(other, parts)
    names = ", ".join(_EXPORT.findall(source))
    body = _EXPORT.sub("", _IMPORT.sub(r"const { \1 } = script_\2;", source))
    parts[name] = f"const script_{name} = (() => {{\n{body}return {{ {names} }};\n}})();"
