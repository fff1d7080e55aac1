"""An outside check that the learner is an IQ-Learn: classic control from few transitions.

Not a claim of the thesis. The IQ-Learn paper (Garg et al. 2021, Fig 2) learns CartPole offline from
one expert trajectory of which every 20th transition is kept. The paper's own expert files are not
public any more, so the experts here are hand-written controllers, stated below.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.rollout import rollout_env
from socialiq.experiments.study import Context, Findings
from socialiq.experiments.tables import groups, spread
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.iq_learn.config import Hyperparameters, StaticConfig
from socialiq.learners.iq_learn.train import train
from socialiq.nn.q_policy import QPolicy
from socialiq.types import Row


@dataclass(frozen=True)
class Controller:
    """A hand-written policy of one observation, in the form of `types.Policy`."""

    act: Callable[[np.ndarray], int]

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[np.ndarray, Any]:
        """Choose the action for one observation."""
        return np.array(self.act(observation)), state


@dataclass(frozen=True)
class Task:
    """An environment, its expert, and how much of the expert is kept."""

    env: str
    expert: Controller
    trajectories: int
    every: int


def _feedback(*gains: float) -> Controller:
    """Push right when the weighted state (x, x', θ, θ') is positive."""
    return Controller(lambda observation: int(observation @ np.array(gains) > 0))


TASKS = {
    "CartPole": Task("CartPole-v1", _feedback(0.05, 0.1, 1.0, 0.3), 1, 20),
    # This expert never corrects its place, so it drifts along the track and errors add up.
    "CartPole, drifting expert": Task("CartPole-v1", _feedback(0.0, 0.1, 1.0, 0.3), 1, 20),
    # Torque along the second link's motion pumps energy.
    "Acrobot": Task("Acrobot-v1", Controller(lambda o: 2 if o[5] > 0 else 0), 10, 5),
}

# Settings of the IQ-Learn paper's discrete experiments: a near-greedy temperature, χ² on the
# expert, `value_expert`, the gradient through V(s').
STRUCTURE = StaticConfig(
    prior="none",
    value_term="value_expert",
    next_value="online",
    online=False,
    activation="elu",
    batch_size=32,
    updates=10_000,
)
NUMBERS = Hyperparameters(temperature=1e-3, learning_rate=1e-4)


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    """Training seeds; 100 to 104 were used in development."""
    tasks: tuple[str, ...] = tuple(TASKS)
    """Names of `TASKS`."""
    episodes: int = 20
    """Evaluation episodes of each policy."""
    updates: int = STRUCTURE.updates
    """Gradient steps of each learner."""
    data_seed: int = 0
    """Seed of the expert's episodes."""
    evaluation_seed: int = 1000
    """Seed of the first evaluation episode."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Learn each task offline, by IQ-Learn and by behaviour cloning, and roll out."""
    rows: list[Row] = []
    for name in config.tasks:
        task = TASKS[name]
        env = gymnasium.make(task.env)
        shown = rollout_env(env, task.expert, task.trajectories, config.data_seed).transitions
        kept = shown.subsample(task.every)
        expert_return = float(shown.totals().env.mean())
        label = {"task": name, "transitions": kept.n_transitions, "expert_return": expert_return}
        learners = {
            "iq_learn": _iq_learn(config, kept, context.on_stage(f"{name}, IQ-Learn")),
            "behaviour_cloning": _clones(
                config, kept, context.on_stage(f"{name}, behaviour cloning")
            ),
        }
        for learner, policies in learners.items():
            for seed, policy in zip(config.seeds, policies, strict=True):
                rollout = rollout_env(env, policy, config.episodes, config.evaluation_seed)
                mean = float(rollout.transitions.totals().env.mean())
                rows.append(label | {"learner": learner, "seed": seed, "mean_return": mean})
    tables = {"returns": rows}
    return Findings(tables, _summary(rows))


def _iq_learn(config: Config, data: Demonstrations, on_report: Any) -> list[QPolicy]:
    numbers = [dataclasses.replace(NUMBERS, seed=seed) for seed in config.seeds]
    structure = dataclasses.replace(STRUCTURE, updates=config.updates)
    trained = train(structure, numbers, [data], callbacks=Callbacks(on_report=on_report))
    return [trained.policy(run) for run in range(len(numbers))]


def _clones(config: Config, data: Demonstrations, on_report: Any) -> list[QPolicy]:
    structure = bc.StaticConfig(
        activation=STRUCTURE.activation,
        batch_size=STRUCTURE.batch_size,
        updates=config.updates,
    )
    numbers = [bc.Hyperparameters(learning_rate=1e-3, seed=seed) for seed in config.seeds]
    cloned = bc.clone(structure, numbers, [data], Callbacks(on_report=on_report))
    return [cloned.policy(run) for run in range(len(numbers))]


def _summary(rows: list[Row]) -> dict[str, Any]:
    """Mean, least and greatest return over training seeds, by task and learner."""
    found: dict[str, Any] = {}
    for (task, learner), group in groups(rows, "task", "learner").items():
        entry = found.setdefault(task, {"expert": group[0]["expert_return"]})
        entry[learner] = spread(group, "mean_return") | {"seeds": len(group)}
    return found
