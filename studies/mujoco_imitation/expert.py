"""The experts: soft actor-critic, the best of the checkpoints of one run."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.learners.callbacks import Callbacks
from socialiq.learners.continuous.config import SACConfig, SACHyperparameters
from socialiq.learners.continuous.sac import SoftActorCritic
from socialiq.learners.continuous.train import acting_in, train
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.q_network import network_of
from socialiq.storage import read_json, write_json
from socialiq_lab.jobs import ProgressCallback
from studies.mujoco_imitation.methods import ROUND
from studies.mujoco_imitation.tasks import TASKS, ExpertSettings, Task, make_env, returns

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
        SoftActorCritic,
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
        before_chunk=acting_in(lambda: make_env(task), static, runs),
    )
    checkpoint.unlink(missing_ok=True)
    record = read_json(folder / RECORD)
    expert = ActorPolicy.load(folder / POLICY)
    found = returns(task, expert, recipe.episodes, recipe.evaluation_seed)
    described = dataclasses.asdict(recipe)
    described |= described.pop("settings")
    write_json(folder / RECORD, record | {"recipe": described, "returns": found.tolist()})


def _judge(task: Task, recipe: Expert, folder: Path) -> Callable[[Any], dict[str, np.ndarray]]:
    """Return the monitor that keeps the best checkpoint and the mean return of each."""

    def judge(state: Any) -> dict[str, np.ndarray]:
        done = int(np.asarray(state.optimiser.count)[0])
        if done % recipe.every and done != recipe.settings.updates:
            return {}
        record = read_json(folder / RECORD) if (folder / RECORD).is_file() else {"checkpoints": []}
        past = [one for one in record["checkpoints"] if one["updates"] < done]
        policy = ActorPolicy.of(network_of(state.network.actor, 0), {})
        seed = recipe.judging_seed + len(past) * recipe.judged
        mean = float(returns(task, policy, recipe.judged, seed).mean())
        if mean > max((one["mean_return"] for one in past), default=-np.inf):
            policy.save(folder / POLICY)
        row = {"updates": done, "mean_return": mean}
        write_json(folder / RECORD, {"checkpoints": [*past, row]})
        return {}

    return judge
