"""Tasks of classic control: environments, hand-written experts and mirror symmetries."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from jaxtyping import Array, Float, Int, PRNGKeyArray

from socialiq import Ending, RewardPair, UserError
from socialiq.demonstrations.variants import Symmetry
from socialiq.types import Step


@dataclass(frozen=True)
class Controller:
    """A hand-written policy with the interface of `types.Policy`; `act` takes a batch."""

    act: Callable[[np.ndarray], np.ndarray]

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[np.ndarray, Any]:
        """Choose the action for one observation, or one for each of a batch."""
        actions = self.act(np.atleast_2d(observation))
        return (actions if np.ndim(observation) == 2 else np.asarray(actions[0])), state


@dataclass(frozen=True)
class Task:
    """An environment, its expert, and what is declared about it."""

    env: str
    expert: Controller
    every: int  # length of the blocks, and the stride, by which its trajectories are thinned
    symmetry: Symmetry
    input_scale: float = 1.0  # one over the typical size of a feature


def _balance(*gains: float) -> Task:
    """Return CartPole of an expert that pushes right if the weighted (x, x', θ, θ') is positive."""
    expert = Controller(lambda observations: (observations @ np.array(gains) > 0).astype(int))
    return Task("CartPole-v1", expert, 20, Symmetry((-1, -1, -1, -1), (1, 0)), 10.0)


def _pump(observations: np.ndarray) -> np.ndarray:
    """Turn along the second link's motion, which adds energy (Acrobot)."""
    return np.where(observations[:, 5] > 0, 2, 0)


def _land(observations: np.ndarray) -> np.ndarray:
    """Lean against the offset and the drift, and sink at a speed that falls with the height."""
    x, y, x_speed, y_speed, angle, turning, left_leg, right_leg = observations.T
    lean = np.clip(0.5 * x + x_speed, -0.4, 0.4)
    turn = 0.5 * (lean - angle) - 0.8 * turning
    too_fast = np.maximum(-y_speed - (0.5 * y + 0.1), 0.0)
    turn = np.where((left_leg + right_leg) > 0, 0.0, turn)
    sideways = np.where(turn > 0.05, 1, np.where(turn < -0.05, 3, 0))
    flying = np.where((too_fast > 0.03) & (too_fast > 0.5 * np.abs(turn)), 2, sideways)
    standing = np.where(y_speed < -0.1, 2, 0)
    return np.where((left_leg * right_leg) > 0, standing, flying)


TASKS = {
    "CartPole": _balance(0.05, 0.1, 1.0, 0.3),
    # This expert never corrects its position, so it drifts along the track and errors add up.
    "CartPole, drifting expert": _balance(0.0, 0.1, 1.0, 0.3),
    "Acrobot": Task(
        "Acrobot-v1", Controller(_pump), 5, Symmetry((1, -1, 1, -1, -1, -1), (2, 1, 0))
    ),
    # Needs the optional extra `box2d`.
    "LunarLander": Task(
        "LunarLander-v3",
        Controller(_land),
        20,
        Symmetry((-1, 1, -1, 1, -1, -1, 1, 1), (0, 3, 2, 1), (0, 1, 2, 3, 4, 5, 7, 6)),
    ),
}
"""Tasks by name in the tables."""


def make_env(task: Task) -> gymnasium.Env[Any, Any]:
    """Make a task's environment; `UserError` if its library isn't installed."""
    try:
        return gymnasium.make(task.env)
    except gymnasium.error.DependencyNotInstalled as error:
        raise UserError(
            f"{task.env} needs an extra: pip install 'socialiq-lab[box2d]' (or leave the task out)"
        ) from error


def returns(
    task: Task, act: Callable[[np.ndarray], np.ndarray], episodes: int, seed: int
) -> np.ndarray:
    """Return the undiscounted returns of episodes side by side, from the first states of a seed."""
    if gymnasium.spec(task.env).vector_entry_point is not None:  # in one array
        envs = gymnasium.make_vec(task.env, episodes, vectorization_mode="vector_entry_point")
    else:
        makers = [lambda: make_env(task)] * episodes
        envs = SyncVectorEnv(makers, autoreset_mode=AutoresetMode.NEXT_STEP)
    observation, _ = envs.reset(seed=seed)
    total, running = np.zeros(episodes), np.ones(episodes, bool)
    while running.any():
        observation, reward, terminated, truncated, _ = envs.step(act(observation))
        total += np.where(running, reward, 0.0)
        running &= ~(terminated | truncated)
    envs.close()
    return total


GRAVITY, CART, POLE, HALF_LENGTH = 9.8, 1.0, 0.1, 0.5  # m/s², kg, kg, m
FORCE, SECONDS = 10.0, 0.02
TRACK, LEAN = 2.4, 0.2094395
"""Largest |x| in m and |θ| in radians (12 degrees) of an episode that goes on."""
STEPS = 500


class Episode(NamedTuple):
    """State (x, x', θ, θ') and number of steps taken."""

    state: Float[Array, " state"]
    steps: Int[Array, ""]


def moved(state: Float[Array, " state"], action: Int[Array, ""]) -> Float[Array, " state"]:
    """Return the state after one Euler step under a push to the left (0) or right (1)."""
    _, x_speed, angle, turning = state
    force = jnp.where(action == 1, FORCE, -FORCE)
    total = CART + POLE
    cosine, sine = jnp.cos(angle), jnp.sin(angle)
    pushed = (force + POLE * HALF_LENGTH * jnp.square(turning) * sine) / total
    inertia = HALF_LENGTH * (4.0 / 3.0 - POLE * jnp.square(cosine) / total)
    turn_rate = (GRAVITY * sine - cosine * pushed) / inertia
    x_rate = pushed - POLE * HALF_LENGTH * turn_rate * cosine / total
    return state + SECONDS * jnp.stack([x_speed, x_rate, turning, turn_rate])


class CartPole:
    """CartPole-v1 with the interface of `types.Simulator`; r_env is 1 a step, r_social 0."""

    n_actions = 2
    n_features = 4
    description = "CartPole-v1, compiled"

    def reset(self, key: PRNGKeyArray) -> tuple[Episode, Float[Array, " state"]]:
        """Start an episode near the upright state."""
        state = jax.random.uniform(key, (4,), minval=-0.05, maxval=0.05)
        return Episode(state, jnp.zeros((), jnp.int32)), state

    def advance(
        self,
        key: Any,  # noqa: ARG002
        episode: Episode,
        action: Int[Array, ""],
    ) -> tuple[Episode, Step]:
        """Take one step; falling and leaving the track end in `OTHER`, the clock in `TIMEOUT`."""
        state, steps = moved(episode.state, action), episode.steps + 1
        lost = (jnp.abs(state[0]) > TRACK) | (jnp.abs(state[2]) > LEAN)
        late = jnp.where(steps >= STEPS, int(Ending.TIMEOUT), int(Ending.NONE))
        ending = jnp.where(lost, int(Ending.OTHER), late).astype(jnp.int32)
        return Episode(state, steps), Step(state, RewardPair(jnp.ones(()), jnp.zeros(())), ending)
