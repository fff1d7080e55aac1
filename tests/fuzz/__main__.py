"""Fuzz the readers and the command line in turn, for some minutes: `python -m tests.fuzz`.

Every line of the log is one part of a round: its name, its seed, its numbers and its faults. The
damaged file of a fault is kept in the output folder. Exit status 1 if there is a fault.
"""

from __future__ import annotations

import argparse
import itertools
import json
import logging
import math
import random
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
from tests.fuzz.calls import Call, bad_calls, mixed_call
from tests.fuzz.readers import READERS, Reader, place_of
from tests.fuzz.run_calls import Outcome, Runner
from tests.fuzz.run_readers import Counts, property_of
from tests.fuzz.samples import make_bad_places, make_samples

FILES = 300
"""Damaged files of a reader in a round."""
MIXED = 150
"""Calls of a round with two things wrong."""


class Session:
    """One run of the fuzzer.

    Attributes:
        runner: Runs calls.
        out: Folder of the log and of what made faults.
        first: First seed.
    """

    def __init__(self, folder: Path, out: Path, first: int) -> None:
        self.runner, self.out, self.first = Runner(folder), out, first
        self.work = folder / "work"
        self.work.mkdir()
        make_samples(self.runner.ok)
        make_bad_places(self.runner.bad)
        self.runner.keep()
        self.waiting = iter(bad_calls(long=True))
        self.totals = {"files": 0, "accepted": 0, "calls": 0, "refused": 0, "faults": 0}

    def reader(self, reader: Reader, round_: int) -> None:
        """Give a reader some damaged files."""
        counts, began, number = Counts(), time.perf_counter(), self.first + round_
        fault = ""
        try:
            property_of(reader, self.runner.ok, self.work, FILES, number, counts)()
        except BaseException as error:  # whatever it is: it is the fault that is looked for
            if isinstance(error, KeyboardInterrupt | SystemExit):
                raise
            fault = "".join(traceback.format_exception(error))[-4000:]
            place = place_of(reader, self.runner.ok, self.work)
            shutil.copy(place, self.out / f"{place.parent.name}-{number}{place.suffix}")
        seconds = round(time.perf_counter() - began, 1)
        self.totals["files"] += counts.files
        self.totals["accepted"] += counts.accepted
        said = {"files": counts.files, "accepted": counts.accepted, "seconds": seconds}
        self.note({"reader": reader.name, "seed": number, **said}, [fault] if fault else [])

    def calls(self, name: str, calls: Iterator[Call], seconds: float) -> None:
        """Run calls for some time."""
        began, done, faults = time.perf_counter(), 0, []
        refused = 0
        for call in calls:
            outcome = self.runner.run(call)
            done, refused = done + 1, refused + (outcome.status == 2)
            if outcome.fault:
                faults.append(described(outcome))
            if time.perf_counter() - began > seconds:
                break
        self.totals["calls"] += done
        self.totals["refused"] += refused
        self.note({"calls": name, "done": done, "refused": refused}, faults)

    def note(self, said: dict[str, Any], faults: list[str]) -> None:
        """Write a line of the log."""
        self.totals["faults"] += len(faults)
        with (self.out / "log.jsonl").open("a") as log:
            log.write(json.dumps({**said, "faults": faults}) + "\n")

    def round(self, number: int, end: float) -> None:
        """Fuzz every reader, then the command line, unless the time is over before."""
        for reader in READERS:
            self.reader(reader, number)
            if time.monotonic() > end:
                return
        self.calls("one thing wrong", self.waiting, 120.0)
        generator = random.Random(self.first + number)
        mixed = (mixed_call(generator) for _ in range(MIXED))
        self.calls(f"two things wrong, seed {self.first + number}", mixed, 120.0)
        jax.clear_caches()

    def until(self, end: float) -> int:
        """Fuzz in rounds until a time; return the number of the last round."""
        for number in itertools.count():
            self.round(number, end)
            if time.monotonic() > end:
                break
        return number


def described(outcome: Outcome) -> str:
    """Return a fault of a call as a text."""
    words = " ".join(word[:100] for word in outcome.words)
    return f"{outcome.fault}: socialiq {words}: {outcome.error[-2000:]}"


def main() -> int:
    """Run for the given time; return the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0, help="of the first round; others follow")
    parser.add_argument("--calls", action="store_true", help="run each bad call once, no readers")
    parser.add_argument("--out", type=Path, default=Path("fuzzed"), help="folder of the log")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore")
    logging.disable()
    end = time.monotonic() + 60.0 * asked.minutes
    with tempfile.TemporaryDirectory() as folder:
        session = Session(Path(folder), asked.out, asked.seed)
        number = 0
        if asked.calls:
            session.calls("one thing wrong", iter(bad_calls()), math.inf)
        else:
            number = session.until(end)
    session.note({"rounds": number + 1, "seed": asked.seed, **session.totals}, [])
    sys.stdout.write(f"{json.dumps({'rounds': number + 1, **session.totals})}\n")
    return 1 if session.totals["faults"] else 0


if __name__ == "__main__":
    sys.exit(main())
