"""A study's results as a folder of plain files: JSON, CSV and pictures."""

from __future__ import annotations

import csv
import io
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from socialiq import provenance
from socialiq.errors import UserError, one_of
from socialiq.outputs import check_output_folder, whole_folder
from socialiq.storage import open_csv, read_json, shipped, write_atomically, write_json
from socialiq.to_json import rounded, to_json
from socialiq.types import Row

LIBRARIES = ("socialiq", "numpy", "scipy", "jax", "equinox", "optax")


@dataclass(frozen=True)
class Results:
    """Results of a study.

    Attributes:
        study: Its name.
        config: Its resolved configuration: seeds, sizes, presets, hashes of the data.
        tables: Rows by table name; each becomes a CSV file.
        summary: Values that the claims ledger refers to.
        versions: Versions of Python and of the numerical libraries.
        files: Content of other files by path; written, but not read back.
    """

    study: str
    config: dict[str, Any]
    tables: dict[str, list[Row]]
    summary: dict[str, Any]
    versions: dict[str, str]
    files: Mapping[str, bytes] = field(default_factory=dict)

    @staticmethod
    def of(
        study: str,
        config: Any,
        tables: dict[str, list[Row]],
        summary: dict[str, Any],
        files: Mapping[str, bytes] | None = None,
    ) -> Results:
        """Round numbers, leave out empty tables, make the configuration plain, note versions.

        Args:
            study: Name of the study.
            config: Its resolved configuration, a dataclass or other values with a JSON form.
            tables: Rows by table name.
            summary: Values that the claims ledger refers to.
            files: Content of other files by path; none by default.
        """
        plain = {name: rounded(rows) for name, rows in tables.items() if rows}
        values = to_json(config), plain, rounded(summary), versions()
        return Results(study, *values, dict(files or {}))


def versions() -> dict[str, str]:
    """Return the versions of Python, this package and the numerical libraries, and the machine."""
    return {**provenance.versions(LIBRARIES), "machine": platform.machine()}


def save(results: Results, folder: Path, pictures: Mapping[str, bytes], replace: bool) -> None:
    """Write a results folder whole, with PNG pictures by name, or leave the existing one.

    Args:
        results: The results.
        folder: Folder to write.
        pictures: PNG files by name, without .png.
        replace: Whether an existing results folder is replaced.

    Raises:
        UserError: As `check_target`, or if a file can't be written.
    """
    check_target(folder, replace)
    with whole_folder(folder, replace) as part:
        head = {"study": results.study, "versions": results.versions, "config": results.config}
        write_json(part / "config.json", head)
        write_json(part / "summary.json", results.summary)
        for name, rows in results.tables.items():
            write_atomically(part / f"{name}.csv", as_csv(rows))
        for name, png in pictures.items():
            write_atomically(part / f"{name}.png", png)
        for name, content in results.files.items():
            (part / name).parent.mkdir(exist_ok=True)
            write_atomically(part / name, content)


def check_target(folder: Path, replace: bool) -> None:
    """Refuse an output folder before any work is done.

    Args:
        folder: Folder to write.
        replace: Whether an existing results folder may be replaced.

    Raises:
        UserError: If it has content and may not be replaced, has content that is no results folder,
            or can't be made.
    """
    if check_output_folder(folder, replace) and not (folder / "summary.json").is_file():
        raise UserError(f"{folder} is not a results folder: it is not replaced; name another")


def load(folder: Path) -> Results:
    """Read a results folder; `UserError` if it is none."""
    folder = shipped(folder)
    if not (folder / "config.json").is_file():
        raise UserError(f"{folder} is not a results folder: run `socialiq reproduce` first")
    head = read_json(folder / "config.json")
    tables = {path.stem: from_csv(path) for path in sorted(folder.glob("*.csv"))}
    summary = read_json(folder / "summary.json")
    kinds = {"study": str, "config": dict, "versions": dict}
    if not isinstance(head, dict) or not isinstance(summary, dict):
        raise UserError(f"{folder} is damaged: restore it or make it again")
    if any(not isinstance(head.get(name), kind) for name, kind in kinds.items()):
        raise UserError(f"{folder / 'config.json'} lacks {', '.join(kinds)}: make it again")
    return Results(head["study"], head["config"], tables, summary, head["versions"])


def as_csv(rows: list[Row]) -> str:
    """Return at least one row, of equal keys, as CSV text."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def from_csv(path: Path) -> list[Row]:
    """Return the rows of a CSV file; numeric cells become numbers."""
    try:
        with open_csv(path) as file:
            head, *rows = csv.reader(file)
    except (csv.Error, ValueError) as error:
        raise UserError(f"{path} is damaged: restore it or make it again") from error
    for number, row in enumerate(rows, start=2):
        if len(row) != len(head):
            raise UserError(
                f"{path} is damaged: line {number} has {len(row)} cells, the first {len(head)}; "
                "restore it or make it again"
            )
    return [dict(zip(head, map(_cell, row), strict=True)) for row in rows]


def _cell(text: str) -> Any:
    for kind in (int, float) if text.isascii() else ():
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def where(rows: Sequence[Row], conditions: Mapping[str, Any]) -> list[Row]:
    """Return the rows that meet every condition.

    Args:
        rows: Rows with equal columns.
        conditions: Value of a column, or a list of its possible values, by name of the column.

    Raises:
        UserError: If a column is unknown.
    """
    for name in conditions if rows else ():
        one_of("column", name, tuple(rows[0]))
    allowed = {
        name: list(value) if isinstance(value, list | tuple) else [value]
        for name, value in conditions.items()
    }
    return [row for row in rows if all(row[name] in values for name, values in allowed.items())]


def as_text(value: Any) -> str:
    """Return a value of a column as a key or a word: a float as short as it can be."""
    return f"{value:g}" if isinstance(value, float) else str(value)
