"""Jobs of imitation: demonstrations of an expert, and the runs that learn from them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from socialiq.demonstrations import files
from socialiq.demonstrations.absorbing import with_absorbing_states
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.collect import Collector, from_env
from socialiq.learners.continuous.acting import drawing
from socialiq.learners.continuous.behaviour_cloning import BehaviourCloning
from socialiq.learners.continuous.iq_learn import ContinuousIQLearn
from socialiq.learners.continuous.standardise import Standardisation
from socialiq.learners.continuous.train import train
from socialiq.learners.kernel import Trained
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.storage import write_json
from socialiq.types import Row
from socialiq.worlds.wrapper import AbsorbingStates
from socialiq_lab.jobs import ProgressCallback
from studies.mujoco_imitation.expert import POLICY
from studies.mujoco_imitation.methods import ROUND, Method, method_of
from studies.mujoco_imitation.tasks import TASKS, Task, make_env, played, returns

SHOWN = "shown.safetensors"


@dataclass(frozen=True)
class Showing:
    """Trajectories of an expert: the set of one imitation seed.

    Attributes:
        task: Name in `TASKS`.
        trajectories: How many.
        seed: Seed of the first one.
    """

    task: str
    trajectories: int
    seed: int


def show(
    wanted: Showing, folder: Path, inputs: Mapping[str, Path], progress: ProgressCallback
) -> None:
    """Write whole trajectories of the expert's mean actions."""
    (expert,) = inputs.values()
    policy = ActorPolicy.load(expert / POLICY)
    files.save(folder / SHOWN, played(TASKS[wanted.task], policy, wanted.trajectories, wanted.seed))
    progress(1.0)


@dataclass(frozen=True)
class Imitation:
    """Training of one method on one number of trajectories, with some seeds in one program.

    Attributes:
        task: Name in `TASKS`.
        method: Name in `METHODS` or `VARIANTS`.
        trajectories: Of a set of demonstrations.
        seeds: Of the training; each has a set of its own, the inputs in this order.
        updates: Of each run; 0 for those of the method.
        episodes: Evaluation episodes of each policy.
        evaluation_seed: Seed of the first one.
    """

    task: str
    method: str
    trajectories: int
    seeds: tuple[int, ...]
    updates: int
    episodes: int
    evaluation_seed: int


def imitate(
    run: Imitation, folder: Path, inputs: Mapping[str, Path], progress: ProgressCallback
) -> None:
    """Train and write the piece of each seed; an interrupted training goes on."""
    task = TASKS[run.task]
    shown = [
        files.load(path / SHOWN, continuous=True).select(np.arange(run.trajectories))
        for path in inputs.values()
    ]
    checkpoint = folder / "training.safetensors"
    callbacks = Callbacks(
        on_report=lambda report: progress(report.done / report.total),
        checkpoint=checkpoint,
        resume=checkpoint.is_file(),
    )
    method = settled(run, task)
    policies = learn(task, method, shown, run.seeds, callbacks)
    for place, (seed, policy) in enumerate(zip(run.seeds, policies, strict=True)):
        policy = _without_mark(policy) if method.absorbing else policy
        found = returns(task, policy, run.episodes, run.evaluation_seed)
        write_json(
            folder / f"{seed}.json",
            {
                "task": run.task,
                "method": run.method,
                "trajectories": run.trajectories,
                "seed": seed,
                "updates": method.static.updates,
                "evaluation_seed": run.evaluation_seed,
                "demonstrated_return": float(shown[place].totals().env.mean()),
                "returns": found.tolist(),
                "record": _record(policy),
            },
        )
    checkpoint.unlink(missing_ok=True)


def _record(policy: ActorPolicy) -> dict[str, Any]:
    """Return a policy's provenance; of a standardisation only that it is there."""
    changed = {"standardised": True} if "standardised" in policy.provenance else {}
    return {**policy.provenance, **changed}


def settled(run: Imitation, task: Task) -> Method:
    """Return a run's method with its updates: the given ones, its own, or online the task's."""
    method = method_of(run.method)
    own = (method.updates or task.online_updates) if method.online else method.static.updates
    updates = run.updates or own
    changes: dict[str, Any] = {"updates": updates}
    if method.online:
        changes["updates_per_round"] = min(ROUND, updates)
    return dataclasses.replace(method, static=dataclasses.replace(method.static, **changes))


def learn(
    task: Task,
    method: Method,
    shown: Sequence[Demonstrations],
    seeds: Sequence[int],
    callbacks: Callbacks,
) -> list[ActorPolicy]:
    """Train a run for each seed, each on its own set, all in one program; return the policies."""
    if method.absorbing:
        shown = [with_absorbing_states(one) for one in shown]
    if not method.standardised:
        return _policies(_train(task, method, shown, seeds, callbacks))
    unseen = () if method.forces else task.forces
    changes = [Standardisation.of(one.observation, unseen) for one in shown]
    seen = [change.transitions(one) for change, one in zip(changes, shown, strict=True)]
    trained = _train(task, method, seen, seeds, callbacks, changes)
    return [change.actor(one) for change, one in zip(changes, _policies(trained), strict=True)]


def _policies(trained: Trained) -> list[ActorPolicy]:
    return [trained.policy(run) for run in range(len(trained.hyperparameters))]


def _train(
    task: Task,
    method: Method,
    shown: Sequence[Demonstrations],
    seeds: Sequence[int],
    callbacks: Callbacks,
    changes: Sequence[Standardisation] = (),
) -> Trained:
    """Train on demonstrations as the networks see them."""
    runs = [
        dataclasses.replace(method.numbers, seed=seed, dataset=place)
        for place, seed in enumerate(seeds)
    ]
    if isinstance(method.static, bc.CloningConfig):
        return BehaviourCloning.train_on(method.static, runs, shown, callbacks)

    def environment() -> gymnasium.Env[Any, Any]:
        env = make_env(task)
        return AbsorbingStates(env) if method.absorbing else env

    if not method.online:
        return train(ContinuousIQLearn, method.static, runs, shown, callbacks=callbacks)
    chunk = method.static.updates_per_round
    makers = [one.maker(environment) for one in changes] or [environment] * len(seeds)
    sources = [from_env(make(), chunk, continuous=True) for make in makers]
    collector = Collector(sources, seeds, drawing(method.static, 1))
    return train(
        ContinuousIQLearn,
        method.static,
        runs,
        shown,
        callbacks=callbacks,
        chunk=chunk,
        before_chunk=collector,
    )


def _without_mark(policy: ActorPolicy) -> ActorPolicy:
    """Return the policy of observations without the mark of absorbing states, which is 0."""
    first, *others = policy.weights
    return dataclasses.replace(policy, weights=(first[:, :-1], *others))


def row_of(piece: Mapping[str, Any]) -> Row:
    """Return the row of a piece in the table of runs."""
    found = np.array(piece["returns"])
    names = ("task", "trajectories", "method", "seed", "updates")
    return {name: piece[name] for name in names} | {
        "mean_return": float(found.mean()),
        "least_return": float(found.min()),
        "greatest_return": float(found.max()),
        "demonstrated_return": piece["demonstrated_return"],
    }
