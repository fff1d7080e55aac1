"""Jobs of the study: training, recordings, and the inference of the demonstrators' angles.

Inference is the E-step of expectation-maximisation. The absolute angle is a gauge
(`learners.competence.angles`), fixed by the same conventions: directions have length 1, and what
demonstrators share is first assumed to be 0, so that the angles explain as much as they can. Then
a dial is trained with these angles, and they are inferred once more with it; the dial is not
trained again.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.special import log_softmax

from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import concatenate, equal_transitions
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.learners import behaviour_cloning as cloning
from socialiq.learners.dqn import config as dqn
from socialiq.learners.dqn.train import train as train_dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.storage import read_json, write_json
from socialiq.types import Policy
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq_lab.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    Recording,
    record_experts,
)
from socialiq_lab.intersection.episodes import DIAL, angle_file
from socialiq_lab.intersection.fitting import fit, sizes_of, soft_collector, source_of
from socialiq_lab.intersection.training import DialRun, fit_dial
from socialiq_lab.jobs import ProgressCallback
from studies.intersection_skill.skill import drive, with_skill

ANGLES = "angles.json"
TEMPERATURES = (0.03, 0.1, 0.3, 1.0)
"""τ of a demonstrator, which is unknown; the likeliest counts."""


@dataclass(frozen=True)
class DemonstratorRun:
    """A demonstrator: a DQN on R(α) + c h."""

    structure: dqn.StaticConfig
    numbers: dqn.Hyperparameters
    weight: float
    """c."""
    environments: int = 12
    options: Options = field(default_factory=Options)


def train_demonstrator(
    config: DemonstratorRun,
    folder: Path,
    _inputs: Mapping[str, Path],
    on_progress: ProgressCallback,
) -> None:
    """Write the policy of a demonstrator."""
    structure, numbers = config.structure, config.numbers
    source = source_of(config.options, config.environments, structure.steps_per_update)
    skilled = with_skill(source, config.weight, numbers.angle)
    train = partial(train_dqn, structure, [numbers], [skilled], sizes_of(config.options))
    fit(train, folder, on_progress, [angle_file(numbers.angle)])


def record_demonstrators(
    config: Recording, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Record each demonstrator, given in the order of the modes."""
    demonstrators = {
        mode: QPolicy.load(trained / angle_file(angle))
        for (mode, angle), trained in zip(MODES.items(), inputs.values(), strict=True)
    }
    record_experts(demonstrators, config, folder, on_progress)


def demonstrations(pools: Path, size: int, seed: int) -> dict[str, Demonstrations]:
    """Draw about so many transitions of each demonstrator, in whole episodes."""
    found = {}
    for mode in MODES:
        pool = {mode: files.load(pools / f"{mode}.safetensors")}
        found[mode] = equal_transitions(pool, size, seed)
    return found


@dataclass(frozen=True, kw_only=True)
class SkillDialRun(DialRun):
    """One dial; its inputs are the demonstrations, if it learns from them, and inferred angles."""

    weight: float
    """c of the score that checks measure; the dial is not rewarded for it."""


def train_family(
    config: SkillDialRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write a dial and its learning curve, which is of R(α) + c h."""
    structure = config.structure
    for trained in inputs.values():
        if (trained / ANGLES).is_file():
            angles = tuple(row["angle"] for row in read_json(trained / ANGLES))
            structure = dataclasses.replace(structure, demonstrators=angles)
    data: list[Demonstrations] = []
    if structure.demonstrations:
        drawn = demonstrations(inputs[DEMONSTRATIONS], config.size, config.numbers.seed)
        data = list(drawn.values())
        data = data if structure.demonstrators else [concatenate(data)]

    def value(batch: Batch, policy: Policy, seeds: np.ndarray, angle: float) -> float:
        return float(drive(batch, policy, seeds).score(angle, config.weight).mean())

    config = dataclasses.replace(config, structure=structure)
    fit_dial(config, data, value, folder, on_progress)


@dataclass(frozen=True)
class ReturnsRun:
    """The thesis' learner, one run for each angle, all in one program."""

    structure: iq.StaticConfig
    numbers: tuple[iq.Hyperparameters, ...]
    size: int
    environments: int = 12
    options: Options = field(default_factory=Options)


def train_returns(
    config: ReturnsRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write a policy for each angle."""
    structure, numbers = config.structure, config.numbers
    drawn = demonstrations(inputs[DEMONSTRATIONS], config.size, numbers[0].seed)
    steps = structure.env_steps_per_update
    collector = soft_collector(config.options, config.environments, steps, numbers)
    data = [concatenate(list(drawn.values()))]
    train = partial(train_iq, structure, numbers, data, before_chunk=collector)
    fit(train, folder, on_progress, [angle_file(one.angle) for one in numbers])


@dataclass(frozen=True)
class CloneRun:
    """A clone of each demonstrator."""

    structure: cloning.StaticConfig
    size: int
    seed: int


def train_clones(
    config: CloneRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write a policy for each demonstrated angle."""
    drawn = demonstrations(inputs[DEMONSTRATIONS], config.size, config.seed)
    numbers = [
        cloning.Hyperparameters(seed=config.seed, dataset=place) for place in range(len(MODES))
    ]
    train = partial(
        cloning.BehaviourCloning.train_on, config.structure, numbers, list(drawn.values())
    )
    fit(train, folder, on_progress, [angle_file(angle) for angle in MODES.values()])


@dataclass(frozen=True)
class Inference:
    """One E-step by one dial; the other input is the demonstrations."""

    size: int
    seed: int
    grid: int


def infer(
    config: Inference, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the likeliest angle of each demonstrator, and the likelihood of each angle."""
    drawn = demonstrations(inputs[DEMONSTRATIONS], config.size, config.seed)
    (trained,) = (path for name, path in inputs.items() if name != DEMONSTRATIONS)
    family = DialPolicy.load(trained / DIAL)
    angles = np.arange(family.low, family.high + 1e-9, config.grid)
    rows = []
    for number, (mode, true) in enumerate(MODES.items(), start=1):
        one = drawn[mode]
        logs = likelihood(family, one.observation, one.action, angles.tolist())
        rows.append(
            {"mode": mode, "true_angle": true, "angle": float(angles[int(logs.argmax())])}
            | {"log_likelihood": (logs / one.n_transitions).tolist()}
        )
        on_progress(number / len(MODES))
    write_json(folder / ANGLES, rows)


def likelihood(
    family: DialPolicy,
    observation: Float[np.ndarray, "step feature"],
    action: Int[np.ndarray, " step"],
    angles: Sequence[float],
) -> Float[np.ndarray, " angle"]:
    """Return the log-likelihood of a demonstrator's actions at each angle, at the best temperature.

    Args:
        family: Dial whose softmax(Q/τ) at an angle models a demonstrator of that angle.
        observation: Observations of the demonstrator.
        action: Its actions.
        angles: In degrees.
    """
    found, rows = [], np.arange(len(action))
    for angle in angles:
        q = family.at(angle).q_values(observation).astype(np.float64)
        logs = (log_softmax(q / one, axis=1) for one in TEMPERATURES)
        found.append(max(float(one[rows, action].sum()) for one in logs))
    return np.array(found)
