"""Calls of the command line, and the small files that several items begin with."""

from __future__ import annotations

import contextlib
import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load_file
from tests.digest.digest import Hashes, of_array, of_arrays, of_plain

EXAMPLES = Path(__file__).parents[2] / "examples"


def call(*words: object) -> int:
    """Run a command in this process, without its output.

    Raises:
        RuntimeError: If it fails.
    """
    from socialiq.cli.main import main

    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        status = main([str(word) for word in words])
    if status not in (0, 1, 3):
        raise RuntimeError(f"{' '.join(map(str, words))}: {output.getvalue()}")
    return status


def collected(folder: Path, world: str, *more: object, episodes: int = 4) -> Path:
    """Collect demonstrations of a world; return their file."""
    path = folder / f"{world}.safetensors"
    call("collect", world, "--episodes", episodes, *more, "--out", path)
    return path


def junction_file(folder: Path) -> Path:
    """Build a recorded junction from a simulated recording; return its file."""
    recording = EXAMPLES / "recordings" / "ZAM_Crossing-1_1_T-1.xml"
    call("data", "import", "commonroad", recording, "--out", folder / "imported")
    (imported,) = (folder / "imported").glob("*.safetensors")
    path = folder / "junction.safetensors"
    call("data", "world", imported, "--out", path)
    return path


def of_csv(path: Path, leave_out: tuple[str, ...] = ()) -> str:
    """Return the SHA-256 of a table, its numbers rounded, without some columns."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return of_plain(
        [
            {name: number(cell) for name, cell in row.items() if name not in leave_out}
            for row in rows
        ]
    )


def number(cell: str) -> Any:
    """Return a cell of a table as a number if it is one."""
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(cell)
    return cell


def observations(features: int, rows: int = 64) -> np.ndarray:
    """Return fixed observations in [-1, 1]."""
    return np.random.default_rng(0).uniform(-1.0, 1.0, (rows, features)).astype(np.float32)


def actions_of(path: Path, sizes: tuple[int, int], angle: float | None, states: Any) -> str:
    """Return the SHA-256 of a saved policy's greedy actions, those of an actor rounded.

    Args:
        path: Its file.
        sizes: Number of features and of actions.
        angle: Degrees, of a dial.
        states: Observations.
    """
    import socialiq

    with socialiq.load_policy(str(path), *sizes, angle=angle) as loaded:
        actions, _ = loaded.policy.predict(states, deterministic=True)
    return of_array(actions)


def networks_of(folder: Path) -> dict[str, Path]:
    """Return files of networks by kind and number, in the order of run.json if there is one."""
    record = folder / "run.json"
    if not record.is_file():
        return {path.stem: path for path in sorted(folder.glob("*.safetensors"))}
    run = json.loads(record.read_text())
    rows = {"policy": run.get("policies", ()), "dial": run.get("dials", ())}
    return {
        f"{kind}_{number}": folder / row["file"]
        for kind in rows
        for number, row in enumerate(rows[kind])
    }


def of_networks(folder: Path) -> Hashes:
    """Return a hash of the arrays of each file of networks in a folder, and of its metrics."""
    hashes = {
        f"weights/{name}": of_arrays(load_file(path)) for name, path in networks_of(folder).items()
    }
    metrics = folder / "metrics.csv"
    return hashes | ({"metrics": of_csv(metrics)} if metrics.is_file() else {})
