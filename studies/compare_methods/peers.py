"""Methods of other libraries, run as they are in environments of their own.

Their pins exclude ours, so that nothing is imported: a script of `benchmarks/peers` reads the world
and the demonstrations from an npz file, trains with its library, and writes tables of action
probabilities. The environment is a job, made once with `venv` and pip.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.evaluation.exact import Ground
from socialiq.social.angle import exact_weights
from socialiq_lab.comparison import Method
from socialiq_lab.comparison_runs import Arena, Run
from socialiq_lab.jobs import Job, ProgressCallback

PYTHON = Path("venv", "Scripts" if sys.platform == "win32" else "bin", "python")
"""Interpreter of an environment, in its job's folder."""

TAKEN, REQUESTS, MADE = "world.npz", "requests.json", "policies.npz"
"""Files that a script reads, and the one that it writes."""


@dataclass(frozen=True)
class Environment:
    """Environment of a library, by the pins that pip is given."""

    pins: str


def scripts() -> Path:
    """Return the folder of the peers' scripts and pins.

    Raises:
        UserError: In an installed package, which has no benchmarks.
    """
    folder = Path(__file__).parents[2] / "benchmarks" / "peers"
    if not folder.is_dir():
        raise UserError(
            "the peers' scripts come with the sources, not the package: "
            "run in a checkout, or name --methods without them"
        )
    return folder


def environment_job(library: str) -> Job:
    """Return the job that makes the environment of a library."""
    environment = Environment((scripts() / f"{library}.txt").read_text())
    return Job(f"environments/{library}", make_environment, environment, cost=200.0)


def make_environment(
    config: Environment, folder: Path, _inputs: Any, on_progress: ProgressCallback
) -> None:
    """Make a virtual environment, and install the pins with pip."""
    pins = folder / "pins.txt"
    pins.write_text(config.pins)
    _call([sys.executable, "-m", "venv", str(folder / "venv")], folder)
    on_progress(0.1)
    _call([str(folder / PYTHON), "-m", "pip", "install", "--quiet", "-r", str(pins)], folder)
    on_progress(1.0)


def train_tabular(
    arena: Arena,
    ground: Ground,
    method: Method,
    runs: Sequence[Run],
    served: Mapping[float, Sequence[float]],
    environment: Path,
    folder: Path,
) -> list[dict[float, np.ndarray]]:
    """Train every run with a script; return its action probabilities by angle."""
    if method.of_mode:
        arena, runs = arena.of_each_mode(runs)
    exchanged = world_arrays(ground)
    for number, data in enumerate(arena.datasets):
        for name in ("observation", "action", "next_observation", "ending"):
            exchanged[f"{name}_{number}"] = getattr(data, name)
        exchanged[f"starts_{number}"] = data.episode_starts
    np.savez(folder / TAKEN, allow_pickle=False, **exchanged)
    requests = [request(arena, method, run, served[run.angle]) for run in runs]
    (folder / REQUESTS).write_text(json.dumps(requests))
    script = scripts() / f"{method.peer}_peer.py"
    _call([str(environment / PYTHON), str(script), str(folder)], folder)
    with np.load(folder / MADE) as arrays:
        arena.rates.append(float(arrays["updates_per_second"]))
        policies = [
            {
                angle: checked(arrays[f"policy_{number}_{index}"], ground)
                for index, angle in enumerate(served[run.angle])
            }
            for number, run in enumerate(runs)
        ]
    for file in (TAKEN, REQUESTS, MADE):
        (folder / file).unlink()
    return policies


def request(arena: Arena, method: Method, run: Run, angles: Sequence[float]) -> dict[str, Any]:
    """Return what a script needs to know of a run that serves these angles, JSON-able."""
    return {
        "learner": method.learner,
        "dataset": run.dataset,
        "seed": run.seed,
        "updates": arena.updates,
        "hidden": list(arena.structure.hidden),
        "batch_size": arena.structure.batch_size,
        "discount": arena.numbers.discount,
        "polyak": arena.numbers.polyak,
        "weights": [list(exact_weights(angle)) for angle in angles],
    } | dict(run.setting)


def world_arrays(ground: Ground) -> dict[str, np.ndarray]:
    """Return a gridworld's reachable part as named arrays; a peer needs nothing else of us."""
    mdp, world = ground.part.mdp, ground.part.world
    states = np.arange(mdp.n_states)
    return {
        "successor": mdp.successor,
        "probability": mdp.probability,
        "ending": mdp.ending,
        "r_env": mdp.rewards.env,
        "r_social": mdp.rewards.social,
        "initial": mdp.initial,
        "observation": np.asarray(ground.part.observe(states, np.zeros_like(states)), np.float32),
        "horizon": np.array(world.horizon),
    }


def checked(table: np.ndarray, ground: Ground) -> np.ndarray:
    """Return a peer's table as distributions, float64.

    Raises:
        UserError: If it is no table of action probabilities of the world.
    """
    shape = (ground.part.mdp.n_states, ground.part.mdp.n_actions)
    chances = np.asarray(table, np.float64)
    if chances.shape != shape or not np.isfinite(chances).all() or chances.min() < 0.0:
        raise UserError(
            f"a peer's policy has shape {chances.shape}: it must be {shape}, none below 0"
        )
    return chances / chances.sum(axis=1, keepdims=True)


def _call(command: Sequence[str], folder: Path) -> None:
    """Run a command; raise an error with the end of its output if it fails."""
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)
    if done.returncode:
        end = (done.stderr or done.stdout).strip().splitlines()[-1:] or ["no output"]
        raise UserError(f"{Path(command[0]).name} {' '.join(command[1:3])} failed: {end[0]}")
