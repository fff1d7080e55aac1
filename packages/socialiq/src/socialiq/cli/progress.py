"""The live progress line, on standard error; plain lines where there is no terminal."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Column

from socialiq.learners.callbacks import Report

_PLAIN_SECONDS = 10.0  # between two plain lines of one stage
_WIDE = 60  # columns of a terminal that has room for counts and units


class Display:
    """Display of the stages of a command, one after another; a context manager.

    Stage, bar, rate and the time left come first. Named losses follow as far as there is room.

    Args:
        quiet: Show nothing.
        console: Terminal to write to; by default standard error.
    """

    def __init__(self, quiet: bool = False, console: Console | None = None) -> None:
        console = console or Console(stderr=True)
        self._live = not quiet and console.is_terminal
        self._plain = not quiet and not self._live
        self._wide = console.width >= _WIDE
        self._stage, self._bar = (20, 16) if self._wide else (11, 5)
        stage = Column(no_wrap=True, overflow="ellipsis", max_width=self._stage)
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
            texts = self._texts(name, report)
            self.progress.update(task, total=report.total, completed=report.done, texts=texts)
            for failure in report.failures[printed[1] :]:
                self.progress.console.print(f"  {failure}", style="red", highlight=False)
            printed[1] = len(report.failures)
            due = time.monotonic() - printed[0] >= _PLAIN_SECONDS or report.done == report.total
            if self._plain and due:
                printed[0] = time.monotonic()
                sys.stderr.write(f"{plain_line(name, report)}\n")

        return show

    def _texts(self, name: str, report: Report) -> dict[str, str]:
        """Return the texts beside the bar, no longer together than the terminal is wide."""
        texts = {
            "count": f"{report.done}/{report.total}" if self._wide else "",
            "rate": rate_of(report, self._wide),
            "left": remaining(report.seconds_left),
        }
        taken = min(len(name), self._stage) + self._bar + sum(map(len, texts.values())) + 5
        return {**texts, "losses": fitted(losses(report), self.progress.console.width - taken)}


def plain_line(name: str, report: Report) -> str:
    """Return a stage's progress as a line of a log."""
    left = remaining(report.seconds_left)
    texts = [f"{report.done}/{report.total}", rate_of(report), left, " ".join(losses(report))]
    return f"{name}: {', '.join(text for text in texts if text)}"


def fitted(parts: Sequence[str], room: int) -> str:
    """Return as many of the first parts, separated by blanks, as there is room for."""
    text = ""
    for word in parts:
        longer = f"{text} {word}".strip()
        if len(longer) > room:
            break
        text = longer
    return text


def to_all(callbacks: Sequence[Callable[[Report], None]]) -> Callable[[Report], None]:
    """Return a callback that passes each report on to several."""

    def report_to_all(report: Report) -> None:
        for callback in callbacks:
            callback(report)

    return report_to_all


def remaining(seconds: float) -> str:
    """Return the time that is left in words; "" if it is not known."""
    if not math.isfinite(seconds):
        return ""
    if seconds < 100:
        return f"{seconds:.0f} s left"
    return f"{seconds / 60:.0f} min left"


def losses(report: Report) -> list[str]:
    """Return named loss terms, max |Q|, and α̂ with the least and greatest value of the runs."""
    terms = {name: value for name, value in report.terms.items() if name != "max_q"}
    texts = [f"{name} {value:.3g}" for name, value in terms.items()]
    if "max_q" in report.terms:
        texts.append(f"max|Q| {report.terms['max_q']:.3g}")
    if "greedy_angle" in report.monitored:
        angles = report.monitored["greedy_angle"]
        low, high = np.min(angles), np.max(angles)
        texts.append(f"α̂ {low:.1f}°" if low == high else f"α̂ {low:.1f}° to {high:.1f}°")
    return texts


def rate_of(report: Report, with_unit: bool = True) -> str:
    """Return the rate, with its unit or in short."""
    rate = f"{report.rate:,.0f}" if report.rate >= 10 else f"{report.rate:.1f}"
    unit = report.unit if "/" in report.unit else f"{report.unit}/s"
    return f"{rate} {unit}" if with_unit else f"{rate}/{unit.rpartition('/')[2]}"
