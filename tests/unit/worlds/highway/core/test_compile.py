"""Compiled kernels, and the notice that code is being compiled."""

import gc
import io
import time

import numpy as np
import pytest
from rich.console import Console

from socialiq.cli.output import Display
from socialiq.worlds.highway.core import compile as compiling
from socialiq.worlds.highway.core.geometry import longitudinal
from socialiq.worlds.intersection.core.geometry import LANES


class Slow:
    """Entry point that isn't compiled yet, and takes its time at the first call."""

    def __init__(self, seconds):
        self.signatures, self.seconds, self.calls, self.collected = [], seconds, [], []

    def __call__(self, *arguments):
        if not self.signatures:
            time.sleep(self.seconds)
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


def terminal(monkeypatch):
    """Standard error from now on; a moment is short."""
    stream = Writes()
    monkeypatch.setattr("sys.stderr", stream)
    monkeypatch.setattr(compiling, "_MOMENT", 0.05)
    return stream


def test_a_long_compilation_is_announced_once_in_whole_lines(monkeypatch):
    written = terminal(monkeypatch)
    run = Slow(0.2)
    compiling.run_in_parts(run, 1, 4, "argument")
    compiling.run_in_parts(run, 1, 4, "argument")
    assert run.calls == [("argument", 0, 0), ("argument", 0, 4), ("argument", 0, 4)]
    assert written.parts == [f"{compiling.NOTICE}\n", "compiled in 0 s\n"]


def test_code_from_the_cache_is_not_announced(monkeypatch):
    written = terminal(monkeypatch)
    compiling.run_in_parts(Slow(0.0), 1, 4)
    assert written.parts == []


def test_a_failed_compilation_leaves_whole_lines_and_collection_on(monkeypatch):
    written = terminal(monkeypatch)

    class Failing(Slow):
        def __call__(self, *arguments):
            super().__call__(*arguments)
            raise ValueError("not typed")

    with pytest.raises(ValueError, match="not typed"):
        compiling.run_in_parts(Failing(0.2), 1, 4)
    assert all(part.endswith("\n") for part in written.parts)
    assert gc.isenabled()


def test_garbage_is_not_collected_while_compiling():
    run = Slow(0.0)
    compiling.run_in_parts(run, 1, 4)
    assert run.collected == [False] and gc.isenabled()


def test_the_notice_stays_above_a_progress_bar(monkeypatch):
    written = terminal(monkeypatch)
    with Display(console=Console(file=written, force_terminal=True, width=80)) as display:
        display.stage("driving")
        compiling.run_in_parts(Slow(0.4), 1, 4)
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
