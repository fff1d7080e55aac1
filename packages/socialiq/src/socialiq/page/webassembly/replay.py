"""The same episodes natively and in WebAssembly, run by Node, and how far they are equal."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from socialiq.errors import UserError
from socialiq.page.webassembly.layout import layout
from socialiq.types import Ending
from socialiq.worlds.highway.state import EPISODE, Buffers
from socialiq.worlds.intersection.options import VEHICLE, Options, buffers_of
from socialiq.worlds.intersection.world import Batch

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


CLOSE = 1e-9
"""Largest difference of a state that counts as close: m, rad, m/s, m/s²."""


@dataclass(frozen=True)
class Equality:
    """Counts of a comparison; a pair of equal things is counted, and all pairs.

    Attributes:
        episodes: Number of episodes.
        same_endings: Episodes with the same ending after the same number of decisions.
        decisions: Number of decisions.
        same_decisions: Decisions that the driver takes too from what it sees in the other replay.
        observations: Number of observations, those of the resets included.
        equal_observations: Those equal to the last bit (float32).
        equal_rewards: Reward pairs equal to the last bit.
        close_rewards: Reward pairs that differ by at most `CLOSE`.
        equal_states: States, the random stream's included, equal to the last bit.
        close_states: States whose numbers differ by at most `CLOSE` and that are equal otherwise.
        largest: Largest difference of any number of a state.
    """

    episodes: int
    same_endings: int
    decisions: int
    same_decisions: int
    observations: int
    equal_observations: int
    equal_rewards: int
    close_rewards: int
    equal_states: int
    close_states: int
    largest: float


def compared(reference: Replay, compiled: Replay, policy: Any = None) -> Equality:
    """Count what is equal in two replays with the same decisions.

    Args:
        reference: First replay.
        compiled: Second replay.
        policy: Driver that is asked again on what it sees in the second replay; None if it
            doesn't look, so that every decision is the same.
    """
    decided = reference.actions >= 0
    there = np.vstack([np.ones_like(decided[:1]), decided])  # states that an episode reached
    ours, arrays = reference.arrays, compiled.arrays
    equal_inputs = (ours["observation"] == arrays["observation"]).all(axis=(2, 3))
    apart = np.abs(ours["rewards"] - arrays["rewards"]).max(axis=2)[1:]
    ended = ours["ending"] == arrays["ending"]
    equal, gap = _states(ours, arrays)
    return Equality(
        episodes=decided.shape[1],
        same_endings=int((ended | ~there).all(axis=0).sum()),
        decisions=int(decided.sum()),
        same_decisions=int((_again(compiled, policy) == reference.actions)[decided].sum()),
        observations=int(there.sum()),
        equal_observations=int(equal_inputs[there].sum()),
        equal_rewards=int((apart == 0)[decided].sum()),
        close_rewards=int((apart <= CLOSE)[decided].sum()),
        equal_states=int((equal & (gap == 0))[there].sum()),
        close_states=int((equal & (gap <= CLOSE))[there].sum()),
        largest=float(gap[there].max()),
    )


def _again(replay: Replay, policy: Any) -> np.ndarray:
    """Return the decisions that a driver takes on the observations of a replay."""
    if policy is None:
        return replay.actions
    observations = replay.arrays["observation"][:-1]
    inputs = observations.reshape(-1, observations.shape[2] * observations.shape[3])
    return np.asarray(policy.predict(inputs, deterministic=True)[0]).reshape(replay.actions.shape)


def _states(
    ours: dict[str, np.ndarray], arrays: dict[str, np.ndarray]
) -> tuple[Bool[np.ndarray, "step episode"], Float[np.ndarray, "step episode"]]:
    """Return whether all but floats is equal, and the largest difference of floats."""
    count = ours["episodes"]["vehicles"]
    absent = np.arange(ours["vehicles"].shape[2]) >= count[..., None]
    equal, gap = np.ones(count.shape, bool), np.zeros(count.shape)
    for name in EPISODE.names or ():
        _note(ours["episodes"][name], arrays["episodes"][name], None, equal, gap)
    for name in VEHICLE.names or ():
        _note(ours["vehicles"][name], arrays["vehicles"][name], absent, equal, gap)
    return equal, gap


def _note(left: Any, right: Any, absent: Any, equal: np.ndarray, gap: np.ndarray) -> None:
    if left.dtype.kind != "f":
        same = left == right
        equal &= same if absent is None else (same | absent).all(axis=2)
        return
    with np.errstate(invalid="ignore"):  # infinity less infinity: a speed without a limit
        apart = np.where(left == right, 0.0, np.abs(left - right))
    np.maximum(gap, apart if absent is None else np.where(absent, 0.0, apart).max(axis=2), out=gap)
