"""The live progress line, on standard error; plain lines where there is no terminal."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from socialiq.learners.callbacks import Report

_PLAIN_SECONDS = 10.0  # between two plain lines of one stage


class Display:
    """Shows the stages of a command, one after another; a context manager.

    Args:
        quiet: Show nothing.
    """

    def __init__(self, quiet: bool = False) -> None:
        console = Console(stderr=True)
        self._live = not quiet and console.is_terminal
        self._plain = not quiet and not self._live
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TextColumn("{task.completed}/{task.total}"),
            TextColumn("{task.fields[detail]}"),
            TextColumn("{task.fields[left]}"),
            console=console,
            disable=not self._live,
        )

    def __enter__(self) -> Display:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def stage(self, name: str) -> Callable[[Report], None]:
        """Begin a stage; returns what its training calls after each chunk."""
        task = self._progress.add_task(name, total=None, detail="compiling", left="")
        printed = [time.monotonic() - _PLAIN_SECONDS, 0]

        def show(report: Report) -> None:
            self._progress.update(
                task,
                total=report.total,
                completed=report.done,
                detail=describe(report),
                left=remaining(report.seconds_left),
            )
            for failure in report.failures[printed[1] :]:
                self._progress.console.print(f"  {failure}", style="red", highlight=False)
            printed[1] = len(report.failures)
            due = time.monotonic() - printed[0] >= _PLAIN_SECONDS or report.done == report.total
            if self._plain and due:
                printed[0] = time.monotonic()
                sys.stderr.write(
                    f"{name}: {report.done}/{report.total}, {describe(report)}, "
                    f"{remaining(report.seconds_left)}\n"
                )

        return show


def to_all(told: Sequence[Callable[[Report], None]]) -> Callable[[Report], None]:
    """One hook that passes each report on to several."""

    def tell(report: Report) -> None:
        for one in told:
            one(report)

    return tell


def remaining(seconds: float) -> str:
    """The time that is left, as people say it."""
    if not math.isfinite(seconds):
        return ""
    if seconds < 100:
        return f"{seconds:.0f} s left"
    return f"{seconds / 60:.0f} min left"


def describe(report: Report) -> str:
    """Named loss terms, max |Q|, α̂ (least and greatest of the lanes), the rate."""
    shown = {name: value for name, value in report.terms.items() if name != "max_q"}
    parts = [f"{name} {value:.3g}" for name, value in shown.items()]
    if "max_q" in report.terms:
        parts.append(f"max|Q| {report.terms['max_q']:.3g}")
    if "greedy_angle" in report.monitored:
        angles = report.monitored["greedy_angle"]
        low, high = np.min(angles), np.max(angles)
        parts.append(f"α̂ {low:.1f}°" if low == high else f"α̂ {low:.1f}° to {high:.1f}°")
    rate = f"{report.rate:,.0f}" if report.rate >= 10 else f"{report.rate:.1f}"
    unit = report.unit if "/" in report.unit else f"{report.unit}/s"
    return " ".join([*parts, f"{rate} {unit}"])
