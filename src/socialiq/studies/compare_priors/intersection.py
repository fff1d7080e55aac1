"""The comparison in the intersection, as jobs beside those of its own study."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    MIXTURE,
    SIZE,
    mixture_of,
)
from socialiq.experiments.intersection.driving import (
    DialAngle,
    Evaluation,
    evaluate,
    save_at_angle,
)
from socialiq.experiments.intersection.episodes import LAST, load_episodes
from socialiq.experiments.intersection.fitting import Checks
from socialiq.experiments.intersection.training import (
    ExpertRun,
    LearnerRun,
    MixtureDialRun,
    train_dial,
    train_expert,
    train_learner,
)
from socialiq.experiments.jobs import Job, ProgressCallback
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners import cql
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import presets
from socialiq.nn.q_policy import QPolicy
from socialiq.studies.compare_priors.budget import (
    Run,
    clone_numbers,
    clone_structure,
    cql_numbers,
    cql_structure,
    dial_numbers,
    dial_structure,
    numbers_of,
    rl_numbers,
    rl_structure,
    structure_of,
)
from socialiq.studies.compare_priors.config import Config
from socialiq.studies.compare_priors.methods import Method, nearest_mode
from socialiq.types import Row

WORLD = "intersection"
RATES = presets.INTERSECTION_CALIBRATED_NUMBERS
COSTS = {"iq_learn": 80.0, "rl": 60.0, "cql": 40.0}
"""Seconds or so; a clone takes half of CQL's."""


@dataclass(frozen=True)
class OfflineRun:
    """A clone, or conservative Q-learning, on a mixture of the recordings of some modes."""

    structure: bc.StaticConfig | cql.StaticConfig
    numbers: bc.Hyperparameters | cql.Hyperparameters
    modes: tuple[str, ...]
    mixture: str
    size: int


def train_offline(
    config: OfflineRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Mix all modes, keep those that are asked for, train, keep the last network."""
    (pools,) = inputs.values()
    mixed = mixture_of(pools, config.mixture, config.size, config.numbers.seed)
    data = of_modes(mixed, config.modes)
    callbacks = Callbacks(lambda report: on_progress(report.done / report.total))
    train_offline_policy(config, data, callbacks).save(folder / LAST)


def train_offline_policy(config: OfflineRun, data: Demonstrations, callbacks: Callbacks) -> QPolicy:
    """The policy of one run."""
    match config.structure, config.numbers:
        case cql.StaticConfig() as structure, cql.Hyperparameters() as numbers:
            return cql.train(structure, [numbers], [data], callbacks).policy(0)
        case bc.StaticConfig() as structure, bc.Hyperparameters() as numbers:
            return bc.clone(structure, [numbers], [data], callbacks).policy(0)
    raise TypeError("structure and numbers belong to two learners")


def of_modes(data: Demonstrations, modes: Sequence[str]) -> Demonstrations:
    """The episodes of these modes."""
    wanted = [number for number, name in enumerate(data.mode_names) if name in modes]
    return data.select(np.flatnonzero(np.isin(data.episode_modes, wanted)))


def jobs_of(
    config: Config, phase: str, method: Method, strengths: Sequence[float], seeds: Sequence[int]
) -> Iterator[Job]:
    """Training and evaluation of one method at every angle, strength and seed."""
    dials: set[str] = set()
    for run in runs_of(config, method, strengths, seeds):
        name = job_name(phase, method, run)
        work, given = LEARNERS[method.learner](config, method, run)
        cost = COSTS.get(method.learner, COSTS["cql"] / 2)
        inputs = () if method.learner == "rl" else (DEMONSTRATIONS,)
        if method.learner == "dial":  # trained once, turned to each angle
            dial = f"dials/{phase}/{run.strength:g}/{run.seed}"
            if dial not in dials:
                yield Job(dial, train_dial, _dial_run(config, run), inputs, 2 * cost)
                dials.add(dial)
            inputs, cost = (dial,), 1.0
        yield Job(name, work, given, inputs, cost)
        looking = Evaluation(LAST, method.readouts, episodes=config.episodes)
        yield Job(f"evaluation/{name}", evaluate, looking, (name,), cost=6.0)


def runs_of(
    config: Config, method: Method, strengths: Sequence[float], seeds: Sequence[int]
) -> list[Run]:
    """A method that doesn't know the angle is trained once for each seed."""
    angles = config.development_angles if method.by_angle else config.development_angles[:1]
    return [Run(a, strength, seed, 0) for a in angles for strength in strengths for seed in seeds]


def job_name(phase: str, method: Method, run: Run) -> str:
    """Folder of a training run."""
    return f"priors/{WORLD}/{phase}/{method.name}/{run.strength:g}/{run.angle:g}/{run.seed}"


def rows_of(
    config: Config,
    work: Path,
    phase: str,
    method: Method,
    strengths: Sequence[float],
    seeds: Sequence[int],
) -> list[Row]:
    """One row for each policy, angle that it serves, and readout; there is no regret to state."""
    found: list[Row] = []
    for run in runs_of(config, method, strengths, seeds):
        folder = work / "evaluation" / job_name(phase, method, run)
        for readout in method.readouts:
            metrics = load_episodes(folder / f"{readout}.safetensors").metrics()
            for angle in (run.angle,) if method.by_angle else config.development_angles:
                label = {"world": WORLD, "method": method.name, "strength": run.strength}
                label |= {"target_angle": angle, "readout": readout, "seed": run.seed}
                worth = {"value": metrics.value(angle), "regret": "", "effective_share": ""}
                found.append(label | metrics._asdict() | worth)
    return found


Made = tuple[Callable[..., None], object]
"""Function of a job, and its configuration."""


def _base(config: Config) -> iq.StaticConfig:
    return dataclasses.replace(presets.INTERSECTION_CALIBRATED, updates=config.intersection_updates)


def _iq_learn(config: Config, method: Method, run: Run) -> Made:
    if method.target_kind == "advantage":  # no state is ever seen twice
        method = dataclasses.replace(method, target_kind="advantage_fitted")
    structure = structure_of(method, _base(config))
    numbers = numbers_of(RATES, run)
    return train_learner, LearnerRun(structure, numbers, MIXTURE, SIZE)


def _clone(config: Config, method: Method, run: Run) -> Made:
    structure = clone_structure(_base(config), method.learner == "clone_weighted")
    modes = (nearest_mode(run.angle),) if method.learner == "clone_of_mode" else tuple(MODES)
    numbers = clone_numbers(RATES, run)
    return train_offline, OfflineRun(structure, numbers, modes, MIXTURE, SIZE)


def _conservative(config: Config, _method: Method, run: Run) -> Made:
    structure, numbers = cql_structure(_base(config)), cql_numbers(RATES, run)
    return train_offline, OfflineRun(structure, numbers, tuple(MODES), MIXTURE, SIZE)


def _reinforcement(config: Config, _method: Method, run: Run) -> Made:
    """The experts' learner, at the budget of the other rows."""
    structure, numbers = rl_structure(_base(config)), rl_numbers(RATES, run)
    return train_expert, ExpertRun(structure, numbers, checks=Checks(times=2))


def _dial(_config: Config, _method: Method, run: Run) -> Made:
    return save_at_angle, DialAngle(run.angle)


def _dial_run(config: Config, run: Run) -> MixtureDialRun:
    base = _base(config)
    numbers = dial_numbers(RATES, run)
    return MixtureDialRun(
        structure=dial_structure(base),
        numbers=numbers,
        size=SIZE,
        steps_per_update=base.env_steps_per_update,
    )


LEARNERS: dict[str, Callable[[Config, Method, Run], Made]] = {
    "iq_learn": _iq_learn,
    "clone": _clone,
    "clone_of_mode": _clone,
    "clone_weighted": _clone,
    "cql": _conservative,
    "rl": _reinforcement,
    "dial": _dial,
}
"""By the name in `Method.learner`."""
