"""Jobs of imitation: demonstrations of an expert, and the runs that learn from them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.variants import with_absorbing_states
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.acting import acting_in, drawing
from socialiq.learners.behaviour_cloning import GaussianCloning
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.collect import Collector, from_env
from socialiq.learners.continuous.config import SACConfig, SACHyperparameters
from socialiq.learners.continuous.standardise import Standardisation
from socialiq.learners.continuous.train import train
from socialiq.learners.kernel import Trained
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.q_network import network_of
from socialiq.storage import read_json, write_json
from socialiq.types import Row
from socialiq.worlds.wrapper import AbsorbingStates
from socialiq_lab.jobs import ProgressCallback
from studies.mujoco_imitation.methods import ROUND, Method, method_of
from studies.mujoco_imitation.tasks import TASKS, ExpertSettings, Task, make_env, played, returns

POLICY, RECORD = "expert.safetensors", "expert.json"


@dataclass(frozen=True)
class Expert:
    """Recipe of an expert.

    Attributes:
        task: Name in `TASKS`.
        seed: Of the training.
        settings: Of the training.
        every: Updates between two checkpoints.
        judged: Episodes by whose mean return the best checkpoint is chosen.
        judging_seed: Seed of the first of them; the next checkpoint has others.
        episodes: Episodes of the reported return.
        evaluation_seed: Seed of the first of these.
    """

    task: str
    seed: int
    settings: ExpertSettings
    every: int
    judged: int
    judging_seed: int
    episodes: int
    evaluation_seed: int


def train_expert(
    recipe: Expert, folder: Path, inputs: Mapping[str, Path], progress: ProgressCallback
) -> None:
    """Train; write the best checkpoint, and the returns of all.

    An interrupted training goes on from its last saved state.
    """
    del inputs
    task, checkpoint = TASKS[recipe.task], folder / "training.safetensors"
    settings = recipe.settings
    static = SACConfig(
        hidden=settings.hidden,
        batch_size=settings.batch_size,
        updates=settings.updates,
        schedule=settings.schedule,
        updates_per_round=min(ROUND, settings.updates),
        random_steps=5 * ROUND,
        replay_capacity=min(settings.updates, 300_000),
        tuned=True,
    )
    runs = [SACHyperparameters(seed=recipe.seed, learning_rate=settings.learning_rate)]
    env = make_env(task)
    assert env.observation_space.shape and env.action_space.shape
    train(
        static,
        runs,
        sizes=(env.observation_space.shape[0], env.action_space.shape[0]),
        callbacks=Callbacks(
            on_report=lambda report: progress(report.done / report.total),
            monitor=_judge(task, recipe, folder),
            checkpoint=checkpoint,
            resume=checkpoint.is_file(),
        ),
        chunk=static.updates_per_round,
        before_chunk=acting_in(lambda: make_env(task), static, runs, static.updates_per_round),
    )
    checkpoint.unlink(missing_ok=True)
    record = read_json(folder / RECORD)
    expert = ActorPolicy.load(folder / POLICY)
    episode_returns = returns(task, expert, recipe.episodes, recipe.evaluation_seed)
    described = dataclasses.asdict(recipe)
    described |= described.pop("settings")
    write_json(folder / RECORD, record | {"recipe": described, "returns": episode_returns.tolist()})


def _judge(task: Task, recipe: Expert, folder: Path) -> Callable[[Any], dict[str, np.ndarray]]:
    """Return the monitor that keeps the best checkpoint and the mean return of each."""

    def judge(state: Any) -> dict[str, np.ndarray]:
        done = int(np.asarray(state.optimiser.count)[0])
        if done % recipe.every and done != recipe.settings.updates:
            return {}
        record = read_json(folder / RECORD) if (folder / RECORD).is_file() else {"checkpoints": []}
        past = [checkpoint for checkpoint in record["checkpoints"] if checkpoint["updates"] < done]
        policy = ActorPolicy.of(network_of(state.network.actor, 0), {})
        seed = recipe.judging_seed + len(past) * recipe.judged
        mean = float(returns(task, policy, recipe.judged, seed).mean())
        if mean > max((entry["mean_return"] for entry in past), default=-np.inf):
            policy.save(folder / POLICY)
        row = {"updates": done, "mean_return": mean}
        write_json(folder / RECORD, {"checkpoints": [*past, row]})
        return {}

    return judge


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
    showing: Showing, folder: Path, inputs: Mapping[str, Path], progress: ProgressCallback
) -> None:
    """Write whole trajectories of the expert's mean actions."""
    (expert,) = inputs.values()
    policy = ActorPolicy.load(expert / POLICY)
    files.save(
        folder / SHOWN, played(TASKS[showing.task], policy, showing.trajectories, showing.seed)
    )
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
    datasets = [
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
    policies = learn(task, method, datasets, run.seeds, callbacks)
    for number, (seed, policy) in enumerate(zip(run.seeds, policies, strict=True)):
        policy = _without_mark(policy) if method.absorbing else policy
        episode_returns = returns(task, policy, run.episodes, run.evaluation_seed)
        write_json(
            folder / f"{seed}.json",
            {
                "task": run.task,
                "method": run.method,
                "trajectories": run.trajectories,
                "seed": seed,
                "updates": method.static.updates,
                "evaluation_seed": run.evaluation_seed,
                "demonstrated_return": float(datasets[number].totals().env.mean()),
                "returns": episode_returns.tolist(),
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
    default = (method.updates or task.online_updates) if method.online else method.static.updates
    updates = run.updates or default
    changes: dict[str, Any] = {"updates": updates}
    if method.online:
        changes["updates_per_round"] = min(ROUND, updates)
    return dataclasses.replace(method, static=dataclasses.replace(method.static, **changes))


def learn(
    task: Task,
    method: Method,
    datasets: Sequence[Demonstrations],
    seeds: Sequence[int],
    callbacks: Callbacks,
) -> list[ActorPolicy]:
    """Train a run for each seed, each on its own set, all in one program; return the policies."""
    if method.absorbing:
        datasets = [with_absorbing_states(dataset) for dataset in datasets]
    if not method.standardised:
        return _policies(_train(task, method, datasets, seeds, callbacks))
    unseen = () if method.forces else task.forces
    changes = [Standardisation.of(dataset.observation, unseen) for dataset in datasets]
    standardised = [
        change.transitions(entry) for change, entry in zip(changes, datasets, strict=True)
    ]
    trained = _train(task, method, standardised, seeds, callbacks, changes)
    return [
        change.policy(policy) for change, policy in zip(changes, _policies(trained), strict=True)
    ]


def _policies(trained: Trained) -> list[ActorPolicy]:
    return [trained.policy(run) for run in range(len(trained.hyperparameters))]


def _train(
    task: Task,
    method: Method,
    datasets: Sequence[Demonstrations],
    seeds: Sequence[int],
    callbacks: Callbacks,
    changes: Sequence[Standardisation] = (),
) -> Trained:
    """Train on demonstrations as the networks see them."""
    runs = [
        dataclasses.replace(method.numbers, seed=seed, dataset=number)
        for number, seed in enumerate(seeds)
    ]
    if isinstance(method.static, bc.CloningConfig):
        return GaussianCloning.train_on(method.static, runs, datasets, callbacks)

    def environment() -> gymnasium.Env[Any, Any]:
        env = make_env(task)
        return AbsorbingStates(env) if method.absorbing else env

    if not method.online:
        return train(method.static, runs, datasets, callbacks=callbacks)
    chunk = method.static.updates_per_round
    makers = [change.maker(environment) for change in changes] or [environment] * len(seeds)
    sources = [from_env(make(), chunk, continuous=True) for make in makers]
    collector = Collector(sources, seeds, drawing(method.static, 1))
    return train(
        method.static,
        runs,
        datasets,
        callbacks=callbacks,
        chunk=chunk,
        before_chunk=collector,
    )


def _without_mark(policy: ActorPolicy) -> ActorPolicy:
    """Return the policy of observations without the mark of absorbing states, which is 0."""
    first, *later = policy.weights
    return dataclasses.replace(policy, weights=(first[:, :-1], *later))


def row_of(piece: Mapping[str, Any]) -> Row:
    """Return the row of a piece in the table of runs."""
    episode_returns = np.array(piece["returns"])
    names = ("task", "trajectories", "method", "seed", "updates")
    return {name: piece[name] for name in names} | {
        "mean_return": float(episode_returns.mean()),
        "least_return": float(episode_returns.min()),
        "greatest_return": float(episode_returns.max()),
        "demonstrated_return": piece["demonstrated_return"],
    }
