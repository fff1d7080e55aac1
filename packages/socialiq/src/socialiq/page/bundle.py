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

_IMPORT = re.compile(r'^import \{ ([^}]+) \} from "((?:\.\.?/)(?:[\w./]+/)?(\w+)\.js)";$', re.M)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const) (\w+))", re.M)


def program(start: str = START, folder: Path = ASSETS) -> str:
    """Return a program: a script with every script that it needs, each after those it needs.

    Args:
        start: Name of the script that starts it, without `.js`.
        folder: Its folder; scripts of several folders have different names.
    """
    sources: dict[str, str] = {}
    _add(folder / f"{start}.js", sources)
    return "\n".join(['"use strict";', *sources.values()])


def _add(path: Path, sources: dict[str, str]) -> None:
    """Add a script after the scripts that it imports."""
    name = path.stem
    if name in sources:
        return
    source = path.read_text(encoding="utf-8")
    for _, target, _ in _IMPORT.findall(source):
        _add(path.parent / target, sources)
    names = ", ".join(_EXPORT.findall(source))
    body = _EXPORT.sub("", _IMPORT.sub(r"const { \1 } = script_\3;", source))
    sources[name] = f"const script_{name} = (() => {{\n{body}return {{ {names} }};\n}})();"
