"""Output of commands: one JSON object or tables, and on standard error the progress.

The functions of `socialiq.functions` do the work of commands and print nothing (`as_function`).
"""

from __future__ import annotations

import contextlib
import contextvars
import io
import json
import math
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rich.table
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from socialiq.learners.callbacks import PARTS, Report
from socialiq.outputs import refuse_existing
from socialiq.reading import path_of
from socialiq.results_folder import as_csv
from socialiq.social.angle import angle_of
from socialiq.storage import write_atomically
from socialiq.to_json import rounded
from socialiq.types import Row

_PIPED_WIDTH = 160  # width of a table in a file or a pipe
_LEAST_WIDTH = 100  # a narrower terminal breaks lines, but numbers stay complete
_PLAIN_SECONDS = 10.0  # between two plain lines of one stage
_WIDE = 60  # columns of a terminal that has room for counts and units


_IN_PYTHON = contextvars.ContextVar("in Python", default=False)


@contextlib.contextmanager
def as_function() -> Iterator[None]:
    """Print no progress in the block, and raise complaints as warnings of Python."""
    before = _IN_PYTHON.set(True)
    try:
        yield
    finally:
        _IN_PYTHON.reset(before)


@dataclass(frozen=True, repr=False)
class Result(Mapping[str, Any]):
    """Numbers of a command by name, as --json prints them; its repr is the printed table.

    Attributes:
        numbers: The numbers, JSON-compatible.
        rows: The same as rows of a table with equal keys.
        title: Line above the table; "" for none.
        table: Every number as rows of equal keys, one for each policy, angle and seed; by default
            the numbers as one row.
        labels: Columns of the table that say what a row measures, without those of seeds.
        outcomes: What each call returned, if sequences made several of one.
    """

    numbers: Mapping[str, Any]
    rows: Sequence[Mapping[str, Any]]
    title: str = ""
    table: Sequence[Mapping[str, Any]] = ()
    labels: Sequence[str] = ()
    outcomes: Sequence[Any] = ()

    def __post_init__(self) -> None:
        if not self.table:
            object.__setattr__(self, "table", (self.numbers,))

    def to_csv(self, path: str | Path | None = None) -> str:
        """Return the table as CSV text.

        Args:
            path: File to write too; must not exist.

        Raises:
            UserError: If the file exists or can't be written.
        """
        text = as_csv([{**row} for row in self.table])
        if path is not None:
            refuse_existing(path_of(path), ".csv")
            write_atomically(path_of(path), text, replace=False)
        return text

    def means(self) -> list[Row]:
        """Return the mean and the standard error of each number over seeds.

        The seeds are those of the trainings if the table has them (`training_seed`), else those
        of the episodes. Rows that agree in every label and in the seed are averaged first.

        Returns:
            A row for each combination of labels: these, the number of `seeds`, and of each number
            its mean and `..._error`, the standard error of the mean, which is NaN for one seed.
            Intervals are left out, because they describe the episodes of one row. Angles have no
            mean: `angle` is that of the mean rewards.
        """
        seeds = ("training_seed", "seed")
        over = next((name for name in seeds if name in self.table[0]), "")
        groups = dict[tuple[Any, ...], dict[Any, list[Mapping[str, Any]]]]()
        for row in self.table:
            label = tuple((name, row[name]) for name in self.labels if name in row)
            groups.setdefault(label, {}).setdefault(row.get(over), []).append(row)
        means = list[Row]()
        for label, by_seed in groups.items():
            rows = [row for of_seed in by_seed.values() for row in of_seed]
            mean: Row = {**dict(label), "seeds": len(by_seed)}
            for name in rows[0]:
                left_out = name in (*mean, *seeds, "angle", "angle_hat")
                left_out = left_out or name.endswith(("_low", "_high"))
                if left_out or not all(is_number(row[name]) for row in rows):
                    continue
                values = [np.mean([row[name] for row in of_seed]) for of_seed in by_seed.values()]
                mean[name] = float(np.mean(values))
                error = np.std(values, ddof=1) / len(values) ** 0.5 if len(values) > 1 else np.nan
                mean[f"{name}_error"] = float(error)
            if "angle" in rows[0] and "angle" not in mean and {"r_env", "r_social"} <= mean.keys():
                mean["angle"] = angle_of(mean["r_env"], mean["r_social"])
            means.append(mean)
        return filled(means)

    def __getitem__(self, name: str) -> Any:
        return self.numbers[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.numbers)

    def __len__(self) -> int:
        return len(self.numbers)

    def __repr__(self) -> str:
        text = io.StringIO()
        Console(file=text, width=_PIPED_WIDTH).print(_table(self.rows))
        return f"{self.title}\n{text.getvalue()}".strip()


@dataclass(frozen=True, repr=False)
class Policies(Result):
    """Outcome of a training: numbers by name, and the policies or dials in the order of the rows.

    Attributes:
        trained: The policies or dials, one for each run; they can be saved.
        failures: One line for each run that stopped early.
    """

    labels: Sequence[str] = ("angle", "strength")
    trained: Sequence[Any] = ()
    failures: Sequence[str] = ()

    def policy(self, run: int = 0) -> Any:
        """Return the policy or dial of one run, by its number from 0."""
        return self.trained[run]


def is_number(value: Any) -> bool:
    """Return whether a cell of a table is a number; a truth value is none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def filled(rows: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Return rows with the columns of all rows, "" where a row lacks one."""
    names = dict.fromkeys(name for row in rows for name in row)
    return [{name: row.get(name, "") for name in names} for row in rows]


class Printing:
    """Base of commands that print a result: tables, or one JSON object with --json.

    `--json` is an option of the program, which the command line takes out before a command's own.
    """

    json = False

    def run(self) -> int:
        """Do the work, print the result; return the exit status."""
        result = self.result()
        return self.show(result.numbers, result.rows, result.title)

    def result(self) -> Result:
        """Do the work and return its result."""
        raise NotImplementedError

    def show(
        self, result: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], title: str = ""
    ) -> int:
        """Print a result, as JSON or as a table of rows.

        Args:
            result: The result, for JSON.
            rows: The result as rows of equal keys, at least one.
            title: Line above the table; "" for none.

        Returns:
            The exit status 0.
        """
        if self.json:
            print_json(result)
        else:
            print_table(rows, title)
        return 0


def print_json(value: Mapping[str, Any]) -> None:
    """Print one JSON object on standard output."""
    sys.stdout.write(json.dumps(rounded(value), allow_nan=False) + "\n")


def say(line: str) -> None:
    """Print one line on standard error, as it is; none `as_function`."""
    if not _IN_PYTHON.get():
        sys.stderr.write(f"{line}\n")


def complain(line: str) -> None:
    """Print one line on standard error; `as_function` it is a warning."""
    if _IN_PYTHON.get():
        warnings.warn(line, stacklevel=2)
    say(f"socialiq: {line}")


def print_table(rows: Sequence[Mapping[str, Any]], title: str = "") -> None:
    """Print rows of equal keys as a table, with numbers to three decimals.

    Args:
        rows: At least one row.
        title: Line above the table; "" for none.
    """
    if title:
        sys.stdout.write(f"{title}\n")
    width = max(Console().width, _LEAST_WIDTH) if sys.stdout.isatty() else _PIPED_WIDTH
    Console(width=width).print(_table(rows))


def _table(rows: Sequence[Mapping[str, Any]]) -> rich.table.Table:
    table = rich.table.Table(header_style="bold", box=None, padding=(0, 2, 0, 0))
    for name in rows[0]:
        numeric = all(isinstance(row[name], int | float) for row in rows)
        table.add_column(
            str(name).replace("_", " "),
            justify="right" if numeric else "left",
            no_wrap=max(len(_cell(row[name])) for row in rows) <= 12,
            overflow="fold",
        )
    for row in rows:
        table.add_row(*(_cell(value) for value in row.values()))
    return table


def listed(values: Mapping[str, Any], heading: str = "quantity") -> list[dict[str, Any]]:
    """Return a table with a row for each value.

    Args:
        values: Values by name.
        heading: Heading of the column of names.
    """
    return [{heading: name, "value": value} for name, value in values.items()]


def _cell(value: Any) -> str:
    if isinstance(value, float):
        text = f"{value:.3f}".rstrip("0").rstrip(".")
        return "0" if text == "-0" else text
    return str(value)


class Display:
    """Progress of the stages of a command, one after another; a context manager.

    On a terminal stage, bar, rate and the time left come first, and named losses follow as far as
    there is room. Elsewhere a plain line appears every ten seconds; with `quiet` no progress is
    shown.
    """

    def __init__(self, quiet: bool = False, console: Console | None = None) -> None:
        console = console or Console(stderr=True)
        quiet = quiet or _IN_PYTHON.get()
        self._live = not quiet and console.is_terminal
        self._plain = not quiet and not self._live
        self._wide = console.width >= _WIDE
        self._stage, self._bar = (20, 16) if self._wide else (11, 5)
        stage = rich.table.Column(no_wrap=True, overflow="ellipsis", max_width=self._stage)
        fields = ("count", "rate", "left", "losses")
        self.progress = Progress(
            TextColumn("{task.description}", table_column=stage),
            BarColumn(bar_width=self._bar),
            *(TextColumn(f"{{task.fields[texts][{name}]}}", markup=False) for name in fields),
            console=console,
            disable=not self._live,
        )

    def __enter__(self) -> Display:
        self.progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.progress.stop()

    def stage(self, name: str) -> Callable[[Report], None]:
        """Begin a stage; returns the callback that its training calls after each chunk."""
        empty = {"count": "", "rate": "starting", "left": "", "losses": ""}
        task = self.progress.add_task(name, total=None, texts=empty)
        printed = [time.monotonic() - _PLAIN_SECONDS, 0]

        def show(report: Report) -> None:
            count, rate, left = _counted(report, self._wide)
            texts = {"count": count if self._wide else "", "rate": rate, "left": left}
            used = min(len(name), self._stage) + self._bar + sum(map(len, texts.values())) + 5
            texts["losses"] = fitted(_losses(report), self.progress.console.width - used)
            self.progress.update(task, total=report.total, completed=report.done, texts=texts)
            for failure in report.failures[printed[1] :]:
                self.progress.console.print(f"  {failure}", style="red", highlight=False)
            printed[1] = len(report.failures)
            due = time.monotonic() - printed[0] >= _PLAIN_SECONDS or report.done == report.total
            if self._plain and due:
                printed[0] = time.monotonic()
                texts = [*_counted(report), " ".join(_losses(report))]
                say(f"{name}: {', '.join(text for text in texts if text)}")

        return show


def fitted(words: Sequence[str], room: int) -> str:
    """Return as many of the first words, separated by blanks, as there is room for.

    Args:
        words: The words.
        room: Largest number of characters of the result.
    """
    text = ""
    for word in words:
        longer = f"{text} {word}".strip()
        if len(longer) > room:
            break
        text = longer
    return text


def _counted(report: Report, with_unit: bool = True) -> tuple[str, str, str]:
    """Return what is done, the rate and the time that is left as texts."""
    left = _remaining(report.seconds_left)
    if report.unit == PARTS:
        if report.done == report.total:
            return f"all {report.total} parts", "", ""
        return f"part {report.done + 1} of {report.total}", "", f"about {left}" if left else ""
    return f"{report.done}/{report.total}", rate_of(report, with_unit), left


def rate_of(report: Report, with_unit: bool = True) -> str:
    """Return the rate of a training as text.

    Args:
        report: Progress of the training.
        with_unit: Whether to name what is counted, as in "500 updates/s"; else only the time, as in
            "500/s".
    """
    rate = f"{report.rate:,.0f}" if report.rate >= 10 else f"{report.rate:.1f}"
    unit = report.unit if "/" in report.unit else f"{report.unit}/s"
    return f"{rate} {unit}" if with_unit else f"{rate}/{unit.rpartition('/')[2]}"


def _remaining(seconds: float) -> str:
    """Return the time that is left in words; "" if it is not known."""
    if not math.isfinite(seconds):
        return ""
    return f"{seconds:.0f} s left" if seconds < 100 else f"{seconds / 60:.0f} min left"


def _losses(report: Report) -> list[str]:
    """Return named loss terms, max |Q|, and α̂ with the least and greatest value of the runs."""
    terms = {name: value for name, value in report.terms.items() if name != "max_q"}
    texts = [f"{name} {value:.3g}" for name, value in terms.items()]
    if "max_q" in report.terms:
        texts.append(f"max|Q| {report.terms['max_q']:.3g}")
    if "greedy_angle" in report.monitored:
        angles = report.monitored["greedy_angle"]
        low = np.min(angles)
        high = np.max(angles)
        texts.append(f"α̂ {low:.1f}°" if low == high else f"α̂ {low:.1f}° to {high:.1f}°")
    return texts
