"""Compiled kernels, and the notice that code is being compiled."""

import gc
import io
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console
from tests.patience import HANG, wait_until

from socialiq.cli.output import Display
from socialiq.worlds.highway.core import compile as compiling
from socialiq.worlds.highway.core.geometry import longitudinal
from socialiq.worlds.intersection.core.geometry import LANES


class Slow:
    """Entry point that isn't compiled yet, and is not before an event."""

    def __init__(self, event=lambda: True):
        self.signatures, self.event, self.calls, self.collected = [], event, [], []

    def __call__(self, *arguments):
        if not self.signatures:
            wait_until(self.event)
            self.signatures.append("compiled")
            self.collected.append(gc.isenabled())
        self.calls.append(arguments)


class Writes(io.StringIO):
    """Standard error of a terminal that keeps each write."""

    def __init__(self):
        super().__init__()
        self.parts = []

    def isatty(self):
        return True

    def write(self, text):
        self.parts.append(text)
        return super().write(text)


def terminal(monkeypatch, moment=0.05):
    """Standard error from now on; a moment is short, and 7 s pass between looks at the clock."""
    stream, clock = Writes(), itertools.count(0, 7)
    monkeypatch.setattr("sys.stderr", stream)
    monkeypatch.setattr(compiling, "_MOMENT", moment)
    monkeypatch.setattr(compiling, "time", SimpleNamespace(monotonic=clock.__next__))
    return stream


def test_a_long_compilation_is_announced_once_in_whole_lines(monkeypatch):
    written = terminal(monkeypatch)
    run = Slow(lambda: written.parts)
    compiling.run_in_parts(run, 1, 4, "argument")
    compiling.run_in_parts(run, 1, 4, "argument")
    assert run.calls == [("argument", 0, 0), ("argument", 0, 4), ("argument", 0, 4)]
    assert written.parts == [f"{compiling.NOTICE}\n", "compiled in 14 s\n"]


def test_code_from_the_cache_is_not_announced(monkeypatch):
    written = terminal(monkeypatch, HANG)
    compiling.run_in_parts(Slow(), 1, 4)
    assert written.parts == []


def test_a_failed_compilation_leaves_whole_lines_and_collection_on(monkeypatch):
    written = terminal(monkeypatch)

    class Failing(Slow):
        def __call__(self, *arguments):
            super().__call__(*arguments)
            raise ValueError("not typed")

    with pytest.raises(ValueError, match="not typed"):
        compiling.run_in_parts(Failing(lambda: written.parts), 1, 4)
    assert all(part.endswith("\n") for part in written.parts)
    assert gc.isenabled()


def test_garbage_is_not_collected_while_compiling():
    run = Slow()
    compiling.run_in_parts(run, 1, 4)
    assert run.collected == [False] and gc.isenabled()


def test_the_notice_stays_above_a_progress_bar(monkeypatch):
    written = terminal(monkeypatch)
    with Display(console=Console(file=written, force_terminal=True, width=80)) as display:
        display.stage("driving")
        compiling.run_in_parts(Slow(lambda: compiling.NOTICE in written.getvalue()), 1, 4)
    lines = [line for line in written.getvalue().split("\n") if compiling.NOTICE in line]
    assert len(lines) == 1
    assert lines[0].replace("\x1b[2K", "").replace("\r", "").endswith(compiling.NOTICE)
    assert "driving" not in lines[0].partition(compiling.NOTICE)[2]


def test_python_can_call_a_kernel_compiled_for_it():
    approach = compiling.for_python(longitudinal)
    lane = LANES[0]
    start = approach(lane, lane["x"], lane["y"])
    assert start == 0.0
    assert approach(lane, lane["x"], lane["y"] - 7.0) == pytest.approx(7.0)
    assert np.isscalar(start)
