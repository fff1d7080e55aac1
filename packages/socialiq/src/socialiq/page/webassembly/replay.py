"""The same episodes natively and in WebAssembly, run by Node."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from socialiq.errors import UserError
from socialiq.page.webassembly.layout import layout
from socialiq.types import Ending
from socialiq.worlds.highway.state import Buffers
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.state import buffers_of

CORE = Path(__file__).with_name("core.wasm")
"""The built core that ships with the package."""

KEPT = ("episodes", "vehicles", "observation", "rewards", "ending")
"""Arrays of a replay; all of them together are what an episode shows and goes on from."""

MOST = 500
"""Largest number of episodes of a replay in WebAssembly, by the memory that the file asks for."""


class Replay(NamedTuple):
    """Episodes side by side, all steps.

    Attributes:
        actions: Decisions, int, (steps, episodes); -1 after an episode's end.
        arrays: Each of `KEPT`, with the states after the reset and after each step,
            (steps + 1, episodes, ...).
    """

    actions: np.ndarray
    arrays: dict[str, np.ndarray]


def native(options: Options, seeds: np.ndarray, policy: Any) -> Replay:
    """Drive the native core from these seeds until every episode has ended.

    Args:
        options: Scenario.
        seeds: One for each episode.
        policy: Driver, with `predict`.
    """
    batch = Batch(options, len(seeds))
    batch.reset(seeds)
    alive = np.ones(len(seeds), bool)
    states, actions = [_copied(batch.buffers)], []
    while alive.any():
        chosen = np.asarray(policy.predict(batch.seen_by(policy), deterministic=True)[0])
        batch.step(chosen, auto_reset=False, rows=alive)
        actions.append(np.where(alive, chosen, -1))
        alive = alive & (batch.buffers.ending == int(Ending.NONE))
        states.append(_copied(batch.buffers))
    return Replay(
        np.stack(actions), {name: np.stack([state[name] for state in states]) for name in KEPT}
    )


def _copied(buffers: Buffers) -> dict[str, np.ndarray]:
    return {name: getattr(buffers, name).copy() for name in KEPT}


def in_node(options: Options, seeds: np.ndarray, actions: np.ndarray, core: Path = CORE) -> Replay:
    """Take the same decisions in WebAssembly.

    Args:
        options: Scenario.
        seeds: One for each episode.
        actions: Decisions, (steps, episodes); -1 after an episode's end.
        core: WebAssembly file.

    Raises:
        UserError: If Node isn't installed, the program fails, or there are too many episodes.
    """
    if len(seeds) > MOST:
        raise UserError(f"{len(seeds)} episodes are too many for the core's memory: at most {MOST}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "layout.json").write_text(json.dumps(layout(options)))
        job = {"seeds": seeds.tolist(), "decisions": actions.tolist(), "kept": KEPT}
        (folder / "job.json").write_text(json.dumps(job))
        files = [core, folder / "layout.json", folder / "job.json", folder / "out.bin"]
        run_node("replay.mjs", *map(str, files))
        rows = buffers_of(options, len(seeds))
        kind = np.dtype(
            [(name, getattr(rows, name).dtype, getattr(rows, name).shape) for name in KEPT]
        )
        records = np.fromfile(folder / "out.bin", kind)
    return Replay(actions, {name: records[name] for name in KEPT})


def run_node(script: str, *words: str) -> str:
    """Run a script of this folder in Node and return what it prints.

    Raises:
        UserError: If Node isn't installed, or the script fails.
    """
    node = shutil.which("node")
    if node is None:
        raise UserError("Node.js isn't installed: install it, for example the package nodejs")
    call = [node, str(Path(__file__).with_name(script)), *words]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    if done.returncode:
        raise UserError(f"Node.js failed: {done.stderr.strip()[-300:]}")
    return done.stdout
