"""Output of commands: one JSON object, or tables."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from socialiq.to_json import rounded

_PIPED_WIDTH = 160  # width of a table in a file or a pipe
_LEAST_WIDTH = 100  # a narrower terminal breaks lines, but numbers stay complete


class Printing:
    """Base of commands that print a result: tables, or one JSON object with --json.

    `--json` is an option of the program, which the command line takes out before a command's own.
    """

    json = False


def print_json(value: Mapping[str, Any]) -> None:
    """Print one JSON object on standard output."""
    sys.stdout.write(json.dumps(rounded(value), allow_nan=False) + "\n")


def say(line: str) -> None:
    """Print one line on standard error, as it is."""
    sys.stderr.write(f"{line}\n")


def complain(line: str) -> None:
    """Print one line on standard error."""
    sys.stderr.write(f"socialiq: {line}\n")


def print_table(rows: Sequence[Mapping[str, Any]], title: str = "") -> None:
    """Print rows of equal keys as a table, with numbers to three decimals."""
    table = Table(header_style="bold", box=None, padding=(0, 2, 0, 0))
    for name in rows[0]:
        numeric = all(isinstance(row[name], int | float) for row in rows)
        table.add_column(
            str(name).replace("_", " "),
            justify="right" if numeric else "left",
            no_wrap=max(len(cell_text(row[name])) for row in rows) <= 12,
            overflow="fold",
        )
    for row in rows:
        table.add_row(*(cell_text(value) for value in row.values()))
    if title:
        sys.stdout.write(f"{title}\n")
    width = max(Console().width, _LEAST_WIDTH) if sys.stdout.isatty() else _PIPED_WIDTH
    Console(width=width).print(table)


def cell_text(value: Any) -> str:
    """Return a cell's text."""
    if isinstance(value, float):
        text = f"{value:.3f}".rstrip("0").rstrip(".")
        return "0" if text == "-0" else text
    return str(value)
