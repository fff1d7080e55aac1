"""Jobs of the intersection study; each fills a folder (`experiments.jobs`).

The functions are called in processes of their own, so all they depend on stands in their
configuration, which also makes their fingerprint.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from socialiq.demonstrations import files
from socialiq.demonstrations.mixture import MIXTURES
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.evaluation.oracle_lookahead import with_oracle_lookahead
from socialiq.evaluation.play import episodes_of
from socialiq.experiments.intersection.episodes import save_episodes
from socialiq.experiments.intersection.monitor import Checks, Monitor, write_curve
from socialiq.experiments.jobs import ProgressCallback
from socialiq.experiments.results import as_csv
from socialiq.learners.callbacks import Callbacks, Report
from socialiq.learners.collect import Collector, Source, from_vector_env, soft
from socialiq.learners.dqn import config as dqn
from socialiq.learners.dqn.train import policy_of
from socialiq.learners.dqn.train import train as train_dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.learners.state import History
from socialiq.nn.q_policy import QPolicy
from socialiq.storage import write_atomically
from socialiq.types import Policy, Row
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.gym import IntersectionVectorEnv
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection

BEST, LAST = "best.safetensors", "last.safetensors"
CHECKPOINT = "checkpoint.safetensors"
CHUNK = 200  # updates between two rounds of acting
BATCH = 512  # episodes side by side in evaluation
EPISODES, HIGHWAY_EPISODES = 2000, 200
"""Evaluation episodes of a policy, on the core and on the real highway-env."""
FIRST_EPISODE, FIRST_HIGHWAY_EPISODE = 20_000_000, 30_000_000
"""Seeds of the first of them, the same for all policies."""


@dataclass(frozen=True)
class ExpertRun:
    """One DQN expert (thesis 5.2)."""

    structure: dqn.StaticConfig
    numbers: dqn.Hyperparameters
    environments: int = 12
    options: Options = field(default_factory=Options)
    checks: Checks = field(default_factory=Checks)


def train_expert(
    config: ExpertRun, folder: Path, _inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Train; writes the last network, the best by checks, and the learning curve."""
    structure, world = config.structure, Intersection(config.options)
    monitor = Monitor(
        config.checks,
        config.options,
        config.numbers.angle,
        CHUNK,
        math.ceil(structure.updates / CHUNK),
        lambda state: int(state.optimiser.count[0]),
        partial(policy_of, structure, config.numbers),
        folder / BEST,
    )
    source = source_of(config.options, config.environments, CHUNK * structure.steps_per_update)
    trained = train_dqn(
        structure,
        [config.numbers],
        [source],
        (world.n_features, world.n_actions),
        callbacks_of(folder, monitor, on_progress),
        CHUNK,
    )
    _keep(trained.policy(0), trained.history, folder)


@dataclass(frozen=True)
class LearnerRun:
    """One IQ-Learn run on a mixture of the three experts' demonstrations."""

    structure: iq.StaticConfig
    numbers: iq.Hyperparameters
    mixture: str
    size: int
    """Episodes of each mode, or transitions in a mixture of equal transitions."""
    environments: int = 12
    options: Options = field(default_factory=Options)
    checks: Checks = field(default_factory=lambda: Checks(times=10))


def train_learner(
    config: LearnerRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Mix, train, keep the last network and the learning curve."""
    structure, numbers = config.structure, config.numbers
    (pools,) = inputs.values()
    shown = {mode: files.load(pools / f"{mode}.safetensors") for mode in MODES}
    data = MIXTURES[config.mixture](shown, config.size, numbers.seed)
    monitor = Monitor(
        config.checks,
        config.options,
        numbers.angle,
        CHUNK,
        math.ceil(structure.updates / CHUNK),
        lambda state: int(state.optimiser.count[0]),
        lambda network: QPolicy.of(network, numbers.temperature, {}),
    )
    collector = None
    if structure.online:
        steps = CHUNK * structure.env_steps_per_update
        source = source_of(config.options, config.environments, steps)
        collector = Collector([source], [numbers.seed], soft([numbers.temperature]))
    trained = train_iq(
        structure,
        [numbers],
        [data],
        callbacks=callbacks_of(folder, monitor, on_progress),
        chunk=CHUNK,
        before_chunk=collector,
    )
    _keep(trained.policy(0), trained.history, folder)


@dataclass(frozen=True)
class Evaluation:
    """Episodes of one policy, on seeds that all policies share."""

    driver: str = LAST
    """File in the input's folder, or the name of a rule-based driver."""
    readouts: tuple[str, ...] = ("greedy", "soft")
    episodes: int = EPISODES
    first_seed: int = FIRST_EPISODE
    options: Options = field(default_factory=Options)


def evaluate(
    config: Evaluation, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Drive; writes what became of every episode, one file for each readout."""
    seeds = np.arange(config.first_seed, config.first_seed + config.episodes)
    for number, readout in enumerate(config.readouts):
        batch = Batch(config.options, BATCH)
        driver = driver_of(config.driver, inputs, config.first_seed)
        episodes = episodes_of(batch, driver, seeds, deterministic=readout == "greedy")
        save_episodes(folder / f"{readout}.safetensors", episodes)
        on_progress((number + 1) / len(config.readouts))


@dataclass(frozen=True)
class LookaheadRun:
    """Episodes of an expert with oracle lookahead."""

    angle: float
    driver: str = BEST
    readouts: tuple[str, ...] = ("greedy",)
    episodes: int = EPISODES
    first_seed: int = FIRST_EPISODE
    options: Options = field(default_factory=Options)


def drive_with_lookahead(
    config: LookaheadRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Run episodes with oracle lookahead, and write their results."""
    driver = driver_of(config.driver, inputs, config.first_seed)
    seeds = np.arange(config.first_seed, config.first_seed + config.episodes)
    episodes = with_oracle_lookahead(config.options, driver, seeds, config.angle)
    save_episodes(folder / "greedy.safetensors", episodes)
    on_progress(1.0)


@dataclass(frozen=True)
class HighwayRun:
    """Episodes of one policy on the core and on the real highway-env."""

    driver: str = LAST
    episodes: int = HIGHWAY_EPISODES
    first_seed: int = FIRST_HIGHWAY_EPISODE
    options: Options = field(default_factory=Options)


def drive_highway(
    config: HighwayRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Compare decision by decision; writes one row for each episode."""
    from socialiq.worlds.intersection.reference.conformance import compare

    driver = driver_of(config.driver, inputs, config.first_seed)
    rows: list[Row] = []
    for compared in compare(config.options, config.episodes, config.first_seed, driver):
        rows.append(compared._asdict())
        on_progress(len(rows) / config.episodes)
    write_atomically(folder / "compared.csv", as_csv(rows))


def driver_of(name: str, inputs: Mapping[str, Path], seed: int) -> Policy:
    """A trained policy of the job's input, or a driver by rule."""
    for trained in inputs.values():
        return QPolicy.load(trained / name)
    return policies.policy(name, seed)


def _keep(policy: QPolicy, history: History, folder: Path) -> None:
    """Write the last network and the learning curve; the checkpoint has served."""
    policy.save(folder / LAST)
    write_curve(history, folder / "curve.csv")
    (folder / CHECKPOINT).unlink(missing_ok=True)


def source_of(options: Options, environments: int, steps: int) -> Source:
    """Intersections on the core, side by side, for so many steps a chunk."""
    env = IntersectionVectorEnv(
        environments, autoreset_mode=AutoresetMode.SAME_STEP, **dataclasses.asdict(options)
    )
    return from_vector_env(env, steps)


def callbacks_of(folder: Path, monitor: Any, on_progress: ProgressCallback) -> Callbacks:
    """Progress, checks, and a checkpoint that an interrupted try has left."""
    checkpoint = folder / CHECKPOINT

    def report(made: Report) -> None:
        on_progress(made.done / made.total)

    return Callbacks(report, monitor, checkpoint, checkpoint.is_file())
