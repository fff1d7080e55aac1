"""Tasks of MuJoCo: environments, budgets, and the published returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import gymnasium
import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.evaluation.rollout import rollout_env
from socialiq.types import Policy
from socialiq.worlds.environment import make_environment


@dataclass(frozen=True)
class ExpertSettings:
    """Settings of an expert's training, with a step in the environment for each update."""

    updates: int
    hidden: tuple[int, ...] = (64, 64)
    batch_size: int = 128
    learning_rate: float = 1e-3
    schedule: Literal["constant", "linear"] = "constant"


@dataclass(frozen=True)
class Task:
    """An environment, and what its policies take."""

    env: str
    expert: ExpertSettings
    online_updates: int
    published: float
    """Mean return of IQ-Learn online from one trajectory (Garg et al. 2021), of another expert."""
    forces: range = range(0)
    """Features that are contact forces."""


def _wide(updates: int) -> ExpertSettings:
    return ExpertSettings(updates, (128, 128), 256, 3e-4, "linear")


TASKS = {
    "Hopper": Task("Hopper-v5", ExpertSettings(300_000), 60_000, 3546.4),
    "HalfCheetah": Task("HalfCheetah-v5", ExpertSettings(300_000), 60_000, 5076.6),
    "Walker2d": Task("Walker2d-v5", _wide(600_000), 100_000, 5134.0),
    "Ant": Task("Ant-v5", _wide(1_000_000), 100_000, 4362.9, forces=range(27, 105)),
}
"""Tasks by name in the tables."""


def make_env(task: Task) -> gymnasium.Env[Any, Any]:
    """Make a task's environment, with actions in [-1, 1].

    Raises:
        UserError: If MuJoCo is not installed.
    """
    try:
        return make_environment(task.env, continuous=True)
    except UserError as error:
        if isinstance(error.__cause__, gymnasium.error.DependencyNotInstalled):
            raise UserError(
                f"{task.env} needs an extra: pip install 'socialiq-lab[mujoco]'"
            ) from error
        raise


def played(task: Task, policy: Policy, episodes: int, seed: int) -> Demonstrations:
    """Return episodes of a policy's mean actions; episode i is reset with seed + i."""
    return rollout_env(make_env(task), policy, episodes, seed).transitions


def returns(task: Task, policy: Policy, episodes: int, seed: int) -> np.ndarray:
    """Return the undiscounted return of each of some episodes of a policy's mean actions."""
    return np.asarray(played(task, policy, episodes, seed).totals().env, np.float64)
