"""Model of an ego: what its observation shows and what its actions do, as wrappers need it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from socialiq.worlds.highway.options import ACCELERATION_RANGE, RoadOptions

POSITION_RANGE = 100.0  # m, seen as 1
SPEED_RANGE = 20.0  # m/s, seen as 1
"""Of the intersection and of recorded junctions."""

_USUAL = RoadOptions()


@dataclass(frozen=True)
class EgoModel:
    """Scales of an ego's observation and its speed control; by default those of the intersection.

    Actions are steps of a target speed, of `speeds`, or continuous: their first value times
    `acceleration` is an acceleration. With neither they are something else.
    """

    units: tuple[float, ...] = (POSITION_RANGE,) * 2 + (SPEED_RANGE,) * 2  # x, y, vx, vy seen as 1
    relative: bool = False  # whether rows of others are relative to the ego
    idle: int = 1  # action that changes nothing
    changes: tuple[int, ...] = (-1, 0, 1)  # of the number of the target speed, by action
    speeds: tuple[float, ...] = _USUAL.target_speeds  # m/s
    acceleration: float = 0.0  # m/s² at a continuous action of 1; 0: they are discrete
    first: float = _USUAL.max_speed  # target speed at the begin of an episode, m/s
    sub_step: float = 1.0 / _USUAL.simulation_frequency  # s
    rate: int = _USUAL.policy_frequency  # decisions per second
    decisions: int = _USUAL.decisions  # of an episode that times out
    exit: str = "left"  # of its ways; "": there is one

    @staticmethod
    def of(
        options: RoadOptions,
        sight: np.ndarray,
        actions: Sequence[str],
        entry: float,
        exit: str = "",
    ) -> EgoModel:
        """Return the model of an ego of a road.

        Args:
            options: Options of the road.
            sight: SIGHT record in an array of one.
            actions: Names of the actions, of which "faster" and "slower" step the target speed.
            entry: Speed at which the ego enters, m/s.
            exit: Destination of the ego, where there are several ways.
        """
        scale: Any = sight[0]
        speeds = np.array(options.target_speeds)
        return EgoModel(
            units=tuple(float(scale[name]) for name in ("x", "y", "vx", "vy")),
            relative=bool(scale["relative"]),
            idle=actions.index("idle"),
            changes=tuple((name == "faster") - (name == "slower") for name in actions),
            speeds=() if options.continuous else options.target_speeds,
            acceleration=ACCELERATION_RANGE[1] if options.continuous else 0.0,
            first=float(speeds[np.abs(speeds - entry).argmin()]),
            sub_step=1.0 / options.simulation_frequency,
            rate=options.policy_frequency,
            decisions=options.decisions,
            exit=exit,
        )

    @property
    def per_second(self) -> np.ndarray:
        """Way in a second at a velocity of 1, x and y, in the units of velocity and position."""
        return np.array(self.units[2:]) / np.array(self.units[:2])
