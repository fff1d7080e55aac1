"""Drivers by rule: reference policies that read the observation and nothing else.

They answer like any `types.Policy`, so they drive the core, the real highway-env, or an audit.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int64

from socialiq.errors import one_of
from socialiq.worlds.intersection.interface import (
    ACTIONS,
    FASTER,
    FEATURES,
    IDLE,
    POSITION_RANGE,
    SLOWER,
    SPEED_RANGE,
)

STOP_LINE = 11.0  # m south of the centre
STOP_BEFORE = 11.0  # m before the stop line at which the stopper begins to brake
LOOK_FROM = 20.0  # m before the stop line from which gaps are judged
CONFLICT_REACH = 9.0  # m around the centre that a crossing vehicle must have left or not reached

Seen = Float[np.ndarray, "batch vehicle feature"]
Rule = Callable[[Seen], Int64[np.ndarray, " batch"]]


class RulePolicy:
    """A rule as a policy.

    Args:
        rule: From what is seen, shape (batch, vehicles, 7), in m and m/s, to actions.
    """

    def __init__(self, rule: Rule) -> None:
        self._rule = rule

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002  part of the protocol
        deterministic: bool = True,  # noqa: ARG002  part of the protocol
    ) -> tuple[np.ndarray, Any]:
        """Choose actions for one observation or a batch of them."""
        rows = np.atleast_2d(np.asarray(observation, np.float64))
        seen = rows.reshape(len(rows), -1, len(FEATURES)).copy()
        seen[..., 1:3] *= POSITION_RANGE
        seen[..., 3:5] *= SPEED_RANGE
        actions = self._rule(seen)
        return (actions if np.ndim(observation) > 1 else np.asarray(actions[0])), state


def go(seen: Seen) -> Int64[np.ndarray, " batch"]:
    """Always faster."""
    return np.full(len(seen), FASTER)


def wait(seen: Seen) -> Int64[np.ndarray, " batch"]:
    """Always slower."""
    return np.full(len(seen), SLOWER)


def idle(seen: Seen) -> Int64[np.ndarray, " batch"]:
    """Keep the target speed."""
    return np.full(len(seen), IDLE)


def stop_line(seen: Seen) -> Int64[np.ndarray, " batch"]:
    """Drive to 11 m before the stop line, then brake and stay."""
    return np.where(_to_stop_line(seen) > STOP_BEFORE, FASTER, SLOWER)


def gap(seconds: float) -> Rule:
    """Accept a gap: enter when nobody who crosses is within so many seconds of the junction.

    Args:
        seconds: The gap that is asked for.
    """

    def rule(seen: Seen) -> Int64[np.ndarray, " batch"]:
        distance = _to_stop_line(seen)
        judging = (distance > 0) & (distance <= LOOK_FROM)
        return np.where(judging & _conflict(seen, seconds).any(axis=1), SLOWER, FASTER)

    return rule


def random(seed: int) -> Rule:
    """Any action, drawn anew at each call."""
    rng = np.random.default_rng(seed)
    return lambda seen: rng.integers(len(ACTIONS), size=len(seen))


def policy(name: str, seed: int = 0) -> RulePolicy:
    """A reference policy by name.

    Args:
        name: One of `NAMES`.
        seed: Of the random one.

    Raises:
        UserError: If the name is unknown.
    """
    one_of("reference policy", name, NAMES)
    return RulePolicy(random(seed) if name == "random" else _RULES[name])


_RULES: dict[str, Rule] = {
    "go": go,
    "idle": idle,
    "wait": wait,
    "stop_line": stop_line,
    "gap_2s": gap(2.0),
    "gap_3s": gap(3.0),
    "gap_4s": gap(4.0),
}
NAMES = (*_RULES, "random")


def _to_stop_line(seen: Seen) -> Float[np.ndarray, " batch"]:
    """Metres that the ego has before its stop line; negative beyond."""
    return seen[:, 0, 2] - STOP_LINE


def _conflict(seen: Seen, seconds: float) -> Bool[np.ndarray, "batch other"]:
    """Which vehicles are in the junction, or will be there within some seconds at their speed."""
    x, y, vx, vy = (seen[:, 1:, number] for number in range(1, 5))
    there = seen[:, 1:, 0] > 0
    away = np.maximum(np.maximum(np.abs(x), np.abs(y)) - CONFLICT_REACH, 0.0)
    speed = np.hypot(vx, vy)
    approaching = x * vx + y * vy < 0
    soon = approaching & (away < seconds * np.maximum(speed, 0.1))
    behind = (np.abs(x - seen[:, :1, 1]) < 1.0) & (y > STOP_LINE)
    return there & ~behind & (soon | (away == 0))
