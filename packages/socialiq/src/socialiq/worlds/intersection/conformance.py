"""Comparison of the core with the real highway-env: same seeds, same actions, every field."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.types import Ending, Policy
from socialiq.worlds.highway import Compared
from socialiq.worlds.intersection.options import VEHICLE, Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Batch

POLICIES = ("go", "idle", "wait", "random")  # in turn, by episode

DISCRETE = tuple(
    name for name in VEHICLE.names or () if not np.issubdtype(VEHICLE[name], np.floating)
)
CONTINUOUS = tuple(name for name in VEHICLE.names or () if name not in DISCRETE)


def compare(
    options: Options, episodes: int, seed: int, driver: Policy | None = None
) -> Iterator[Compared]:
    """Run seeded episodes on the core and on highway-env, and compare after every decision.

    Args:
        options: The scenario.
        episodes: Number of episodes.
        seed: Seed of the first episode; episode i has seed + i.
        driver: Policy of the ego; by default `driver_of_turn`.

    Raises:
        UserError: If `episodes` is below 1, or highway-env is not installed.
    """
    if episodes < 1:
        raise UserError(f"episodes must be at least 1, got {episodes}")
    core, real = Batch(options, 1), Batch(options, 1, back_end="highway_env")
    for number in range(episodes):
        turn = driver_of_turn(number, seed + number, options)
        yield _episode(core, real, driver or turn, seed + number)


def driver_of_turn(number: int, seed: int, options: Options) -> Policy:
    """Return one of the drivers that a comparison takes in turn.

    They are go, idle, wait and random. Continuous actions are drawn: full acceleration without
    steering; acceleration at random with little steering, in float32 and in float64; all at random.

    Args:
        number: Number of the episode.
        seed: Seed of its actions.
        options: Scenario.
    """
    turn = number % len(POLICIES)
    if not options.continuous:
        return policy(POLICIES[turn], seed)
    least, steering, kind = _DRAWN[turn]
    return RandomValues(options.width, least, steering, kind, seed)


_DRAWN = (
    (1.0, 0.0, np.float32),
    (-0.3, 0.1, np.float32),
    (-1.0, 0.1, np.float64),
    (-1.0, 1.0, np.float32),
)
"""Least acceleration, most steering and type of the actions of each turn."""


class RandomValues:
    """Continuous actions at random.

    Args:
        values: Number of values: 1, or 2 with steering.
        least: Least acceleration; the most is 1.
        steering: Most steering to either side.
        kind: Type of the actions, float32 or float64.
        seed: Seed of the draws.
    """

    def __init__(
        self, values: int, least: float, steering: float, kind: type[np.floating], seed: int
    ) -> None:
        self._high = np.array([1.0, steering])[:values]
        self._low = np.array([least, -steering])[:values]
        self._kind, self._rng = kind, np.random.default_rng(seed)

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002  part of the protocol
        deterministic: bool = True,  # noqa: ARG002  part of the protocol
    ) -> tuple[np.ndarray, Any]:
        """Draw an action for each observation."""
        rows = len(observation)
        values = self._rng.uniform(self._low, self._high, (rows, len(self._low)))
        return values.astype(self._kind), state


def _episode(core: Batch, real: Batch, driver: Policy, seed: int) -> Compared:
    observation = core.reset([seed])
    worst = np.array([0.0, np.abs(real.reset([seed]) - observation).max(), 0.0])
    steps, left, going = 0, False, _same(core, real)
    if going:
        worst[0] = _deviation(core, real)
    while going:
        action, _ = driver.predict(core.seen_by(driver))
        ours, real_step = core.step(action, auto_reset=False), real.step(action, auto_reset=False)
        steps, left = steps + 1, left or bool(ours.off_road[0])
        ended_alike = (
            ours.ending[0] == real_step.ending[0] and ours.contact[0] == real_step.contact[0]
        )
        if not (ended_alike and _same(core, real)):
            return Compared(seed, steps, 1, *worst.tolist(), off_road=left)
        deviation = np.abs(ours.observation - real_step.observation).max()
        paid = np.abs(np.subtract(ours.rewards, real_step.rewards)).max()
        worst = np.maximum(worst, [_deviation(core, real), deviation, paid])
        going = int(ours.ending[0]) == Ending.NONE
    return Compared(seed, steps, int(steps == 0), *worst.tolist(), off_road=left)


def _present(batch: Batch) -> np.ndarray:
    return batch.buffers.vehicles[0, : int(batch.buffers.episodes[0]["vehicles"])]


def _same(core: Batch, real: Batch) -> bool:
    """Whether both have the same vehicles in the same order with the same lanes and flags."""
    ours, real_vehicles = _present(core), _present(real)
    if len(ours) != len(real_vehicles):
        return False
    return all(np.array_equal(ours[name], real_vehicles[name]) for name in DISCRETE)


def _deviation(core: Batch, real: Batch) -> float:
    ours, real_vehicles = _present(core), _present(real)
    return max(
        float(np.abs(_finite(ours[name]) - _finite(real_vehicles[name])).max())
        for name in CONTINUOUS
    )


def _finite(values: np.ndarray) -> np.ndarray:
    """Replace infinite desired speeds, equal on both sides, so that their difference is 0."""
    return np.where(np.isinf(values), 1e300, values)
