"""Where a field stands in a TOML file, which `tomllib` doesn't tell."""

from __future__ import annotations

import re

_TABLE = re.compile(r"^\s*\[\s*([^\[\]]+?)\s*\]\s*(#.*)?$")
_KEY = re.compile(r"^\s*([A-Za-z0-9_\-\"'. ]+?)\s*=")


def line_of(text: str, path: str) -> int:
    """The number of the line, from 1, on which a field begins.

    Exact for files without multi-line strings, which a profile refuses.

    Args:
        text: The file.
        path: Table and key, joined by a dot.

    Returns:
        The line; of a field that is missing, or hidden in an inline table, the line of the
        innermost table around it, and 1 if that is missing too.
    """
    found = _begun(text)
    parts = path.split(".")
    for length in range(len(parts), 0, -1):
        line = found.get(".".join(parts[:length]))
        if line:
            return line
    return 1


def _begun(text: str) -> dict[str, int]:
    """First line of every table and every field, by path."""
    table, found = "", {}
    for number, line in enumerate(text.split("\n"), 1):
        header, key = _TABLE.match(line), _KEY.match(line)
        if header:
            table = _plain(header[1])
            found.setdefault(table, number)
        elif key:
            found.setdefault(f"{table}.{_plain(key[1])}".lstrip("."), number)
    return found


def _plain(key: str) -> str:
    """A dotted key without its quotes and spaces."""
    return ".".join(part.strip(" \t\"'") for part in key.split("."))
