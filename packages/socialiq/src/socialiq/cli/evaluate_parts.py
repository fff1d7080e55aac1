"""Episodes of `evaluate` in parts, by seed, as jobs of the engine."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from socialiq.cli.drivers import driver_of
from socialiq.demonstrations import files
from socialiq.demonstrations.mixture import concatenate
from socialiq.errors import UserError
from socialiq.evaluation.episodes import Episodes, episodes_of
from socialiq.evaluation.rollout import Rollout, rollout_env
from socialiq.evaluation.simulate import SoftPolicy
from socialiq.policies.interface import Loaded
from socialiq.policies.load import load_policy
from socialiq.storage import load_arrays, save_arrays
from socialiq.types import RewardPair
from socialiq.worlds import CONTINUOUS_IDS, IDS, SCENE_IDS
from socialiq.worlds.environment import action_size, make_environment, sizes
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq_lab.engine import Engine, run_jobs
from socialiq_lab.jobs import Job, ProgressCallback
from socialiq_lab.study import StageCallback

SIDE_BY_SIDE = 512
ROADS = (IDS["intersection"], *CONTINUOUS_IDS.values())
"""Ids of the intersection, whose environments show the time where a policy takes it."""
_KIND, _VERSION, _FILE = "episodes", 1, "episodes.safetensors"
_PAIRS = ("totals", "classical")


@dataclass(frozen=True)
class PartConfig:
    """Episodes of one driver, each with its seed from `first` to before `last`.

    Attributes:
        world: "intersection", or an environment as `make_environment` takes it.
        world_sha256: Of the environment's file, else "".
        driver: As `driver_of` or `load_policy` takes it; files by their absolute path.
        sha256: Of the driver, else "".
        soft: Whether it draws its actions.
        angle: Of a dial in an environment.
        allow_code: Whether modules may be imported.
        side_by_side: Episodes at once, the same for every part.
        first: First seed.
        last: Seed after the last.
    """

    world: str
    world_sha256: str
    driver: str
    sha256: str
    soft: bool
    angle: float
    allow_code: bool
    side_by_side: int
    first: int
    last: int


@dataclass(frozen=True)
class Parts:
    """Jobs that play a part of the episodes each.

    Attributes:
        engine: Where the parts are played.
        work: Folder of their folders.
        on_stage: Given the name of a stage, returns the callback for its progress.
        count: How many; by default one for each process, or for each 1,000 episodes on a cluster.
    """

    engine: Engine
    work: Path
    on_stage: StageCallback
    count: int = 0

    def episodes(self, name: str, seeds: range, soft: bool) -> Episodes:
        """Play episodes of the intersection; the result is that of `episodes_of` on all seeds.

        Raises:
            UserError: If the driver draws its actions in the order of all episodes.
        """
        driver = driver_of(name)
        if name == "random" or (soft and not isinstance(driver, SoftPolicy)):
            raise _draws_in_order(name)
        path = Path(name).absolute()
        sha256 = _sha256(path)
        whole = PartConfig(
            world="intersection",
            world_sha256="",
            driver=str(path) if sha256 else name,
            sha256=sha256,
            soft=soft,
            angle=0.0,
            allow_code=False,
            side_by_side=min(SIDE_BY_SIDE, len(seeds)),
            first=seeds.start,
            last=seeds.stop,
        )
        return _joined([_read(folder) for folder in self._play(whole)])

    def rollout(
        self, world: str, name: str, seeds: range, soft: bool, angle: float, allow_code: bool
    ) -> Rollout:
        """Play episodes in an environment; the result is that of `rollout_env` on all seeds.

        The environment and the policy must keep nothing from one episode to the next, as
        Gymnasium's `reset(seed=...)` promises.

        Raises:
            UserError: If the policy draws its actions in the order of all episodes.
        """
        if soft:
            raise _draws_in_order(name)
        path = Path(name).absolute()
        driver = str(path) if path.is_file() else name
        with driven_in(world, driver, angle, allow_code) as (_, loaded):
            sha256 = loaded.record.sha256
        whole = PartConfig(
            world=world,
            world_sha256=_sha256(Path(world.rpartition(":")[0])),
            driver=driver,
            sha256=sha256,
            soft=False,
            angle=angle,
            allow_code=allow_code,
            side_by_side=1,
            first=seeds.start,
            last=seeds.stop,
        )
        tables, speeds = [], []
        for folder in self._play(whole):
            tables.append(files.load(folder / "transitions.safetensors", continuous=True))
            speeds.append(load_arrays(folder / _FILE, _KIND, _VERSION)[0]["speed"])
        joined = concatenate(tables)
        joined = dataclasses.replace(joined, source=tables[0].source)
        return Rollout(joined, np.concatenate(speeds))

    def _play(self, whole: PartConfig) -> list[Path]:
        """Play the parts; return their folders in the order of the seeds."""
        seeds = np.arange(whole.first, whole.last)
        count = self.count or self.engine.parts(len(seeds))
        name = f"{Path(whole.driver).stem.rpartition(':')[2]}{whole.sha256[:8]}"
        jobs = [
            Job(
                f"{name}/{number:04d}-of-{count:04d}",
                play_part,
                dataclasses.replace(whole, first=int(block[0]), last=int(block[-1]) + 1),
                cost=float(len(block)),
            )
            for number, block in enumerate(np.array_split(seeds, count))
        ]
        run_jobs(jobs, self.work, self.on_stage, self.engine.processes, self.engine.cluster)
        return [self.work / job.name for job in jobs]


@contextmanager
def driven_in(
    world: str, driver: str, angle: float, allow_code: bool
) -> Iterator[tuple[gymnasium.Env[Any, Any], Loaded]]:
    """Yield an environment and the policy that drives in it.

    On a road of highway-env a file of this package may take the time as a further feature, which
    the environment then shows, the intersection with continuous actions too.

    Args:
        world: Name, as of `make_environment`.
        driver: The policy, as of `load_policy`.
        angle: Of a dial, in degrees.
        allow_code: Whether a module that is named may be imported.

    Raises:
        UserError: If one can't be made, or they don't fit together.
    """
    env = make_environment(world, allow_code=allow_code, continuous=True)
    shows_time = world in (*SCENE_IDS, *SCENE_IDS.values(), *ROADS)
    more: dict[str, Any] = {"angle": angle, "allow_code": allow_code, "clock": shows_time}
    with load_policy(driver, *sizes(env), action_size=action_size(env), **more) as loaded:
        if loaded.record.interface.n_features > sizes(env)[0]:
            env = make_environment(world, {"clock": True}, continuous=True)
        yield env, loaded


def _draws_in_order(name: str) -> UserError:
    return UserError(f"{name} draws its actions in order: leave out --processes and --cluster")


def _sha256(path: Path) -> str:
    """Return the SHA-256 of a file; "" if there is none."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def play_part(
    config: PartConfig, folder: Path, _: Mapping[str, Path], __: ProgressCallback
) -> None:
    """Play the episodes of a part, and write the result of each."""
    if config.world != "intersection":
        _play_in_environment(config, folder)
        return
    batch = Batch(Options(), config.side_by_side)
    seeds = np.arange(config.first, config.last)
    made = episodes_of(batch, driver_of(config.driver), seeds, deterministic=not config.soft)
    arrays = {name: value for name, value in made._asdict().items() if name not in _PAIRS}
    names = list(arrays.pop("signal_names"))
    arrays |= {name: np.stack(getattr(made, name), axis=1) for name in _PAIRS}
    save_arrays(folder / _FILE, _KIND, _VERSION, arrays, {"signal_names": names})


def _play_in_environment(config: PartConfig, folder: Path) -> None:
    with driven_in(config.world, config.driver, config.angle, config.allow_code) as (env, loaded):
        if loaded.record.sha256 != config.sha256:
            raise UserError(f"{config.driver} has changed: give the command again")
        made = rollout_env(env, loaded.policy, config.last - config.first, config.first)
    files.save(folder / "transitions.safetensors", made.transitions)
    save_arrays(folder / _FILE, _KIND, _VERSION, {"speed": made.speed}, {})


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
