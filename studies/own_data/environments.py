"""Environments of other makers with a reward pair, and the rules whose episodes are logged.

A rule takes observations, (n, feature), and returns n actions. Those of MO-Gymnasium need no more
than their rules: their two rewards are the pair.
"""

import warnings
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np

from socialiq import RewardPairWrapper


class Feeder(gymnasium.Env):
    """Two houses charge their cars at one feeder for twelve hours; the ego sets its own power."""

    action_space = gymnasium.spaces.Discrete(3)  # none, half, full power
    observation_space = gymnasium.spaces.Dict(
        charge=gymnasium.spaces.Box(0.0, 1.0, (2,), np.float32),
        hour=gymnasium.spaces.Discrete(12),
    )

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[dict, dict]:
        """Draw the charge of both cars."""
        super().reset(seed=seed, options=options)
        self.charge = self.np_random.uniform(0.0, 0.4, 2)
        self.gains = np.zeros(2)
        self.hour = 0
        return self.observation(), {}

    def step(self, action: int) -> tuple[dict[str, Any], float, bool, bool, dict]:
        """Charge for an hour: what both ask for, at most 1.2 in all."""
        powers = np.array([action / 2.0, float(self.charge[1] < 0.9)])
        served = powers * min(1.0, 1.2 / max(powers.sum(), 1.2e-9))
        charge = np.minimum(1.0, self.charge + 0.2 * served)
        self.gains = 5.0 * (charge - self.charge) - 0.3 * (1.0 - charge)
        self.charge = charge
        self.hour += 1
        return self.observation(), 0.0, self.hour == 12, False, {}

    def observation(self) -> dict[str, Any]:
        """Return the charge of both cars and the hour."""
        return {"charge": self.charge.astype(np.float32), "hour": min(self.hour, 11)}


def feeder() -> gymnasium.Env:
    """Return the feeder: r_env is the charge of the ego's car, r_social that of the other's."""

    def pair(step: Any) -> tuple[float, float]:
        own_gain, other_gain = step.env.unwrapped.gains
        return own_gain, other_gain

    return RewardPairWrapper(Feeder(), pair)


def greedy(observations: np.ndarray) -> Sequence[int]:
    """Charge at full power."""
    return [2 for _ in observations]


def polite(observations: np.ndarray) -> Sequence[int]:
    """Charge after the other car is full."""
    return [0 if row[1] < 0.9 else 2 for row in observations]


def cart() -> gymnasium.Env:
    """Return CartPole-v1 of 200 steps: the ego wants the cart at 1, its neighbour at -1."""

    def pair(step: Any) -> tuple[float, float]:
        position = float(step.next_observation[0])
        fall = 20.0 * step.terminated
        return 1.0 - (position - 1.0) ** 2 / 2 - fall, 1.0 - (position + 1.0) ** 2 / 2 - fall

    return RewardPairWrapper(gymnasium.make("CartPole-v1", max_episode_steps=200), pair)


def right(observations: np.ndarray) -> Sequence[int]:
    """Balance the pole, and bring the cart to 1."""
    return _balanced(observations, 1.0)


def left(observations: np.ndarray) -> Sequence[int]:
    """Balance the pole, and bring the cart to -1."""
    return _balanced(observations, -1.0)


def _balanced(observations: np.ndarray, target: float) -> Sequence[int]:
    position, speed, lean, turn = np.asarray(observations).T
    correction = np.clip(0.1 * (position - target) + 0.25 * speed, -0.5, 0.5)
    return [int(push > 0) for push in lean + 0.5 * turn + 0.6 * correction]


def cliff() -> gymnasium.Env:
    """Return CliffWalking-v1: steps and falls cost the ego, its tracks in two gardens others."""

    def pair(step: Any) -> tuple[float, float]:
        row = int(step.env.unwrapped.s) // 12
        return -0.1 - 2.0 * (step.reward < -1), {2: -0.3, 1: -0.1}.get(row, 0.0)

    limited = gymnasium.make("CliffWalking-v1", max_episode_steps=60)
    return RewardPairWrapper(limited, pair, lambda _: "arrival")


def edge(observations: np.ndarray) -> Sequence[int]:
    """Walk along the cliff, the shortest way."""
    return _walked(observations, 2)


def top(observations: np.ndarray) -> Sequence[int]:
    """Walk through the row without gardens."""
    return _walked(observations, 0)


def _walked(observations: np.ndarray, level: int) -> Sequence[int]:
    rows, columns = np.divmod(np.argmax(observations, axis=1), 12)
    onwards = np.where(rows > level, 0, 1)  # up, or to the right
    return np.where(columns == 11, 2, onwards).tolist()


def shallow(observations: np.ndarray) -> Sequence[int]:
    """Take the nearest treasure."""
    return _dived(observations, 0)


def middle(observations: np.ndarray) -> Sequence[int]:
    """Take the treasure in the sixth column."""
    return _dived(observations, 5)


def deep(observations: np.ndarray) -> Sequence[int]:
    """Take the farthest treasure."""
    return _dived(observations, 9)


def _dived(observations: np.ndarray, column: int) -> Sequence[int]:
    return [3 if row[1] < column else 1 for row in observations]


def fast(observations: np.ndarray) -> Sequence[int]:
    """Accelerate the car along its motion."""
    return [2 if row[1] >= 0 else 0 for row in observations]


def saving(observations: np.ndarray) -> Sequence[int]:
    """Accelerate so too, and coast once the car has the energy for the hill."""
    position, speed = np.asarray(observations).T
    energy = 0.0025 / 3 * (np.sin(3 * position) - np.sin(1.5)) + speed**2 / 2
    coasts = (energy > 0) & (speed > 0)
    return np.where(coasts, 1, np.where(speed >= 0, 2, 0)).tolist()


def merge() -> gymnasium.Env:
    """Return highway-env's merge-v0: the ego's speed, and that of the other vehicles."""

    def pair(step: Any) -> tuple[float, float]:
        ego = step.env.unwrapped.vehicle
        speeds = [v.speed for v in step.env.unwrapped.road.vehicles if v is not ego]
        crash = 5.0 * ego.crashed
        return (ego.speed - 20.0) / 10.0 - crash, (np.mean(speeds) - 28.0) / 5.0 - crash

    def ending(step: Any) -> str:
        return "collision" if step.env.unwrapped.vehicle.crashed else "arrival"

    with warnings.catch_warnings(action="ignore"):  # merge-v0 is the older of two
        road = gymnasium.make("highway_env:merge-v0", max_episode_steps=30)
    return RewardPairWrapper(road, pair, ending)


def accelerating(observations: np.ndarray) -> Sequence[int]:
    """Drive as fast as the road allows."""
    return [3 for _ in observations]


def braking(observations: np.ndarray) -> Sequence[int]:
    """Drive as slowly as the road allows."""
    return [4 for _ in observations]


def aside(observations: np.ndarray) -> Sequence[int]:
    """Leave the right lane to those who merge."""
    return [0 for _ in observations]
