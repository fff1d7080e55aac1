"""Evaluation jobs of the intersection: a policy's episodes on common seeds, as checked files."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.evaluation.branching import with_oracle_lookahead
from socialiq.evaluation.dial import Sweep, calibrated
from socialiq.evaluation.episodes import Episodes, episodes_of
from socialiq.evaluation.online_planning import RolloutPolicy
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.ensemble import load_values
from socialiq.results_folder import as_csv
from socialiq.storage import load_arrays, save_arrays, write_atomically
from socialiq.types import Policy, RewardPair, Row
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Batch
from socialiq_lab.jobs import ProgressCallback

BEST, LAST, DIAL = "best.safetensors", "last.safetensors", "dial.safetensors"
"""Files of a training job: the best network by checks, the last one, a dial."""
CURVE = "curve.csv"
"""File of a training job's learning curve."""
EPISODES, FIRST_EPISODE = 2000, 20_000_000
"""Evaluation episodes of a policy, and the seed of the first, the same for all policies."""
_PAIRS = ("totals", "classical")


@dataclass(frozen=True, kw_only=True)
class EpisodesRun:
    """Episodes on seeds that all policies share."""

    episodes: int = EPISODES
    first_seed: int = FIRST_EPISODE
    options: Options = field(default_factory=Options)

    @property
    def seeds(self) -> np.ndarray:
        """Seed of each episode."""
        return np.arange(self.first_seed, self.first_seed + self.episodes)


def angle_file(angle: float) -> str:
    """Return the name of the file that belongs to an angle in degrees."""
    return f"{angle:g}.safetensors"


def save_episodes(path: Path, episodes: Episodes) -> str:
    """Write the outcomes of episodes to one file.

    Returns:
        The content's SHA-256.

    Raises:
        UserError: If the file can't be written.
    """
    fields = episodes._asdict()
    header = {"signal_names": list(fields.pop("signal_names"))}
    arrays = {}
    for name in _PAIRS:
        pair = fields.pop(name)
        arrays |= {f"{name}_env": pair.env, f"{name}_social": pair.social}
    return save_arrays(path, "episodes", 1, arrays | fields, header)


def load_episodes(path: Path) -> Episodes:
    """Read the outcomes of episodes.

    Raises:
        UserError: If the file is missing, damaged, or holds something else.
    """
    arrays, header = load_arrays(path, "episodes", 1)
    fields: dict[str, Any] = {**arrays, "signal_names": tuple(header["signal_names"])}
    for name in _PAIRS:
        fields[name] = RewardPair(fields.pop(f"{name}_env"), fields.pop(f"{name}_social"))
    return Episodes(**fields)


BATCH = 512  # episodes side by side in evaluation
PLANNED_BATCH = 128  # the same, where each has many imagined ones
FIRST_CALIBRATION = 15_000_000
"""First seed of the episodes that select a dial's settings."""
HIGHWAY_EPISODES, FIRST_HIGHWAY_EPISODE = 200, 30_000_000
"""Episodes on the real highway-env, and the seed of the first."""


@dataclass(frozen=True)
class Evaluation(EpisodesRun):
    """Episodes of one policy for each readout."""

    driver: str = LAST
    """File in the input's folder, or the name of a rule-based driver."""
    readouts: tuple[str, ...] = ("greedy", "soft")


def evaluate(
    config: Evaluation, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the outcome of every episode, one file for each readout."""
    for number, readout in enumerate(config.readouts):
        batch = Batch(config.options, BATCH)
        driver = driver_of(config.driver, inputs, config.first_seed)
        episodes = episodes_of(batch, driver, config.seeds, deterministic=readout == "greedy")
        save_episodes(folder / f"{readout}.safetensors", episodes)
        on_progress((number + 1) / len(config.readouts))


@dataclass(frozen=True)
class LookaheadRun(EpisodesRun):
    """Episodes of an expert with oracle lookahead."""

    angle: float
    driver: str = BEST
    readouts: tuple[str, ...] = ("greedy",)


def drive_with_lookahead(
    config: LookaheadRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the outcome of every episode with oracle lookahead."""
    driver = driver_of(config.driver, inputs, config.first_seed)
    episodes = with_oracle_lookahead(config.options, driver, config.seeds, config.angle)
    save_episodes(folder / "greedy.safetensors", episodes)
    on_progress(1.0)


@dataclass(frozen=True, kw_only=True)
class HighwayRun(EpisodesRun):
    """Episodes of one policy on the core and on the real highway-env."""

    driver: str = LAST
    episodes: int = HIGHWAY_EPISODES
    first_seed: int = FIRST_HIGHWAY_EPISODE


def drive_highway(
    config: HighwayRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Compare both decision by decision; write one row for each episode."""
    from socialiq.worlds.conformance import compare_intersection

    driver = driver_of(config.driver, inputs, config.first_seed)
    rows: list[Row] = []
    for compared in compare_intersection(
        config.options, config.episodes, config.first_seed, driver
    ):
        rows.append(compared._asdict())
        on_progress(len(rows) / config.episodes)
    write_atomically(folder / "compared.csv", as_csv(rows))


@dataclass(frozen=True)
class DialEvaluation(EpisodesRun):
    """Greedy episodes of a dial at some angles, in degrees."""

    angles: tuple[float, ...]
    driver: str = DIAL
    """File in the input's folder."""


def evaluate_dial(
    config: DialEvaluation, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the outcome of every episode, one file for each angle."""
    (trained,) = inputs.values()
    dial = DialPolicy.load(trained / config.driver)
    for number, angle in enumerate(config.angles, start=1):
        episodes = episodes_of(Batch(config.options, BATCH), dial.at(angle), config.seeds)
        save_episodes(folder / angle_file(angle), episodes)
        on_progress(number / len(config.angles))


def evaluate_calibrated(
    config: DialEvaluation, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the outcomes of a dial with settings: those of the dial without, at the settings.

    A policy of the one is a policy of the other, and both drive the same episodes. The inputs are
    the dial, and the evaluation of the dial that it was made of.
    """
    calibrated_dial, driven = inputs.values()
    dial = DialPolicy.load(calibrated_dial / DIAL)
    for angle in config.angles:
        shutil.copy(driven / angle_file(dial.setting(angle)), folder / angle_file(angle))
    on_progress(1.0)


@dataclass(frozen=True)
class PlannedEvaluation(DialEvaluation):
    """Episodes of a dial that plans online at some angles, in degrees."""

    draws: int = 16
    """States drawn for each observation."""
    decisions: int = 3
    """Decisions simulated in each."""
    doubt: float = 1.0
    """Standard errors by which an action must exceed the network's own."""


def evaluate_planned(
    config: PlannedEvaluation,
    folder: Path,
    inputs: Mapping[str, Path],
    on_progress: ProgressCallback,
) -> None:
    """Write the outcome of every episode of a dial that plans, one file for each angle."""
    (trained,) = inputs.values()
    dial = DialPolicy.load(trained / DIAL)
    discount = dial.provenance["numbers"]["discount"]
    settings = (config.draws, config.decisions, config.doubt, discount)
    for number, angle in enumerate(config.angles, start=1):
        policy = RolloutPolicy(dial.at(angle), config.options, angle, *settings)
        episodes = episodes_of(Batch(config.options, PLANNED_BATCH), policy, config.seeds)
        save_episodes(folder / angle_file(angle), episodes)
        on_progress(number / len(config.angles))


def evaluate_seeing(
    config: DialEvaluation, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the outcome of every episode of a dial with oracle lookahead, a file for each angle."""
    (trained,) = inputs.values()
    dial = DialPolicy.load(trained / DIAL)
    for number, angle in enumerate(config.angles, start=1):
        episodes = with_oracle_lookahead(config.options, dial.at(angle), config.seeds, angle)
        save_episodes(folder / angle_file(angle), episodes)
        on_progress(number / len(config.angles))


@dataclass(frozen=True)
class DialCalibration(EpisodesRun):
    """Greedy episodes of a dial at some angles, in degrees, that select its settings."""

    angles: tuple[float, ...]
    first_seed: int = field(default=FIRST_CALIBRATION, kw_only=True)


def calibrate_dial(
    config: DialCalibration, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the dial that answers each angle with the best of its policies."""
    (trained,) = inputs.values()
    dial = DialPolicy.load(trained / DIAL)
    batch = Batch(config.options, BATCH)
    metrics = []
    for angle in config.angles:
        metrics.append(episodes_of(batch, dial.at(angle), config.seeds).metrics())
        on_progress(len(metrics) / len(config.angles))
    calibrated(dial, Sweep(config.angles, tuple(metrics))).save(folder / DIAL)


@dataclass(frozen=True)
class DialAngle:
    """Angle of a dial, in degrees."""

    angle: float


def save_at_angle(
    config: DialAngle, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write a dial's policy of one angle, so that other jobs can evaluate it."""
    (trained,) = inputs.values()
    DialPolicy.load(trained / DIAL).at(config.angle).save(folder / LAST)
    on_progress(1.0)


def driver_of(name: str, inputs: Mapping[str, Path], seed: int) -> Policy:
    """Return the trained policy in the input's folder, or without an input a rule-based driver."""
    for trained in inputs.values():
        return load_values(trained / name)
    return policies.policy(name, seed)
