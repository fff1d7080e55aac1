"""Decisions per second of the intersection's core as WebAssembly, in Node, beside the native one.

Both take random actions in 64 episodes on one thread, resets included. Seconds are of the
processor, so that other work on the machine doesn't count; medians are given.
"""

from __future__ import annotations

import json
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.page.webassembly.layout import layout
from socialiq.page.webassembly.replay import CORE, run_node
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options

ROWS = 64
DECISIONS = 30_000


def run(repeats: int) -> dict[str, Any]:
    """Measure each side in turn, `repeats` times.

    Returns:
        Medians by name: decisions per second, their ratio, bytes of the file.

    Raises:
        UserError: If Node isn't installed.
    """
    options = Options()
    native, node = [], []
    batch = Batch(options, ROWS)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "layout.json"
        path.write_text(json.dumps(layout(options)))
        words = [str(CORE), str(path), str(ROWS), str(DECISIONS)]
        for _ in range(repeats):
            native.append(native_rate(batch))
            node.append(float(run_node("rate.mjs", *words)))
    return {
        "native_decisions_per_s": statistics.median(native),
        "node_decisions_per_s": statistics.median(node),
        "ratio": float(np.median(np.divide(node, native))),
        "bytes": CORE.stat().st_size,
    }


def native_rate(batch: Batch) -> float:
    """Decisions per second of the processor, of a batch under random actions, resets included."""
    rounds = -(-DECISIONS // batch.size)
    actions = np.random.default_rng(0).integers(3, size=(rounds, batch.size))
    batch.reset(0)
    begin = time.process_time()
    for row in actions:
        batch.step(row)
    return rounds * batch.size / (time.process_time() - begin)
