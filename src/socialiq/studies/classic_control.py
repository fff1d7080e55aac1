"""IQ-Learn on classic control from few transitions, an outside check of the learner.

This is not a claim of the thesis. The IQ-Learn paper (Garg et al. 2021, Fig 2) learns CartPole
offline from every 20th transition of one expert trajectory. The paper's expert files are no longer
public, so the experts here are the hand-written controllers below.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from matplotlib.figure import Figure

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.rollout import rollout_env
from socialiq.experiments.results import Results
from socialiq.experiments.study import Context, Findings, StageCallback, Study, view_of
from socialiq.experiments.tables import column, groups, matching, spread
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.iq_learn.config import Hyperparameters, StaticConfig
from socialiq.learners.iq_learn.train import train
from socialiq.nn.q_policy import QPolicy
from socialiq.plotting.style import figure, plain
from socialiq.types import Row


@dataclass(frozen=True)
class Controller:
    """A hand-written policy with the interface of `types.Policy`."""

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
    """An environment, its expert, and the subsampling of the expert's trajectories."""

    env: str
    expert: Controller
    trajectories: int
    every: int


def _feedback(*gains: float) -> Controller:
    """Return a controller that pushes right if the weighted state (x, x', θ, θ') is positive."""
    return Controller(lambda observation: int(observation @ np.array(gains) > 0))


TASKS = {
    "CartPole": Task("CartPole-v1", _feedback(0.05, 0.1, 1.0, 0.3), 1, 20),
    # This expert never corrects its position, so it drifts along the track and errors add up.
    "CartPole, drifting expert": Task("CartPole-v1", _feedback(0.0, 0.1, 1.0, 0.3), 1, 20),
    # Torque along the second link's motion pumps energy.
    "Acrobot": Task("Acrobot-v1", Controller(lambda o: 2 if o[5] > 0 else 0), 10, 5),
}
"""Tasks by name in the tables."""

# Settings of the IQ-Learn paper's discrete experiments: a near-greedy temperature, χ² on the
# expert, `value_expert`, the gradient through V(s').
STATIC = StaticConfig(
    prior="none",
    value_term="value_expert",
    next_value="online",
    online=False,
    activation="elu",
    batch_size=32,
    updates=10_000,
)
HYPERPARAMETERS = Hyperparameters(temperature=1e-3, learning_rate=1e-4)

_COLORS = {"iq_learn": "#2166ac", "behaviour_cloning": "#e08214"}


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    """Training seeds; 100 to 104 were used in development."""
    tasks: tuple[str, ...] = tuple(TASKS)
    """Names of `TASKS`."""
    episodes: int = 20
    """Evaluation episodes of each policy."""
    updates: int = STATIC.updates
    """Gradient steps of each learner."""
    data_seed: int = 0
    """Seed of the expert's episodes."""
    evaluation_seed: int = 1000
    """Seed of the first evaluation episode."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Learn each task offline, by IQ-Learn and by behaviour cloning, and roll out."""
    rows: list[Row] = []
    for name in config.tasks:
        rows += _task_rows(config, name, context.on_stage)
    return Findings({"returns": rows}, _summary(rows))


def _task_rows(config: Config, name: str, on_stage: StageCallback) -> list[Row]:
    task = TASKS[name]
    env = gymnasium.make(task.env)
    expert = rollout_env(env, task.expert, task.trajectories, config.data_seed).transitions
    data = expert.subsample(task.every)
    expert_return = float(expert.totals().env.mean())
    label = {"task": name, "transitions": data.n_transitions, "expert_return": expert_return}
    learned = {
        "iq_learn": _iq_learn(config, data, on_stage(f"{name}, IQ-Learn")),
        "behaviour_cloning": _clones(config, data, on_stage(f"{name}, behaviour cloning")),
    }
    rows: list[Row] = []
    for learner, policies in learned.items():
        for seed, policy in zip(config.seeds, policies, strict=True):
            rollout = rollout_env(env, policy, config.episodes, config.evaluation_seed)
            mean = float(rollout.transitions.totals().env.mean())
            rows.append(label | {"learner": learner, "seed": seed, "mean_return": mean})
    return rows


def _iq_learn(config: Config, data: Demonstrations, on_report: Any) -> list[QPolicy]:
    runs = [dataclasses.replace(HYPERPARAMETERS, seed=seed) for seed in config.seeds]
    static = dataclasses.replace(STATIC, updates=config.updates)
    trained = train(static, runs, [data], callbacks=Callbacks(on_report=on_report))
    return [trained.policy(run) for run in range(len(runs))]


def _clones(config: Config, data: Demonstrations, on_report: Any) -> list[QPolicy]:
    static = bc.StaticConfig(
        activation=STATIC.activation, batch_size=STATIC.batch_size, updates=config.updates
    )
    runs = [bc.Hyperparameters(learning_rate=1e-3, seed=seed) for seed in config.seeds]
    cloned = bc.BehaviourCloning.train_on(static, runs, [data], Callbacks(on_report=on_report))
    return [cloned.policy(run) for run in range(len(runs))]


def _summary(rows: list[Row]) -> dict[str, Any]:
    """Mean, least and greatest return over training seeds, by task and learner."""
    summary: dict[str, Any] = {}
    for (task, learner), group in groups(rows, "task", "learner").items():
        entry = summary.setdefault(task, {"expert": group[0]["expert_return"]})
        entry[learner] = spread(group, "mean_return") | {"seeds": len(group)}
    return summary


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw the mean return of each seed beside the expert's, in a panel for each task."""
    tasks = groups(results.tables["returns"], "task")
    drawn = figure(3.6 * len(tasks), 3.4)
    panels = drawn.subplots(1, len(tasks), squeeze=False)[0]
    for axes, ((task,), rows) in zip(panels, tasks.items(), strict=True):
        for place, (learner, color) in enumerate(_COLORS.items()):
            returns = column(matching(rows, learner=learner), "mean_return")
            axes.plot([place] * len(returns), returns, "o", color=color, alpha=0.7)
        axes.axhline(rows[0]["expert_return"], color="#999999", linestyle=":", label="expert")
        axes.set_xticks([0, 1], ["IQ-Learn", "cloning"])
        axes.set_xlim(-0.5, 1.5)
        axes.set_title(f"{task} ({rows[0]['transitions']} transitions)", fontsize=9)
        axes.set_ylabel("mean return")
        plain(axes)
    return {"returns": drawn}


STUDY = Study(
    name="classic-control",
    Config=Config,
    tables=compute_tables,
    figures=draw_figures,
    view=view_of("returns"),
)
