"""The comparison in the intersection, as jobs beside those of its own study."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import MIXTURES
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.jobs import Job, Tell
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners import cql
from socialiq.learners.callbacks import Outside
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import presets
from socialiq.nn.q_policy import QPolicy
from socialiq.studies.compare_priors.budget import (
    Lane,
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
from socialiq.studies.intersection import config as study
from socialiq.studies.intersection.demonstration_sets import POOLS
from socialiq.studies.intersection.episodes import load_episodes
from socialiq.studies.intersection.jobs import (
    LAST,
    Evaluation,
    ExpertRun,
    LearnerRun,
    evaluate,
    train_expert,
    train_learner,
)
from socialiq.studies.intersection.monitor import Checks
from socialiq.studies.intersection_dial.jobs import DialRun, Turned, train_dial, turn
from socialiq.types import Row

WORLD = "intersection"
RATES = presets.INTERSECTION_CALIBRATED_NUMBERS
STUDY = study.Config()
"""Whose recordings and mixtures all methods learn from, made again of the atlas' experts."""
COSTS = {"iq_learn": 80.0, "rl": 60.0, "cql": 40.0}
"""Seconds or so; a clone takes half of CQL's."""


@dataclass(frozen=True)
class OfflineRun:
    """A clone, or conservative Q-learning, on a mixture of the recordings of some modes."""

    structure: bc.Structure | cql.Structure
    numbers: bc.Numbers | cql.Numbers
    modes: tuple[str, ...]
    mixture: str
    size: int


def train_offline(config: OfflineRun, folder: Path, inputs: Mapping[str, Path], tell: Tell) -> None:
    """Mix all modes, keep those that are asked for, train, keep the last network."""
    (pools,) = inputs.values()
    shown = {mode: files.load(pools / f"{mode}.safetensors") for mode in MODES}
    data = of_modes(MIXTURES[config.mixture](shown, config.size, config.numbers.seed), config.modes)
    outside = Outside(lambda report: tell(report.done / report.total))
    train_offline_policy(config, data, outside).save(folder / LAST)


def train_offline_policy(config: OfflineRun, data: Demonstrations, outside: Outside) -> QPolicy:
    """The policy of one run."""
    match config.structure, config.numbers:
        case cql.Structure() as structure, cql.Numbers() as numbers:
            return cql.train(structure, [numbers], [data], outside).policy(0)
        case bc.Structure() as structure, bc.Numbers() as numbers:
            return bc.clone(structure, [numbers], [data], outside).policy(0)
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
    for lane in lanes_of(config, method, strengths, seeds):
        name = job_name(phase, method, lane)
        work, run = LEARNERS[method.learner](config, method, lane)
        cost = COSTS.get(method.learner, COSTS["cql"] / 2)
        inputs = () if method.learner == "rl" else (POOLS,)
        if method.learner == "dial":  # trained once, turned to each angle
            dial = f"dials/{phase}/{lane.strength:g}/{lane.seed}"
            if dial not in dials:
                yield Job(dial, train_dial, _dial_run(config, lane), inputs, 2 * cost)
                dials.add(dial)
            inputs, cost = (dial,), 1.0
        yield Job(name, work, run, inputs, cost)
        looking = Evaluation(LAST, method.readouts, config.episodes)
        yield Job(f"evaluation/{name}", evaluate, looking, (name,), cost=6.0)


def lanes_of(
    config: Config, method: Method, strengths: Sequence[float], seeds: Sequence[int]
) -> list[Lane]:
    """A method that doesn't know the angle is trained once for each seed."""
    angles = config.development_angles if method.by_angle else config.development_angles[:1]
    return [Lane(a, strength, seed, 0) for a in angles for strength in strengths for seed in seeds]


def job_name(phase: str, method: Method, lane: Lane) -> str:
    """Folder of a training run."""
    return f"priors/{WORLD}/{phase}/{method.name}/{lane.strength:g}/{lane.angle:g}/{lane.seed}"


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
    for lane in lanes_of(config, method, strengths, seeds):
        folder = work / "evaluation" / job_name(phase, method, lane)
        for readout in method.readouts:
            metrics = load_episodes(folder / f"{readout}.safetensors").metrics()
            for angle in (lane.angle,) if method.by_angle else config.development_angles:
                label = {"world": WORLD, "method": method.name, "strength": lane.strength}
                label |= {"target_angle": angle, "readout": readout, "seed": lane.seed}
                worth = {"value": metrics.value(angle), "regret": "", "effective_share": ""}
                found.append(label | metrics._asdict() | worth)
    return found


Made = tuple[Callable[..., None], object]
"""What a job does, and its configuration."""


def _base(config: Config) -> iq.Structure:
    return dataclasses.replace(presets.INTERSECTION_CALIBRATED, updates=config.intersection_updates)


def _iq_learn(config: Config, method: Method, lane: Lane) -> Made:
    if method.target_kind == "advantage":  # no state is ever seen twice
        method = dataclasses.replace(method, target_kind="advantage_fitted")
    structure = structure_of(method, _base(config))
    numbers = numbers_of(RATES, lane)
    return train_learner, LearnerRun(structure, numbers, STUDY.mixture, STUDY.size)


def _clone(config: Config, method: Method, lane: Lane) -> Made:
    structure = clone_structure(_base(config), method.learner == "clone_weighted")
    modes = (nearest_mode(lane.angle),) if method.learner == "clone_of_mode" else tuple(MODES)
    numbers = clone_numbers(RATES, lane)
    return train_offline, OfflineRun(structure, numbers, modes, STUDY.mixture, STUDY.size)


def _conservative(config: Config, _method: Method, lane: Lane) -> Made:
    structure, numbers = cql_structure(_base(config)), cql_numbers(RATES, lane)
    return train_offline, OfflineRun(structure, numbers, tuple(MODES), STUDY.mixture, STUDY.size)


def _reinforcement(config: Config, _method: Method, lane: Lane) -> Made:
    """The experts' learner, at the budget of the other rows."""
    structure, numbers = rl_structure(_base(config)), rl_numbers(RATES, lane)
    return train_expert, ExpertRun(structure, numbers, checks=Checks(times=2))


def _dial(_config: Config, _method: Method, lane: Lane) -> Made:
    return turn, Turned(lane.angle)


def _dial_run(config: Config, lane: Lane) -> DialRun:
    base = _base(config)
    numbers = dial_numbers(RATES, lane)
    return DialRun(
        dial_structure(base), numbers, STUDY.mixture, STUDY.size, base.env_steps_per_update
    )


LEARNERS: dict[str, Callable[[Config, Method, Lane], Made]] = {
    "iq_learn": _iq_learn,
    "clone": _clone,
    "clone_of_mode": _clone,
    "clone_weighted": _clone,
    "cql": _conservative,
    "rl": _reinforcement,
    "dial": _dial,
}
"""By the name in `Method.learner`."""
