"""Tasks of MO-Gymnasium, read from tasks.toml, and the exact front of a deterministic one."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.mdp.front import AttainableSet, attainable_set
from socialiq.mdp.tabular import TabularMDP
from socialiq.types import Ending, RewardPair
from socialiq.worlds.environment import make_environment

ANGLES = tuple(float(angle) for angle in range(0, 91, 5))
"""Angles at which every policy is evaluated, in degrees."""


@dataclass(frozen=True)
class Task:
    """A two-objective task, and what all methods have in common there.

    Attributes:
        env: Id that `mo_gymnasium` registers.
        steps: Steps in the environment that a method may take, those of its experts included.
        reference: Reference point of the hypervolume.
        discount: γ of the learners; totals are not discounted.
        hidden: Widths of the hidden layers of networks.
        batch_size: Transitions of an update.
        episodes: Evaluation episodes of each policy.
        first_episode: Seed of the first one.
        peers: Methods of morl-baselines that are run on it.
        exact: Whether it is finite and deterministic, so that its exact front is computed.
        continuous: Whether its actions are arrays of numbers.
        options: Keyword arguments of the environment.
    """

    env: str
    steps: int
    reference: tuple[float, float]
    discount: float
    hidden: tuple[int, ...]
    batch_size: int
    episodes: int
    first_episode: int
    peers: tuple[str, ...]
    exact: bool = False
    continuous: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)

    def make(self) -> gymnasium.Env[Any, Any]:
        """Make the environment, whose vector reward is the pair.

        Raises:
            UserError: If MO-Gymnasium, or MuJoCo for a task that needs it, isn't installed.
        """
        try:
            return make_environment(
                f"mo_gymnasium:{self.env}",
                self.options,
                allow_code=True,
                needs_pair=True,
                continuous=True,
            )
        except UserError as error:
            raise UserError(
                f"{self.env} needs pip install 'socialiq[mo]', and of the tasks of MuJoCo "
                f"'socialiq[mujoco]': {one_line(str(error))}"
            ) from error

    def time_limit(self) -> int:
        """Return after how many steps an episode is cut off."""
        spec = self.make().spec
        if spec is None or spec.max_episode_steps is None:
            raise UserError(f"{self.env} has no time limit: episodes may not end")
        return spec.max_episode_steps


def _tasks() -> dict[str, Task]:
    content = Path(__file__).with_name("tasks.toml").read_text()
    found = {}
    for name, row in tomllib.loads(content).items():
        made: Any = {key: tuple(one) if isinstance(one, list) else one for key, one in row.items()}
        found[name] = Task(**made)
    return found


TASKS = _tasks()
"""Tasks by name."""


def enumerated(env: gymnasium.Env[Any, Any]) -> TabularMDP:
    """Return the finite MDP of deep-sea-treasure: its states are `current_state`.

    From the first state on, every action is tried in every state that is found, breadth first.

    Args:
        env: With a reward pair, discrete actions and deterministic steps.
    """
    inner: Any = env.unwrapped
    env.reset(seed=0)
    found = {tuple(inner.current_state.tolist()): 0}
    waiting, rows = list(found), list[list[tuple[int, int, float, float]]]()
    count = int(inner.action_space.n)
    while waiting:
        state = waiting.pop(0)
        rows.append([])
        for action in range(count):
            env.reset()
            inner.current_state = np.array(state, np.int32)
            _, _, ended, _, info = env.step(action)
            reached = state if ended else tuple(inner.current_state.tolist())
            if reached not in found:
                found[reached] = len(found)
                waiting.append(reached)
            kind = Ending.OTHER if ended else Ending.NONE
            first, second = info["reward_pair"]
            rows[-1].append((found[reached], int(kind), float(first), float(second)))
    successor, ending, first, second = np.moveaxis(np.array(rows), 2, 0)
    return TabularMDP(
        successor=successor.astype(np.int64)[..., None],
        probability=np.ones((*successor.shape, 1)),
        ending=ending.astype(np.int64)[..., None],
        rewards=RewardPair(first, second),
        initial=np.eye(len(rows))[0],
    )


@cache
def exact_set(name: str) -> AttainableSet:
    """Return the attainable set of a finite task within its time limit."""
    task = TASKS[name]
    return attainable_set(enumerated(task.make()), task.time_limit())


def known_front(name: str) -> Float[np.ndarray, "point 2"]:
    """Return the front that MO-Gymnasium publishes for a task: all non-dominated totals."""
    inner: Any = TASKS[name].make().unwrapped
    return np.array(inner.pareto_front(gamma=1.0), np.float64)
