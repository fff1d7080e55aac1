"""The comparison in the intersection: jobs of training and evaluation, and their rows."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners import cql
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.iq_learn import presets
from socialiq.nn.q_policy import QPolicy
from socialiq.types import Row
from socialiq_lab.comparison import nearest_mode, of_modes
from socialiq_lab.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    MIXTURE,
    SIZE,
    mixture_of,
)
from socialiq_lab.intersection.driving import (
    DialAngle,
    Evaluation,
    evaluate,
    save_at_angle,
)
from socialiq_lab.intersection.episodes import LAST, load_episodes
from socialiq_lab.intersection.fitting import Checks
from socialiq_lab.intersection.training import (
    ExpertRun,
    LearnerRun,
    MixtureDialRun,
    train_dial,
    train_expert,
    train_learner,
)
from socialiq_lab.jobs import Job, ProgressCallback
from studies.compare_priors.config import Config, Method, Run, settings

WORLD = "intersection"
RATES = presets.INTERSECTION_CALIBRATED_NUMBERS
COSTS = {"iq_learn": 80.0, "rl": 60.0, "cql": 40.0}
"""Approximate seconds; a clone takes half of CQL's."""


@dataclass(frozen=True)
class OfflineRun:
    """Behaviour cloning or conservative Q-learning on a mixture of demonstrations of some modes."""

    structure: bc.StaticConfig | cql.StaticConfig
    numbers: bc.Hyperparameters | cql.Hyperparameters
    modes: tuple[str, ...]
    mixture: str
    size: int


def train_offline(
    config: OfflineRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Mix all modes, select the given ones, train, and save the last network."""
    (pools,) = inputs.values()
    mixed = mixture_of(pools, config.mixture, config.size, config.numbers.seed)
    data = of_modes(mixed, config.modes)
    callbacks = Callbacks(lambda report: on_progress(report.done / report.total))
    train_offline_policy(config, data, callbacks).save(folder / LAST)


def train_offline_policy(config: OfflineRun, data: Demonstrations, callbacks: Callbacks) -> QPolicy:
    """Train the policy of a run."""
    match config.structure, config.numbers:
        case cql.StaticConfig() as structure, cql.Hyperparameters() as numbers:
            return cql.ConservativeQ.train_on(structure, [numbers], [data], callbacks).policy(0)
        case bc.StaticConfig() as structure, bc.Hyperparameters() as numbers:
            return bc.BehaviourCloning.train_on(structure, [numbers], [data], callbacks).policy(0)
    raise TypeError("structure and numbers belong to two learners")


def jobs_of(
    config: Config, phase: str, method: Method, strengths: Sequence[float], seeds: Sequence[int]
) -> Iterator[Job]:
    """Yield training and evaluation of a method at every angle, strength and seed."""
    dials: set[str] = set()
    for run in runs_of(config, method, strengths, seeds):
        name = job_name(phase, method, run)
        work, given = LEARNERS[method.learner](config, method, run)
        cost = COSTS.get(method.learner, COSTS["cql"] / 2)
        inputs = () if method.learner == "rl" else (DEMONSTRATIONS,)
        if method.learner == "dial":  # trained once, turned to each angle
            dial = f"dials/{phase}/{run.strength:g}/{run.seed}"
            if dial not in dials:
                yield Job(dial, train_dial, _dial_run(config, method, run), inputs, 2 * cost)
                dials.add(dial)
            inputs, cost = (dial,), 1.0
        yield Job(name, work, given, inputs, cost)
        evaluation = Evaluation(LAST, method.readouts, episodes=config.episodes)
        yield Job(f"evaluation/{name}", evaluate, evaluation, (name,), cost=6.0)


def runs_of(
    config: Config, method: Method, strengths: Sequence[float], seeds: Sequence[int]
) -> list[Run]:
    """Return the runs of a method; one that doesn't depend on the angle has one for each seed."""
    angles = config.development_angles if method.by_angle else config.development_angles[:1]
    return [Run(*each, 0) for each in itertools.product(angles, strengths, seeds)]


def job_name(phase: str, method: Method, run: Run) -> str:
    """Return the folder of a training run."""
    return f"priors/{WORLD}/{phase}/{method.name}/{run.strength:g}/{run.angle:g}/{run.seed}"


def rows_of(
    config: Config,
    work: Path,
    phase: str,
    method: Method,
    strengths: Sequence[float],
    seeds: Sequence[int],
) -> list[Row]:
    """Return a row for each policy, angle and action selection; regrets are unknown here."""
    rows: list[Row] = []
    for run in runs_of(config, method, strengths, seeds):
        folder = work / "evaluation" / job_name(phase, method, run)
        for readout in method.readouts:
            metrics = load_episodes(folder / f"{readout}.safetensors").metrics()
            for angle in (run.angle,) if method.by_angle else config.development_angles:
                label = {"world": WORLD, "method": method.name, "strength": run.strength}
                label |= {"target_angle": angle, "readout": readout, "seed": run.seed}
                values = {"value": metrics.value(angle), "regret": "", "effective_share": ""}
                rows.append(label | metrics._asdict() | values)
    return rows


Work = tuple[Callable[..., None], object]
"""Function of a job, and its configuration."""


def _settings(config: Config, method: Method, run: Run) -> tuple[Any, Any]:
    updates = config.intersection_updates
    base = dataclasses.replace(presets.INTERSECTION_CALIBRATED, updates=updates)
    return settings(method, base, RATES, run)


def _iq_learn(config: Config, method: Method, run: Run) -> Work:
    if method.target_kind == "advantage":  # no state occurs twice
        method = dataclasses.replace(method, target_kind="advantage_fitted")
    return train_learner, LearnerRun(*_settings(config, method, run), MIXTURE, SIZE)


def _offline(config: Config, method: Method, run: Run) -> Work:
    modes = (nearest_mode(run.angle),) if method.learner == "clone_of_mode" else tuple(MODES)
    return train_offline, OfflineRun(*_settings(config, method, run), modes, MIXTURE, SIZE)


def _reinforcement(config: Config, method: Method, run: Run) -> Work:
    """Return the experts' learner at the budget of the other rows."""
    return train_expert, ExpertRun(*_settings(config, method, run), checks=Checks(times=2))


def _dial(_config: Config, _method: Method, run: Run) -> Work:
    return save_at_angle, DialAngle(run.angle)


def _dial_run(config: Config, method: Method, run: Run) -> MixtureDialRun:
    static, numbers = _settings(config, method, run)
    return MixtureDialRun(
        structure=static, numbers=numbers, size=SIZE, steps_per_update=static.environments
    )


LEARNERS: dict[str, Callable[[Config, Method, Run], Work]] = {
    "iq_learn": _iq_learn,
    "clone": _offline,
    "clone_of_mode": _offline,
    "clone_weighted": _offline,
    "cql": _offline,
    "rl": _reinforcement,
    "dial": _dial,
}
"""By the name in `Method.learner`."""
