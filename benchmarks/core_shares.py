"""Shares of the time of the intersection's core, and the gain that SIMD lanes have at most.

    python benchmarks/core_shares.py

Random actions drive 64 intersections on one core under Linux' `perf` (Debian: linux-perf). The
functions of the C library (sine, power, arc tangent, ...) fix the last bit and take one number at
a time, so lanes can speed up the rest alone.
"""

import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from socialiq.worlds.intersection.world import Intersection

EPISODES, DECISIONS, LANES = 64, 6_000, 4  # float64 in a register of 256 bits
LIBRARY = ("libm", "_helperlib")  # with Numba's own remainder
COMPILED = ("[JIT]", "libc.so")


def drive() -> None:
    """Drive, and print the decisions per second of processor time."""
    batch = Intersection().batch(EPISODES)
    batch.reset(np.arange(EPISODES))
    actions = np.random.default_rng(0).integers(0, 3, (DECISIONS, EPISODES))
    batch.step(actions[0])
    begun = time.process_time()
    for row in actions:
        batch.step(row)
    print(EPISODES * DECISIONS / (time.process_time() - begun))


def main() -> None:
    """Print the shares of the core's time, and the largest gain of so many lanes."""
    with tempfile.TemporaryDirectory() as folder:
        data = str(Path(folder) / "perf.data")
        record = ["perf", "record", "-o", data, "-e", "cpu-clock", "-F", "1000"]
        words = [*record, sys.executable, "-W", "ignore", __file__, "drive"]
        rate = float(subprocess.run(words, capture_output=True, text=True, check=True).stdout)
        report = ["perf", "report", "-i", data, "--stdio", "--sort", "dso"]
        text = subprocess.run(report, capture_output=True, text=True, check=True).stdout
    shares = {name: float(share) for share, name in re.findall(r"^ +([\d.]+)% +(\S+)", text, re.M)}
    library, compiled = (
        sum(share for name, share in shares.items() if name.startswith(names))
        for names in (LIBRARY, COMPILED)
    )
    core = library + compiled
    print(f"decisions/s {rate:,.0f}; in the core {core:.0f} % of the time")
    print(f"functions of the C library: {library / core:.0%} of the core's time")
    print(f"{LANES} lanes gain at most {core / (library + compiled / LANES):.2f} times")


if __name__ == "__main__":
    drive() if sys.argv[1:] == ["drive"] else main()
