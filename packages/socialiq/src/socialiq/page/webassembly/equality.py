"""Equality of the native core and WebAssembly over many episodes of many drivers.

`python -m socialiq.page.webassembly.equality --out FOLDER` writes the counts of both comparisons:
with this machine's elementary functions (sine, power, ...), and with the page's on both sides.
"""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from socialiq.nn.dial_policy import DialPolicy
from socialiq.page.webassembly.build import elementary_functions
from socialiq.page.webassembly.replay import CORE, Equality, compared, in_node, native
from socialiq.storage import packaged_results, write_json
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import policy as reference_policy

DIAL = "intersection-dial/dial.safetensors"


@dataclass(frozen=True)
class Config:
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


def main(config: Config) -> None:
    """Compare and write the counts, or in turn both comparisons in processes of their own."""
    config.out.mkdir(exist_ok=True)
    if config.functions != "both":
        write_json(config.out / f"{config.functions}.json", counted(config))
        return
    words = [sys.executable, "-m", __name__]
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


def counted(config: Config) -> dict[str, Any]:
    """Return the counts of each driver, and of all."""
    dial = DialPolicy.load(packaged_results() / DIAL)
    drivers: dict[str, Any] = {f"dial {angle:g}": dial.at(angle) for angle in config.angles}
    drivers |= {name: reference_policy(name) for name in config.rules}
    rows = {}
    for name, driver in drivers.items():
        chunks = [
            _of_chunk(driver, None if name == "random" else driver, first, config)
            for first in range(config.first, config.first + config.episodes, config.chunk)
        ]
        rows[name] = dataclasses.asdict(together(chunks))
    return {
        "episodes": config.episodes,
        "first": config.first,
        "drivers": rows,
        "all": dataclasses.asdict(together([Equality(**row) for row in rows.values()])),
    }


def _of_chunk(driver: Any, asked: Any, first: int, config: Config) -> Equality:
    count = min(config.chunk, config.first + config.episodes - first)
    seeds = np.arange(first, first + count)
    replay = native(Options(), seeds, driver)
    return compared(replay, in_node(Options(), seeds, replay.actions, config.core), asked)


def together(chunks: list[Equality]) -> Equality:
    """Return the sums of counts, and the largest difference of all."""
    sums: dict[str, Any] = {
        field.name: sum(getattr(chunk, field.name) for chunk in chunks)
        for field in dataclasses.fields(Equality)
    }
    largest = max(chunk.largest for chunk in chunks)
    return dataclasses.replace(Equality(**sums), largest=largest)


if __name__ == "__main__":
    main(tyro.cli(Config))
