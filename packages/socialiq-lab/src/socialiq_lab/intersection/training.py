"""Training jobs of the intersection: experts, learners, dials and clones; each fills a folder.

A job is called in a separate process, so everything that it depends on is in its configuration, of
which its fingerprint is made (`socialiq_lab.jobs`).
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from socialiq import QPolicy, UserError
from socialiq.evaluation import road_training as road
from socialiq.evaluation.road_training import Checks
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners import dqn, policy_iteration
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial import config as dial
from socialiq.learners.dial import offline
from socialiq.learners.dial import train as dial_training
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.learners.kernel import Trained
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_network import network_of
from socialiq.population.fleet import DURATION
from socialiq.results_folder import as_csv
from socialiq.storage import write_atomically
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds.grammar import road_of
from socialiq.worlds.highway.effects import EffectOptions
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.registry import make_fleet
from socialiq_lab.comparison import nearest_mode, of_modes
from socialiq_lab.intersection.driving import BEST, DIAL, LAST, mixture_of
from socialiq_lab.jobs import Inputs, Job, ProgressCallback, callbacks_of
from socialiq_lab.study import Context

CHECKPOINT = "checkpoint.safetensors"
CURVE = "curve.csv"
"""File of a training job's learning curve."""
CHECKS = Checks(times=8, episodes=200)
CHECK_ANGLES = 0.0, 45.0, 90.0
"""Checks of a dial, and their angles in degrees."""
ENVIRONMENTS = 256
FLEETS = 64  # side by side
"""Intersections side by side in which policy iteration labels states."""


def fit(
    train: Callable[..., Trained],
    folder: Path,
    on_progress: ProgressCallback,
    files: Sequence[str],
    monitor: road.Monitor | None = None,
) -> None:
    """Train, from the checkpoint of an interrupted try if there is one, and fill the folder.

    Args:
        train: Trains the runs, given `callbacks` and `chunk`.
        folder: Folder of the job.
        on_progress: Called with the finished share of the training.
        files: Names of the runs' policies below the folder.
        monitor: Measures the learning curve of the first run, with a measure `total`. Without it no
            curve is written.
    """
    checkpoint = folder / CHECKPOINT
    callbacks = callbacks_of(on_progress, checkpoint, monitor)
    trained = train(callbacks=callbacks, chunk=road.CHUNK)
    _save(trained, folder, files)
    if monitor is not None:
        history = trained.history
        curves = {name: history.array(name)[:, 0] for name in history.values}
        rows: list[Row] = [
            {"updates": updates} | {name: rounded(float(curves[name][i])) for name in curves}
            for i, updates in enumerate(history.updates)
            if np.isfinite(curves["total"][i])
        ]
        write_atomically(folder / CURVE, as_csv(rows))
    checkpoint.unlink(missing_ok=True)


def _save(trained: Any, folder: Path, files: Sequence[str]) -> None:
    for run, file in enumerate(files):
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        trained.policy(run).save(folder / file)


@dataclass(frozen=True)
class ExpertRun:
    """One DQN expert (thesis 5.2)."""

    structure: dqn.DQNConfig
    numbers: dqn.DQNHyperparameters
    environments: int = 12
    options: Options = field(default_factory=Options)
    checks: Checks = field(default_factory=Checks)
    nearest: Mapping[str, float] = field(default_factory=dict)
    """Shares of endings, by measure, to which the best check is nearest; by default the best check
    has the highest J(α)."""

    @property
    def criterion(self) -> str:
        """Name of what the best check has the most of: J(α), or the likeness to `nearest`."""
        return "likeness" if self.nearest else "total"

    def merit(self, measures: Mapping[str, float]) -> float:
        """Return what the best check has the most of.

        Args:
            measures: `MEASURES` of a check.

        Returns:
            J(α), or less the Euclidean distance of the shares from `nearest`.
        """
        if not self.nearest:
            return measures["total"]
        return -math.dist(self.nearest.values(), [measures[name] for name in self.nearest])


def train_expert(
    config: ExpertRun, folder: Path, _inputs: Inputs, on_progress: ProgressCallback
) -> None:
    """Write the last network of an expert, the best by checks, and the learning curve.

    Args:
        config: The run.
        folder: Folder of the job.
        _inputs: No folders.
        on_progress: Called with the finished share of the training.
    """
    structure = config.structure
    numbers = config.numbers
    best = folder / BEST

    def measure(state: Any, done: int) -> dict[str, float]:
        policy = dqn.policy_of(structure, numbers, network_of(state.network, 0))
        measures = config.checks.measured(config.options, policy, numbers.angle)
        merit = config.merit(measures)  # of two equal ones the earlier stays
        name = config.criterion
        if not best.is_file() or QPolicy.load(best).provenance["check"][name] < merit:
            check = {"updates": done, name: merit, "episodes": config.checks.episodes}
            provenance = {**policy.provenance, "check": check}
            dataclasses.replace(policy, provenance=provenance).save(best)
        return measures

    source = road.source_of(config.options, config.environments, structure.steps_per_update)
    train = partial(dqn.train, structure, [numbers], [source], road.sizes_of(config.options))
    monitor = config.checks.monitor(structure.updates, measure, *road.MEASURES)
    fit(train, folder, on_progress, [LAST], monitor)


@dataclass(frozen=True)
class LearnerRun:
    """One IQ-Learn run on a mixture of the three experts' demonstrations."""

    structure: iq.IQLearnConfig
    numbers: iq.IQLearnHyperparameters
    mixture: str
    size: int
    """Episodes of each mode, or transitions in a mixture of equal transitions."""
    environments: int = 12
    options: Options = field(default_factory=Options)
    checks: Checks = field(default_factory=lambda: Checks(times=10))


def train_learner(
    config: LearnerRun, folder: Path, inputs: Inputs, on_progress: ProgressCallback
) -> None:
    """Write the last network of a learner and its learning curve.

    Args:
        config: The run.
        folder: Folder of the job.
        inputs: Folder of the recordings.
        on_progress: Called with the finished share of the training.
    """
    structure = config.structure
    numbers = config.numbers
    (recordings,) = inputs.values()
    data = mixture_of(recordings, config.size, numbers.seed, config.mixture)

    def measure(state: Any, _done: int) -> dict[str, float]:
        policy = QPolicy.of(network_of(state.network, 0), numbers.temperature, {})
        return config.checks.measured(config.options, policy, numbers.angle)

    train = partial(
        train_iq, structure, [numbers], [data], before_chunk=_soft_collector(config, [numbers])
    )
    monitor = config.checks.monitor(structure.updates, measure, *road.MEASURES)
    fit(train, folder, on_progress, [LAST], monitor)


def _soft_collector(config: Any, runs: Sequence[iq.IQLearnHyperparameters]) -> Any:
    """Return what collects the runs' own experience; None for offline ones."""
    structure = config.structure
    if not structure.online:
        return None
    steps = structure.env_steps_per_update
    return road.soft_collector(config.options, config.environments, steps, runs)


@dataclass(frozen=True, kw_only=True)
class DialRun:
    """A dial that learns from a mixture of the three experts, or an agent: a dial of one angle."""

    structure: dial.DialConfig
    numbers: dial.DialHyperparameters
    size: int
    """Transitions of each expert."""
    steps_per_update: int = road.STEPS_PER_UPDATE
    check_angles: tuple[float, ...] = CHECK_ANGLES
    """Angles of a check, in degrees; of an agent its own."""


def train_dial(
    config: DialRun, folder: Path, inputs: Inputs, on_progress: ProgressCallback
) -> None:
    """Write a dial and its learning curve, the mean of J(α) over the angles of a check.

    Args:
        config: The run.
        folder: Folder of the job.
        inputs: Folder of the recordings.
        on_progress: Called with the finished share of the training.
    """
    structure = config.structure
    numbers = config.numbers
    clock = structure.redraw_times > 0  # the network sees the time where times are redrawn
    (recordings,) = inputs.values()
    data = mixture_of(recordings, config.size, numbers.seed)

    def measure(state: Any, _done: int) -> dict[str, float]:
        network = network_of(dial_training.deployed(state), 0)
        dial = dial_training.dial_of(structure, numbers, network)
        assert isinstance(dial, DialPolicy)  # the intersection has one class
        return _mean_value(CHECKS, dial, config.check_angles)

    size = structure.environments, config.steps_per_update
    collector = road.dial_collector(structure, [numbers], road_of(), *size)
    train = partial(
        dial_training.train,
        structure,
        [numbers],
        [data.with_clock() if clock else data],
        sizes=road.sizes_of(Options(), clock),
        before_chunk=collector,
    )
    monitor = CHECKS.monitor(structure.updates, measure, "total")
    fit(train, folder, on_progress, [DIAL], monitor)


def _mean_value(checks: Checks, policy: DialPolicy, angles: Sequence[float]) -> dict[str, float]:
    """Return the mean of J(α) over the angles of a check; its r_social is Eq 4.2."""
    totals = [checks.measured(Options(), policy.at(angle), angle)["total"] for angle in angles]
    return {"total": float(np.mean(totals))}


@dataclass(frozen=True)
class DialIterationRun:
    """One run of direct policy iteration of a dial, which begins with the job's input."""

    structure: policy_iteration.DialIterationConfig
    numbers: policy_iteration.IterationHyperparameters
    checks: Checks = CHECKS
    effects: EffectOptions | None = None
    """Of a training by what the ego causes, in the place of Eq 4.2."""
    agents: int = 1
    """Vehicles of an episode that the dial drives against itself; see `road.fleet_labeller`."""
    shifts: tuple[str, ...] = ()
    """Worlds of shifts that the dial drives in; see `road.shifted`."""


def iteration_jobs(
    config: Any, start: str, first_rounds: int, times: int, cost: float, **settings: Any
) -> Iterator[Job]:
    """Yield a job for each seed of a study, of a smaller budget than `train improve-dial` has.

    Args:
        config: Configuration of the study, with `seeds`, `updates` and `states_per_update`.
        start: Name of the job that makes the dial to begin with.
        first_rounds: Rounds of labelling before the first update.
        times: Number of checks in a run.
        cost: Approximate seconds of a job.
        **settings: Further fields of each run.

    Returns:
        Jobs "training/SEED".
    """
    structure = replace(
        road.ITERATION,
        updates=config.updates,
        batch_size=256,
        first_rounds=first_rounds,
        states_per_update=config.states_per_update,
    )
    numbers = replace(road.ITERATION_NUMBERS, regression=0.4, exploration_fall=0.3)
    checks = Checks(times=times, episodes=100)
    for seed in config.seeds:
        run = DialIterationRun(structure, replace(numbers, seed=seed), checks, **settings)
        yield Job(f"training/{seed}", train_dial_by_iteration, run, (start,), cost)


def first_dial(config: Any, context: Context) -> dict[str, bytes]:
    """Return the dial of a study's first seed, as a file of its results.

    Args:
        config: Configuration of the study, with `seeds`.
        context: Finished jobs, "training/SEED" among them.
    """
    return {DIAL: (context.work / "training" / str(config.seeds[0]) / DIAL).read_bytes()}


def train_dial_by_iteration(
    config: DialIterationRun,
    folder: Path,
    inputs: Inputs,
    on_progress: ProgressCallback,
) -> None:
    """Improve the dial of the input; write it and its learning curve, the mean of J(α) over angles.

    Args:
        config: The run.
        folder: Folder of the job.
        inputs: Folder of the job with the dial to begin with.
        on_progress: Called with the finished share of the training.
    """
    (begun,) = inputs.values()
    start = DialPolicy.load(begun / DIAL)
    clock = road.observes_time(start, Options())
    options = Options()
    structure = policy_iteration.with_network_of(config.structure, start)

    def measure(state: Any, _done: int) -> dict[str, float]:
        network = network_of(state.target_network, 0)
        dial = DialPolicy.of(network, 1.0, structure.low, structure.high, {})
        return _mean_value(config.checks, dial, CHECK_ANGLES)

    if config.shifts:
        whole = road.CHUNK * structure.states_per_update // options.decisions  # episodes of a call
        method = config.structure, start, config.shifts, max(3 * ENVIRONMENTS, whole)
        start, structure, labeller = road.shifted(*method)
    elif config.agents > 1:
        fleet = make_fleet("intersection", config.agents, duration=DURATION)
        labeller = road.fleet_labeller(structure, fleet, FLEETS, clock)
    else:
        world = road_of(options, config.effects)
        labeller = road.dial_labeller(structure, world, ENVIRONMENTS, clock)
    train = partial(
        policy_iteration.train,
        structure,
        [config.numbers],
        [labeller],
        road.sizes_of(options, clock),
        start=start,
    )
    monitor = config.checks.monitor(structure.updates, measure, "total")
    fit(train, folder, on_progress, [DIAL], monitor)


@dataclass(frozen=True, kw_only=True)
class MixtureRuns:
    """Runs of a method in one program, each training seed with a separate mixture.

    Dials of offline learning, or for each angle clones, or IQ-Learn offline or online.
    """

    structure: dial.OfflineDialConfig | bc.CloningConfig | iq.IQLearnConfig
    numbers: Any
    """Hyperparameters without seed, angle and data set."""
    seeds: tuple[int, ...]
    size: int
    """Transitions of each expert."""
    angles: tuple[float, ...] = ()
    """In degrees; none for dials."""
    nearest: bool = False
    """Whether a clone sees the demonstrator of the nearest angle alone."""
    environments: int = 12
    options: Options = field(default_factory=Options)


def run_file(seed: int, angle: float | None = None) -> str:
    """Return the path of a run's policy below its job's folder.

    Args:
        seed: Training seed.
        angle: Angle in degrees; None for a dial.
    """
    return f"{seed}/{DIAL}" if angle is None else f"{seed}/{angle:g}/{LAST}"


def train_runs(
    config: MixtureRuns, folder: Path, inputs: Inputs, on_progress: ProgressCallback
) -> None:
    """Train all runs and write their policies (`run_file`).

    Args:
        config: The runs.
        folder: Folder of the job.
        inputs: Folder of the recordings.
        on_progress: Called with the finished share of the training.

    Raises:
        UserError: If a run broke.
    """
    (recordings,) = inputs.values()
    data = [mixture_of(recordings, config.size, seed) for seed in config.seeds]
    structure = config.structure
    cells = list(itertools.product(config.seeds, config.angles))
    callbacks = callbacks_of(on_progress)
    if isinstance(structure, dial.OfflineDialConfig):
        numbers = [dataclasses.replace(config.numbers, seed=seed) for seed in config.seeds]

        def of_stage(stage: str) -> Callbacks:
            share = 1.0 / len(offline.STAGES)
            done = share * offline.STAGES.index(stage)
            return callbacks_of(on_progress, done=done, share=share)

        dials = offline.train(structure, numbers, data, of_stage)["dial"]
        _save(dials, folder, [run_file(seed) for seed in config.seeds])
        return
    if config.nearest:
        modes = [(nearest_mode(angle),) for _, angle in cells]
        of_cells = [data[config.seeds.index(seed)] for seed, _ in cells]
        data = [of_modes(*mixture) for mixture in zip(of_cells, modes, strict=True)]
    runs = [
        dataclasses.replace(
            config.numbers,
            seed=seed,
            angle=angle,
            dataset=run if config.nearest else config.seeds.index(seed),
        )
        for run, (seed, angle) in enumerate(cells)
    ]
    if isinstance(structure, bc.CloningConfig):
        trained = bc.BehaviourCloning.train_on(structure, runs, data, callbacks)
    else:
        collector = _soft_collector(config, runs)
        trained = train_iq(
            structure, runs, data, callbacks=callbacks, chunk=road.CHUNK, before_chunk=collector
        )
    if trained.failures:
        raise UserError(trained.failures[0])
    _save(trained, folder, [run_file(seed, angle) for seed, angle in cells])
