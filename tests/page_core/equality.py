"""Equality of the native core and WebAssembly over many episodes of many drivers.

`python -m tests.page_core.equality --out FOLDER` writes the counts of both comparisons:
with this machine's elementary functions (sine, power, ...), and with the page's on both sides.
"""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro

from socialiq.errors import UserError
from socialiq.nn.dial_policy import DialPolicy
from socialiq.page.webassembly.build import elementary_functions
from socialiq.page.webassembly.layout import CORE, layout
from socialiq.storage import packaged_results, write_json
from socialiq.worlds.highway.options import EPISODE, VEHICLE
from socialiq.worlds.intersection.options import Options, buffers_of
from socialiq.worlds.intersection.policies import policy as reference_policy
from socialiq.worlds.intersection.world import Intersection

KEPT = ("episodes", "vehicles", "people", "observation", "rewards", "ending")
"""Arrays of a replay; all of them together are what an episode shows and goes on from."""

MOST = 500
"""Largest number of episodes of a replay in WebAssembly, by the memory that the file asks for."""


class Replay(NamedTuple):
    """Episodes side by side, all steps.

    Actions are int, (steps, episodes), of fleets (steps, episodes, agents); -1 after the end. The
    arrays are those of `KEPT`, with the states after the reset and after each step,
    (steps + 1, episodes, ...); observations and results have a row for each agent in turn.
    """

    actions: np.ndarray
    arrays: dict[str, np.ndarray]


def native(options: Options, seeds: np.ndarray, policy: Any) -> Replay:
    """Drive the native core by a policy from these seeds until every episode has ended."""
    batch = Intersection(options).batch(len(seeds))
    batch.reset(seeds)
    states, actions = {name: [getattr(batch.buffers, name).copy()] for name in KEPT}, []
    while batch.running.any():
        driving = (batch.driving.T & batch.running).T
        seen = batch.seen_by(policy)
        chosen = policy.predict(seen.reshape(-1, seen.shape[-1]), deterministic=True)[0]
        actions.append(np.where(driving, np.reshape(chosen, batch.shape), -1))
        batch.step(np.maximum(actions[-1], 0), auto_reset=False, rows=batch.running)
        for name in KEPT:
            states[name].append(getattr(batch.buffers, name).copy())
    return Replay(np.stack(actions), {name: np.stack(arrays) for name, arrays in states.items()})


def in_node(options: Options, seeds: np.ndarray, actions: np.ndarray, core: Path = CORE) -> Replay:
    """Take the decisions of `Replay.actions` in WebAssembly, from the same seeds.

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

    A fleet's episode counts once for each agent, and its states for those that drive.

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

    The driver is asked again on what it sees in the second one; None doesn't look, so that every
    decision is the same.
    """
    steps = len(reference.actions)
    decided = reference.actions.reshape(steps, -1) >= 0
    there = np.vstack([np.ones_like(decided[:1]), decided])  # states that an episode reached
    ours, arrays = reference.arrays, compiled.arrays
    equal_inputs = (ours["observation"] == arrays["observation"]).all(axis=(2, 3))
    apart = np.abs(ours["rewards"] - arrays["rewards"]).max(axis=2)[1:]
    ended = ours["ending"] == arrays["ending"]
    again = compiled.actions.reshape(steps, -1)
    if policy is not None:
        observations = arrays["observation"][:-1]
        inputs = observations.reshape(-1, observations.shape[2] * observations.shape[3])
        again = np.asarray(policy.predict(inputs, deterministic=True)[0]).reshape(again.shape)
    # Whether all but floats is equal, and the largest difference of floats.
    count = ours["episodes"]["vehicles"]
    absent = np.arange(ours["vehicles"].shape[2]) >= count[..., None]
    equal, gap = np.ones(count.shape, bool), np.zeros(count.shape)
    columns = [("episodes", name) for name in EPISODE.names or ()]
    columns += [("vehicles", name) for name in VEHICLE.names or ()]
    for record, name in columns:
        left, right = ours[record][name], arrays[record][name]
        if left.dtype.kind == "f":
            with np.errstate(invalid="ignore"):  # infinity less infinity: a speed without a limit
                off = np.where(left == right, 0.0, np.abs(left - right))
            off = np.where(absent, 0.0, off).max(axis=2) if record == "vehicles" else off
            np.maximum(gap, off.reshape(*gap.shape, -1).max(axis=2), out=gap)
        else:
            same = left == right
            same = (same | absent).all(axis=2) if record == "vehicles" else same
            equal &= same.reshape(*equal.shape, -1).all(axis=2)
    agents = decided.shape[1] // count.shape[1]
    equal, gap = np.repeat(equal, agents, axis=1), np.repeat(gap, agents, axis=1)
    return Equality(
        episodes=decided.shape[1],
        same_endings=int((ended | ~there).all(axis=0).sum()),
        decisions=int(decided.sum()),
        same_decisions=int((again == reference.actions.reshape(steps, -1))[decided].sum()),
        observations=int(there.sum()),
        equal_observations=int(equal_inputs[there].sum()),
        equal_rewards=int((apart == 0)[decided].sum()),
        close_rewards=int((apart <= CLOSE)[decided].sum()),
        equal_states=int((equal & (gap == 0))[there].sum()),
        close_states=int((equal & (gap <= CLOSE))[there].sum()),
        largest=float(gap[there].max()),
    )


DIAL = "intersection-dial/dial.safetensors"


@dataclass(frozen=True)
class Comparison:
    """Choice of episodes, drivers and files.

    Attributes:
        out: Folder for the result.
        episodes: Episodes of each driver; all drivers have the same.
        first: Seed of the first.
        angles: Angles of the shipped dial, degrees.
        rules: Reference drivers.
        chunk: Episodes of a call.
        functions: Name of the native side's elementary functions in the result: `machine` for its
            own; `both` runs these, then those of the page (`page`), preloaded.
        core: WebAssembly file.
    """

    out: Path
    episodes: int = 2000
    first: int = 80_000_000
    angles: tuple[float, ...] = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
    rules: tuple[str, ...] = ("idm", "gap_3s", "random")
    chunk: int = 500
    functions: str = "both"
    core: Path = CORE


def main(config: Comparison) -> None:
    """Compare and write the counts, or in turn both comparisons in processes of their own."""
    config.out.mkdir(exist_ok=True)
    if config.functions != "both":
        write_json(config.out / f"{config.functions}.json", counted(config))
        return
    words = [sys.executable, "-m", "tests.page_core.equality"]
    for name in ("episodes", "first", "chunk", "out"):
        words += [f"--{name}", str(getattr(config, name))]
    words += ["--angles", *map(str, config.angles), "--rules", *config.rules, "--functions"]
    subprocess.run([*words, "machine"], check=True)
    with tempfile.TemporaryDirectory() as folder:
        # Compiled code keeps the addresses that it was linked with, and lanes the headings that
        # were computed at import: both sides are compiled again.
        preloaded = {"LD_PRELOAD": elementary_functions(Path(folder)), "NUMBA_CACHE_DIR": folder}
        core = str(Path(folder) / "core.wasm")
        build = [sys.executable, "-m", "socialiq.page.webassembly", "--out", core]
        for call in (build, [*words, "page", "--core", core]):
            subprocess.run(call, env=os.environ | preloaded, check=True)


def counted(config: Comparison) -> dict[str, Any]:
    """Return the counts of each driver, and of all."""
    dial = DialPolicy.load(packaged_results() / DIAL)
    drivers: dict[str, Any] = {f"dial {angle:g}": dial.at(angle) for angle in config.angles}
    drivers |= {name: reference_policy(name) for name in config.rules}
    rows = {}
    for name, driver in drivers.items():
        last, chunks = config.first + config.episodes, []
        for first in range(config.first, last, config.chunk):
            seeds = np.arange(first, min(first + config.chunk, last))
            replay = native(Options(), seeds, driver)
            compiled = in_node(Options(), seeds, replay.actions, config.core)
            chunks.append(compared(replay, compiled, None if name == "random" else driver))
        rows[name] = dataclasses.asdict(together(chunks))
    return {
        "episodes": config.episodes,
        "first": config.first,
        "drivers": rows,
        "all": dataclasses.asdict(together([Equality(**row) for row in rows.values()])),
    }


def together(chunks: list[Equality]) -> Equality:
    """Return the sums of counts, and the largest difference of all."""
    sums: dict[str, Any] = {
        field.name: sum(getattr(chunk, field.name) for chunk in chunks)
        for field in dataclasses.fields(Equality)
    }
    largest = max(chunk.largest for chunk in chunks)
    return dataclasses.replace(Equality(**sums), largest=largest)


if __name__ == "__main__":
    main(tyro.cli(Comparison))
