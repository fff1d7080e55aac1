"""Jobs of the study: train one of our methods on a task with several seeds, and evaluate."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gymnasium import spaces

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import concatenate
from socialiq.errors import UserError
from socialiq.evaluation.rollout import rollout_env
from socialiq.learners.continuous.standardise import EXPLORED
from socialiq.provenance import versions
from socialiq.storage import write_atomically
from socialiq_lab.jobs import ProgressCallback
from studies.mo_gymnasium import continuous, discrete
from studies.mo_gymnasium.tasks import ANGLES, FOLDER, TASKS, Piece, Task

DIAL, EXPERTS = "dial", "experts"
STANDARDISED, SHOWN_DIAL, TRIO = "dial, standardised", "dial from demonstrations", "IQ-Learn trio"
METHODS = (DIAL, STANDARDISED, EXPERTS, SHOWN_DIAL, TRIO)
"""Our methods. `experts` are three policies of 0, 45 and 90 degrees, each with a third of the
steps; the last two learn from episodes of such experts, whose steps count too. With continuous
actions, `STANDARDISED` first takes steps at random, by which its networks' inputs are scaled."""

EXPERT_ANGLES = (0.0, 45.0, 90.0)
SHOWN_EPISODES = 2
"""Episodes that each expert shows."""

LIBRARIES = ("socialiq", "mo-gymnasium", "gymnasium", "jax", "numpy")


@dataclass(frozen=True)
class Training:
    """Training of one method on a task with several seeds, in one program."""

    task: str
    method: str
    seeds: tuple[int, ...]
    steps: int


@dataclass(frozen=True)
class Made:
    """Trained policies of one seed.

    Attributes:
        policies: Dials with `at`, or a list of policies.
        steps: Taken in the environment.
        settings: Of the method.
    """

    policies: Any
    steps: int
    settings: dict[str, Any]


def train_and_evaluate(
    config: Training, folder: Path, _inputs: Mapping[str, Path], progress: ProgressCallback
) -> None:
    """Write one piece for each seed."""
    task = dataclasses.replace(TASKS[config.task], steps=config.steps)
    began = time.perf_counter()
    outcomes = trained(task, config.method, config.seeds)
    seconds = (time.perf_counter() - began) / len(outcomes)
    progress(0.8)
    for seed, outcome in zip(config.seeds, outcomes, strict=True):
        turned = not isinstance(outcome.policies, list)
        policies = [outcome.policies.at(angle) for angle in ANGLES] if turned else outcome.policies
        piece = Piece(
            task=config.task,
            method=config.method,
            seed=seed,
            steps=outcome.steps,
            evaluation_steps_while_training=0,
            angles=list(ANGLES) if turned else None,
            totals=[totals(task, policy) for policy in policies],
            settings=outcome.settings | {"allowed_steps": config.steps},
            seconds=round(seconds, 1),
            versions=versions(LIBRARIES),
        )
        (folder / FOLDER).mkdir(exist_ok=True)
        write_atomically(folder / FOLDER / piece.file, piece.content())


def totals(task: Task, policy: Any) -> list[float]:
    """Return the mean totals of both rewards over the evaluation's episodes."""
    rolled = rollout_env(task.make(), policy, task.episodes, task.first_episode)
    return [round(float(total.mean()), 6) for total in rolled.transitions.totals()]


def trained(task: Task, method: str, seeds: Sequence[int]) -> list[Made]:
    """Train a method within the task's steps.

    Raises:
        UserError: If the steps don't suffice for experts, their episodes and the dial, or for
            steps at random.
    """
    if method == DIAL:
        steps = _whole(task, task.steps)
        dials = _kind(task).train_dials(task, steps, seeds)
        return [Made(dial, steps, _settings(task)) for dial in dials]
    if method == STANDARDISED:
        own_steps = _whole(task, task.steps - EXPLORED)
        if own_steps <= 0:
            raise UserError(f"{task.steps} steps are too few: {EXPLORED} are taken at random")
        dials = continuous.train_standardised(task, own_steps, seeds)
        return [Made(dial, EXPLORED + own_steps, _settings(task)) for dial in dials]
    count = len(EXPERT_ANGLES)
    if method == EXPERTS:
        values = _whole(task, task.steps // count)
        trained_experts = experts(task, values, seeds)
        return [Made(trio, count * values, _settings(task)) for trio in trained_experts]
    return _from_demonstrations(task, method, seeds)


def _from_demonstrations(task: Task, method: str, seeds: Sequence[int]) -> list[Made]:
    """Train experts, let each show its episodes, and train the method on these.

    Of a trio the experts have all steps, of a dial half of them; a dial takes the rest itself.
    """
    count = len(EXPERT_ANGLES)
    reserved = count * SHOWN_EPISODES * task.time_limit()
    expert_steps = _whole(task, (task.steps - reserved) // (count if method == TRIO else 2 * count))
    if expert_steps <= 0:
        raise UserError(
            f"{task.steps} steps are too few for {method}: episodes of its experts take {reserved}"
        )
    result = experts(task, expert_steps, seeds)
    datasets = [
        demonstrations(task, *trio_and_seed) for trio_and_seed in zip(result, seeds, strict=True)
    ]
    taken = count * expert_steps + max(dataset.n_transitions for dataset in datasets)
    settings = _settings(task) | {
        "steps_of_an_expert": expert_steps,
        "episodes_shown": SHOWN_EPISODES,
    }
    if method == TRIO:
        trios = _kind(task).train_trio(task, datasets, seeds, EXPERT_ANGLES)
        return [Made(trio, taken, settings) for trio in trios]
    own_steps = _whole(task, task.steps - taken)
    dials = _kind(task).train_dials(task, own_steps, seeds, datasets)
    return [Made(dial, taken + own_steps, settings | {"own_steps": own_steps}) for dial in dials]


def experts(task: Task, steps: int, seeds: Sequence[int]) -> list[list[Any]]:
    """Return for each seed a policy of each angle, trained on R(α) alone."""
    if _kind(task) is continuous:
        return list(continuous.train_experts(task, steps, seeds, EXPERT_ANGLES))
    by_angle = [
        [dial.at(angle) for dial in discrete.train_dials(task, steps, seeds, only=angle)]
        for angle in EXPERT_ANGLES
    ]
    return [list(policies) for policies in zip(*by_angle, strict=True)]


def demonstrations(task: Task, policies: Sequence[Any], seed: int) -> Demonstrations:
    """Return the episodes that experts show, driven with their random actions."""
    episodes = []
    for angle, policy in zip(EXPERT_ANGLES, policies, strict=True):
        first = 1_000_000 + 1000 * seed + int(angle)
        mode = f"{angle:g} degrees"
        driven = rollout_env(task.make(), policy, SHOWN_EPISODES, first, False, mode)
        episodes.append(driven.transitions)
    return concatenate(episodes)


def _kind(task: Task) -> Any:
    """Return the module of the task's kind of actions."""
    return discrete if isinstance(task.make().action_space, spaces.Discrete) else continuous


def _whole(task: Task, steps: int) -> int:
    """Return as many steps as whole rounds have."""
    size = _kind(task).ROUND
    return steps // size * size


def _settings(task: Task) -> dict[str, Any]:
    """Return the settings that tasks have in common, as those of peers are written."""
    module = _kind(task)
    numbers = {
        name: value
        for name, value in dataclasses.asdict(module.NUMBERS).items()
        if name in ("learning_rate", "temperature", "polyak", "strength")
    }
    return numbers | {
        "hidden": list(task.hidden),
        "batch_size": task.batch_size,
        "discount": task.discount,
    }
