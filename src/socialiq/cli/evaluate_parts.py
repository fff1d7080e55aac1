"""Episodes of `evaluate` at the intersection in parts, by seed, as jobs of the engine."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.cli.drivers import driver_of
from socialiq.errors import UserError
from socialiq.evaluation.play import Episodes, SoftPolicy, episodes_of
from socialiq.experiments.engine import Engine, available_cores, run_jobs
from socialiq.experiments.jobs import Job, ProgressCallback
from socialiq.experiments.study import StageCallback
from socialiq.storage import load_arrays, save_arrays
from socialiq.types import RewardPair
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options

SIDE_BY_SIDE = 512
_KIND, _VERSION, _FILE = "episodes", 1, "episodes.safetensors"
_PAIRS = ("totals", "classical")
_PART = 1000  # episodes of a part on a cluster, where the number of processes may change


@dataclass(frozen=True)
class PartConfig:
    """Episodes of one driver, each with its seed from `first` to before `last`.

    Attributes:
        driver: As `driver_of` takes it; files by their absolute path.
        sha256: Of the driver's file, else "".
        soft: Whether it draws its actions.
        side_by_side: Episodes at once, the same for every part.
        first: First seed.
        last: Seed after the last.
    """

    driver: str
    sha256: str
    soft: bool
    side_by_side: int
    first: int
    last: int


def episodes_in_parts(
    name: str,
    seeds: range,
    soft: bool,
    engine: Engine,
    work: Path,
    on_stage: StageCallback,
    parts: int = 0,
) -> Episodes:
    """Play episodes in parts; the result is that of `episodes_of` on all seeds.

    Args:
        name: Of the driver.
        seeds: Of the episodes.
        soft: Whether the driver draws its actions.
        engine: Where the parts are played.
        work: Folder of their folders.
        on_stage: Given the name of a stage, returns the callback for its progress.
        parts: How many; by default one for each process, or for each 1,000 episodes on a cluster.

    Raises:
        UserError: If the driver draws its actions in the order of all episodes.
    """
    driver = driver_of(name)
    if name == "random" or (soft and not isinstance(driver, SoftPolicy)):
        raise UserError(f"{name} draws its actions in order: leave out --processes and --cluster")
    count = parts or _parts(engine, len(seeds))
    path = Path(name).absolute()
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
    jobs = [
        Job(
            f"{path.stem}{sha256[:8]}/{number:04d}-of-{count:04d}",
            play_part,
            PartConfig(
                driver=str(path) if sha256 else name,
                sha256=sha256,
                soft=soft,
                side_by_side=min(SIDE_BY_SIDE, len(seeds)),
                first=int(block[0]),
                last=int(block[-1]) + 1,
            ),
            cost=float(len(block)),
        )
        for number, block in enumerate(np.array_split(np.array(seeds), count))
    ]
    run_jobs(jobs, work, on_stage, engine.processes, engine.cluster)
    return _joined([_read(work / job.name) for job in jobs])


def _parts(engine: Engine, episodes: int) -> int:
    if engine.cluster is None:
        return min(engine.processes or available_cores(), episodes)
    return math.ceil(episodes / _PART)


def play_part(
    config: PartConfig, folder: Path, _: Mapping[str, Path], __: ProgressCallback
) -> None:
    """Play the episodes of a part, and write what became of each."""
    batch = Batch(Options(), config.side_by_side)
    seeds = np.arange(config.first, config.last)
    made = episodes_of(batch, driver_of(config.driver), seeds, deterministic=not config.soft)
    arrays = {name: value for name, value in made._asdict().items() if name not in _PAIRS}
    names = list(arrays.pop("signal_names"))
    arrays |= {name: np.stack(getattr(made, name), axis=1) for name in _PAIRS}
    save_arrays(folder / _FILE, _KIND, _VERSION, arrays, {"signal_names": names})


def _read(folder: Path) -> Episodes:
    arrays, header = load_arrays(folder / _FILE, _KIND, _VERSION)
    pairs: dict[str, Any] = {name: RewardPair(*arrays.pop(name).T) for name in _PAIRS}
    columns: dict[str, Any] = {**arrays, "signal_names": tuple(header["signal_names"])}
    return Episodes(**pairs, **columns)


def _joined(parts: Sequence[Episodes]) -> Episodes:
    """Join the columns of the parts, in the order of the seeds."""
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(one, name) for one in parts])
        for name in Episodes._fields
        if name not in (*_PAIRS, "signal_names")
    }
    pairs: dict[str, Any] = {
        name: RewardPair(
            np.concatenate([getattr(one, name).env for one in parts]),
            np.concatenate([getattr(one, name).social for one in parts]),
        )
        for name in _PAIRS
    }
    return Episodes(**pairs, **columns, signal_names=parts[0].signal_names)
