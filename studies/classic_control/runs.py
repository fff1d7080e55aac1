"""Jobs of the study: one for each task, protocol and method, over all sets and seeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.variants import with_images
from socialiq.evaluation.rollout import rollout_env
from socialiq.learners.callbacks import Callbacks
from socialiq.nn.q_policy import QPolicy
from socialiq.storage import read_json, write_json
from socialiq.types import Row
from socialiq_lab.jobs import ProgressCallback
from studies.classic_control.methods import learn, method_of
from studies.classic_control.tasks import TASKS, Task, make_env, returns

PROTOCOLS = ("rows", "stride", "whole")
"""One random row of each block, the first row of each block, or all rows."""

_SHIFTS = range(2, 13)
_TRANSIENT = 100
_UNIT = 0.1
"""Common unit of the features in the linear fit."""


def trajectories(task: Task, count: int, seed: int) -> Demonstrations:
    """Return whole episodes of the task's expert; episode i is reset with seed + i."""
    return rollout_env(make_env(task), task.expert, count, seed).transitions


def thinned(
    episodes: Demonstrations, protocol: str, task: Task, seed: int, mirrored: bool
) -> Demonstrations:
    """Return what a learner is given of whole trajectories.

    Args:
        episodes: Whole trajectories.
        protocol: One of `PROTOCOLS`.
        task: Their task.
        seed: Seed of the random rows.
        mirrored: Whether every row's mirror image is given too.
    """
    rows = {
        "rows": lambda: episodes.one_of_each_block(task.every, seed),
        "stride": lambda: episodes.subsample(task.every),
        "whole": lambda: episodes,
    }[protocol]()
    return with_images(rows, task.symmetry) if mirrored else rows


def cycle(episodes: Demonstrations) -> tuple[int, float]:
    """Return the shift of 2 to 12 steps under which most actions stay equal, and their share.

    It is counted over the second half of the first trajectory, after the transient.
    """
    action = episodes.action[episodes.episode == 0]
    action = action[len(action) // 2 :]
    shares = {k: float(np.mean(action[k:] == action[:-k])) for k in _SHIFTS if k < len(action)}
    shift = max(shares, key=lambda entry: shares[entry])
    return shift, shares[shift]


def spread_kept(kept_rows: Demonstrations, episodes: Demonstrations) -> float:
    """Return the least share of a feature's standard deviation that the kept rows have.

    Near 0 the rows show one phase of the demonstrator's oscillation, and its reaction to that
    feature can hardly be identified. Rows of the first 100 steps, the transient, are left out.
    """
    kept_part, all_rows = (
        rows.observation[rows.step >= _TRANSIENT].std(axis=0) for rows in (kept_rows, episodes)
    )
    return float(np.min(kept_part / all_rows))


def linear_fit(data: Demonstrations, shrinkage: float) -> Float[np.ndarray, " feature"]:
    """Fit w of P(right) = logistic(w s) with penalty `shrinkage` |w|², for two actions.

    It is the class of CartPole's experts, without a constant: what is not identified here can't
    be identified in a larger class.
    """
    features = data.observation.astype(float) / _UNIT
    side = 2.0 * data.action - 1.0

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        margin = side * (features @ weights)
        wrong = 0.5 * (1.0 - np.tanh(0.5 * margin))  # the logistic function of -margin
        slope = -(side * wrong) @ features + 2.0 * shrinkage * weights
        return float(np.logaddexp(0.0, -margin).sum() + shrinkage * weights @ weights), slope

    return minimize(loss, np.zeros(features.shape[1]), jac=True, method="BFGS").x


ROWS = "rows.json"


@dataclass(frozen=True)
class Source:
    """Sets of demonstrations, each of trajectories of its own.

    Attributes:
        task: Name in `TASKS`.
        protocol: What is kept of a trajectory, one of `PROTOCOLS`.
        trajectories: Trajectories of a set.
        sets: Number of sets.
        seed: Seed of the first episode; set i begins at seed + i * trajectories.
        episodes: Evaluation episodes of each policy.
        evaluation_seed: Seed of the evaluation's first states.
    """

    task: str
    protocol: str
    trajectories: int
    sets: int
    seed: int
    episodes: int
    evaluation_seed: int

    def shown(self) -> list[Demonstrations]:
        """Return the whole trajectories of each set."""
        episodes = trajectories(TASKS[self.task], self.sets * self.trajectories, self.seed)
        sets = np.arange(episodes.n_episodes).reshape(self.sets, self.trajectories)
        return [episodes.select(chosen) for chosen in sets]

    def kept(self, episodes: Sequence[Demonstrations], mirrored: bool) -> list[Demonstrations]:
        """Return what learners are given of each set."""
        return [
            thinned(all_rows, self.protocol, TASKS[self.task], self.seed + number, mirrored)
            for number, all_rows in enumerate(episodes)
        ]

    def label(self) -> Row:
        """Return the columns that name it."""
        return {"task": self.task, "protocol": self.protocol, "trajectories": self.trajectories}

    def score(self, act: Callable[[np.ndarray], np.ndarray]) -> float:
        """Return the mean return of a policy."""
        task = TASKS[self.task]
        return float(returns(task, act, self.episodes, self.evaluation_seed).mean())


@dataclass(frozen=True)
class Training:
    """Training of one method on every set, with every training seed."""

    source: Source
    method: str
    seeds: tuple[int, ...]
    updates: int


def train_and_score(
    run: Training, folder: Path, inputs: Mapping[str, Path], progress: ProgressCallback
) -> None:
    """Write what `scored` returns."""
    del inputs
    write_json(folder / ROWS, scored(run, progress))


def scored(run: Training, progress: ProgressCallback) -> list[Row]:
    """Train; return the mean return of each policy and of each set's ensemble."""
    source, method = run.source, method_of(run.method)
    episodes = source.shown()
    sets = source.kept(episodes, method.mirrored)
    report = Callbacks(
        on_report=lambda progress_report: progress(progress_report.done / progress_report.total)
    )
    trained = learn(TASKS[source.task], method, sets, run.seeds, run.updates, report)
    rows: list[Row] = []
    for index, rows_of_set in enumerate(sets):
        first = index * len(run.seeds)
        policies = [trained.policy(first + number) for number in range(len(run.seeds))]
        label = source.label() | {
            "method": run.method,
            "set": index,
            "rows": rows_of_set.n_transitions,
        }
        rows += [
            label | {"seed": str(seed), "mean_return": source.score(_greedy([policy]))}
            for seed, policy in zip(run.seeds, policies, strict=True)
        ]
        rows.append(label | {"seed": "ensemble", "mean_return": source.score(_greedy(policies))})
    return rows


def _greedy(policies: Sequence[QPolicy]) -> Callable[[np.ndarray], np.ndarray]:
    """Return the greedy choice by the mean of the policies' advantages Q - mean Q."""

    def act(observations: np.ndarray) -> np.ndarray:
        values = [policy.q_values(observations) for policy in policies]
        return np.mean([q - q.mean(axis=1, keepdims=True) for q in values], axis=0).argmax(axis=1)

    return act


@dataclass(frozen=True)
class Inspection:
    """A look at the sets themselves, without a learner."""

    source: Source
    shrinkages: tuple[float, ...]


def inspect(
    run: Inspection, folder: Path, inputs: Mapping[str, Path], progress: ProgressCallback
) -> None:
    """Write what `inspected` returns."""
    del inputs
    write_json(folder / ROWS, inspected(run))
    progress(1.0)


def inspected(run: Inspection) -> list[Row]:
    """Return each set's expert return, and of CartPole cycle, spread and linear fits' returns."""
    source, task = run.source, TASKS[run.source.task]
    episodes = source.shown()
    rows: list[Row] = []
    for number, (all_rows, rows_of_set) in enumerate(
        zip(episodes, source.kept(episodes, False), strict=True)
    ):
        row = source.label() | {"set": number, "rows": rows_of_set.n_transitions}
        row["expert_return"] = float(all_rows.totals().env.mean())
        if task.env == "CartPole-v1":
            row |= _phase(all_rows, rows_of_set) | _fits(source, rows_of_set, run.shrinkages)
        rows.append(row)
    return rows


def _phase(all_rows: Demonstrations, rows: Demonstrations) -> Row:
    shift, share = cycle(all_rows)
    return {"cycle": shift, "equal": share, "spread_kept": spread_kept(rows, all_rows)}


def _fits(source: Source, rows: Demonstrations, shrinkages: Sequence[float]) -> Row:
    fits: Row = {}
    for shrinkage in shrinkages:
        weights = linear_fit(rows, shrinkage)

        def act(observation: np.ndarray, weights: np.ndarray = weights) -> np.ndarray:
            return (observation @ weights > 0).astype(int)

        fits[f"linear_{shrinkage:g}"] = source.score(act)
    return fits


def read_rows(folder: Path) -> list[Any]:
    """Return what a job wrote."""
    return read_json(folder / ROWS)
