"""Named features of the situation, and the policy of a dial whose angle is a rule of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Float64, Int64, Shaped

from socialiq.errors import UserError, one_of
from socialiq.nn.dial_policy import DialPolicy, check_in_range
from socialiq.nn.q_policy import ValuePolicy, checked_batch
from socialiq.nn.saved import Arrays, Header
from socialiq.social.angle_rule import AngleRule
from socialiq.worlds import crossing5, crossing7
from socialiq.worlds.catalogue import GRIDS
from socialiq.worlds.highway.options import FEATURES
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.registry import make_grid

Seen = Shaped[np.ndarray, "row feature"]

TIME = "decisions"
"""Feature of worlds whose policies may have a clock: decisions since the start."""

_NEAR = 30.0  # m
_STANDING = 1.0  # m/s
_SOON = 3.0  # s, as `evaluation.episodes.CONFLICT_SECONDS`
_PERCEPTION = 200.0  # m; nothing farther is observed
Rows = Float64[np.ndarray, " row"]


class Feature(NamedTuple):
    """Named feature of a situation."""

    meaning: str  # description with its unit
    # function from the observed values to a number for each row
    of: Callable[[np.ndarray], np.ndarray]


def _before(state: np.ndarray) -> np.ndarray:
    """Whether each slot of the 7x7 world has a vehicle south of the conflict cell."""
    rows = state[:, [2, 4]]
    return (rows >= 0) & (rows < crossing7.CONFLICT)


def _nearest_cells(state: np.ndarray) -> np.ndarray:
    cells = np.where(_before(state), crossing7.CONFLICT - state[:, [2, 4]], crossing7.SIZE)
    return cells.min(axis=1)


_CROSSING5 = {
    "approaching": Feature(
        "1 while the other road user is before the conflict cell, else 0",
        lambda state: state[:, 3] < crossing5.CONFLICT,
    ),
    "cells_to_conflict": Feature(
        "cells from the ego to the conflict cell; negative beyond it",
        lambda state: crossing5.CONFLICT - state[:, 0],
    ),
}

_CROSSING7 = {
    "approaching": Feature(
        "vehicles before the conflict cell", lambda state: _before(state).sum(axis=1)
    ),
    "waiting": Feature(
        "vehicles before the conflict cell that stand",
        lambda state: (_before(state) & (state[:, [3, 5]] == crossing7.STOP)).sum(axis=1),
    ),
    "vehicles": Feature(
        "vehicles on the road", lambda state: (state[:, [2, 4]] != crossing7.ABSENT).sum(axis=1)
    ),
    "nearest_cells": Feature(
        "cells from the nearest approaching vehicle to the conflict cell; 7 if there is none",
        _nearest_cells,
    ),
    "cells_to_conflict": Feature(
        "cells from the ego to the conflict cell; negative beyond it",
        lambda state: crossing7.CONFLICT - state[:, 0],
    ),
    "ego_speed": Feature("the ego's speed in cells a step", lambda state: state[:, 1]),
}


def _others(vehicles: np.ndarray) -> np.ndarray:
    """Whether each row after the ego's is a vehicle in view."""
    return vehicles[:, 1:, 0] > 0


def _distance(vehicles: np.ndarray) -> np.ndarray:
    """Metres from the ego to each other vehicle; the range of perception where there is none."""
    away = np.hypot(
        vehicles[:, 1:, 1] - vehicles[:, :1, 1], vehicles[:, 1:, 2] - vehicles[:, :1, 2]
    )
    return np.where(_others(vehicles), away, _PERCEPTION)


def _waiting(vehicles: np.ndarray) -> np.ndarray:
    slow = np.hypot(vehicles[:, 1:, 3], vehicles[:, 1:, 4]) < _STANDING
    return (_others(vehicles) & slow & (_distance(vehicles) <= _NEAR)).sum(axis=1)


def _nearest_on_the_left(vehicles: np.ndarray) -> np.ndarray:
    cos = vehicles[:, :1, 5]
    sin = vehicles[:, :1, 6]
    x, y = (vehicles[:, 1:, column] - vehicles[:, :1, column] for column in (1, 2))
    leftwards = x * sin - y * cos  # the axis y points to the right of x
    nearest = _distance(vehicles).argmin(axis=1)[:, None]
    left = _others(vehicles) & (leftwards > 0.0)
    return np.take_along_axis(left, nearest, axis=1)[:, 0]


def _with_priority(vehicles: np.ndarray) -> np.ndarray:
    other_road = np.abs(vehicles[:, 1:, 5]) > np.abs(vehicles[:, 1:, 6])
    return (policies.conflict(vehicles, _SOON) & other_road).sum(axis=1)


_INTERSECTION = {
    "vehicles": Feature("other vehicles in view", lambda vehicles: _others(vehicles).sum(axis=1)),
    "vehicles_within_30m": Feature(
        "other vehicles within 30 m of the ego",
        lambda vehicles: (_others(vehicles) & (_distance(vehicles) <= _NEAR)).sum(axis=1),
    ),
    "waiting": Feature("other vehicles within 30 m of the ego, slower than 1 m/s", _waiting),
    "crossing": Feature(
        "crossing vehicles in the junction, or there within 3 s",
        lambda vehicles: policies.conflict(vehicles, _SOON).sum(axis=1),
    ),
    "crossing_with_priority": Feature(
        "those of them on the other road, which has priority over the ego's", _with_priority
    ),
    "nearest_metres": Feature(
        "metres to the nearest vehicle in view; 200 if there is none",
        lambda vehicles: _distance(vehicles).min(axis=1),
    ),
    "nearest_on_the_left": Feature(
        "1 if the nearest vehicle in view is on the ego's left, else 0", _nearest_on_the_left
    ),
    "metres_to_stop_line": Feature(
        "metres from the ego to its stop line; negative beyond it",
        lambda vehicles: vehicles[:, 0, 2] - policies.STOP_LINE,
    ),
    "ego_speed": Feature(
        "the ego's speed in m/s", lambda vehicles: np.hypot(vehicles[:, 0, 3], vehicles[:, 0, 4])
    ),
}

SITUATIONS: dict[str, dict[str, Feature]] = {
    "crossing5": _CROSSING5,
    "crossing7": _CROSSING7,
    "intersection": _INTERSECTION,
}
"""Features by world and name. The intersection has `TIME` besides, for policies with a clock."""

TIMED = ("intersection",)
"""Worlds in which `TIME` is a feature. The exact optima of a gridworld need rewards without it."""


def check_rule(rule: AngleRule, world: str = "", clock: bool = True) -> None:
    """Check that a rule reads features of its world.

    Args:
        rule: Rule to check.
        world: Name of the world in which it is to be used; "": any.
        clock: Whether the policy observes the time; without a clock the rule must not read it.

    Raises:
        UserError: If the rule's world or a feature is unknown, the rule belongs to another world,
            or it reads the time without a clock.
    """
    one_of("world of a rule", rule.world, tuple(SITUATIONS))
    features = (*SITUATIONS[rule.world], *((TIME,) if rule.world in TIMED else ()))
    for name in rule.features:
        one_of(f"feature of {rule.world}", name, features)
    if world and rule.world != world:
        raise UserError(f"the rule is for {rule.world}, not for {world}: change its world")
    if TIME in rule.features and not clock:
        raise UserError(f"the rule reads {TIME}, and this policy has no clock: leave it out")


def plain_features(world: str) -> int:
    """Return the length of an observation of a world without the time."""
    if world in GRIDS:
        return make_grid(world).n_features
    return Options().observed_vehicles * len(FEATURES)


def features_of(
    rule: AngleRule, observation: Seen, time: Shaped[np.ndarray, " row"] | None = None
) -> dict[str, Rows]:
    """Return the features that a rule reads of observations of its world.

    Args:
        rule: A rule that `check_rule` accepts.
        observation: Observations without the time, (row, feature).
        time: Decisions since the start of each row; needed only if the rule reads the time.

    Returns:
        Each feature by its name, float64 (row,).
    """
    values = np.asarray(observation, np.float64)
    if rule.world == "intersection":
        values = policies.in_metres(np.asarray(observation))
    columns = {}
    for name in rule.features:
        # `check_rule` refuses the time without a clock.
        value = time if name == TIME else SITUATIONS[rule.world][name].of(values)
        columns[name] = np.asarray(value, np.float64)
    return columns


def angles_of(
    rule: AngleRule, observation: Seen, time: Shaped[np.ndarray, " row"] | None = None
) -> tuple[Rows, Int64[np.ndarray, " row"]]:
    """Return a rule's angle, and the number of the context, of each observation.

    Args:
        rule: A rule that `check_rule` accepts.
        observation: Observations without the time, (row, feature).
        time: Decisions since the start of each row; needed only if the rule reads the time.

    Returns:
        The angles in degrees, and the numbers of the contexts.
    """
    features = features_of(rule, observation, time)
    rows = len(observation)
    return rule.degrees(features, rows), rule.context(features, rows)


@dataclass(frozen=True, repr=False)
class ContextPolicy(ValuePolicy):
    """Policy that acts at each observation as the dial does at the rule's angle for it.

    It decides as if the angle stayed as it is now; it doesn't foresee that the situation, and with
    it the angle, will change (`evaluation.context`).
    """

    KIND = "context-policy"

    dial: DialPolicy
    rule: AngleRule
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    sha256: str = ""  # of the file's content, for a policy that was loaded

    @classmethod
    def of(cls, dial: DialPolicy, rule: AngleRule) -> ContextPolicy:
        """Join a dial and a rule.

        Args:
            dial: Dial of the rule's world, with or without a clock.
            rule: Rule whose angles lie in the dial's range.

        Raises:
            UserError: If the rule reads an unknown feature, the dial belongs to another world, or
                an angle is outside the dial's range.
        """
        policy = cls(dial, rule)
        check_rule(rule)
        plain = plain_features(rule.world)
        if dial.n_features not in (plain, plain + 1):
            raise UserError(
                f"the dial takes {dial.n_features} features, {rule.world} has {plain} (one more "
                "with a clock): name a dial of the rule's world"
            )
        check_rule(rule, clock=policy.clock)
        for angle in rule.span:
            check_in_range(angle, dial.low, dial.high)
        return policy

    @property
    def clock(self) -> bool:
        """Whether the time is the last feature of an observation."""
        return self.dial.n_features == plain_features(self.rule.world) + 1

    @property
    def temperature(self) -> float:  # pyright: ignore[reportIncompatibleVariableOverride]
        """τ of the stochastic policy softmax(Q/τ), the dial's."""
        return self.dial.turned.temperature

    @property
    def provenance(self) -> Mapping[str, Any]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """JSON-compatible record of how the policy was made."""
        return {**self.dial.provenance, "rule": self.rule.as_json()}

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return self.dial.n_features

    @property
    def n_actions(self) -> int:
        """Number of actions."""
        return self.dial.n_actions

    def angles(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> tuple[Float64[np.ndarray, " batch"], Int64[np.ndarray, " batch"]]:
        """Return the rule's angle in degrees and the number of the context, by observation."""
        batch = checked_batch(observations, self.n_features)
        if self.clock:
            return angles_of(self.rule, batch[:, :-1], batch[:, -1])
        return angles_of(self.rule, batch)

    def q_values(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Return the dial's Q of each observation and action at the rule's angle."""
        return self.dial.q_values_at(observations, self.angles(observations)[0])

    def content(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return the named arrays and the header of the file: the dial's, and the rule."""
        arrays, header = self.dial.content()
        return arrays, header | {"rule": self.rule.as_json()}

    @classmethod
    def checked(cls, path: Path, arrays: Arrays, header: Header) -> ContextPolicy:
        """Build a policy from a file's content, as `Saved.checked`.

        Args:
            path: Path of the file, for messages.
            arrays: The dial's arrays.
            header: The dial's header, with the rule under `rule`.

        Raises:
            UserError: If the dial or the rule is invalid, or they don't fit each other.
        """
        dial = DialPolicy.checked(path, arrays, header)
        try:
            policy = cls.of(dial, AngleRule.of(header.get("rule")))
        except UserError as error:
            raise UserError(f"{path}: {error}") from error
        return replace(policy, sha256=str(header["sha256"]))
