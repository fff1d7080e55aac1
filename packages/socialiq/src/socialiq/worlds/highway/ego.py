"""Model of an ego: what its observation shows and what its actions do, as wrappers need it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from socialiq.worlds.highway.options import ACCELERATION_RANGE, MAX_SPEED, RoadOptions

POSITION_RANGE = 100.0  # m, seen as 1
SPEED_RANGE = 20.0  # m/s, seen as 1
"""Of the intersection and of recorded junctions."""

_USUAL = RoadOptions()


@dataclass(frozen=True)
class EgoModel:
    """Scales of an ego's observation and its speed control; by default those of the intersection.

    Actions are steps between the target speeds `speeds`. Of an ego that accelerates they are
    accelerations between the two speeds `speeds`; a single number in `changes` is then the
    acceleration at a continuous action of 1.
    """

    units: tuple[float, ...] = (POSITION_RANGE,) * 2 + (SPEED_RANGE,) * 2  # x, y, vx, vy seen as 1
    relative: bool = False  # whether rows of others are relative to the ego
    idle: int = 1  # action that changes nothing
    # of the number of the target speed, or m/s², by action
    changes: tuple[float, ...] = (-1.0, 0.0, 1.0)
    accelerates: bool = False
    # Whether a sub-step moves an ego that accelerates by the mean of its speeds, until it stands;
    # else a sub-step moves it first and changes its speed then.
    ballistic: bool = False
    speeds: tuple[float, ...] = _USUAL.target_speeds  # m/s
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
        steps = tuple(float(name == "faster") - float(name == "slower") for name in actions)
        return EgoModel(
            units=tuple(float(scale[name]) for name in ("x", "y", "vx", "vy")),
            relative=bool(scale["relative"]),
            idle=actions.index("idle"),
            changes=ACCELERATION_RANGE[1:] if options.continuous else steps,
            accelerates=options.continuous,
            speeds=(-MAX_SPEED, MAX_SPEED) if options.continuous else options.target_speeds,
            first=float(speeds[np.abs(speeds - entry).argmin()]),
            sub_step=1.0 / options.simulation_frequency,
            rate=options.policy_frequency,
            decisions=options.decisions,
            exit=exit,
        )

    @property
    def n_actions(self) -> int:
        """Number of actions; 0 where they are continuous, as `ActorPolicy.n_actions`."""
        return len(self.changes) if len(self.changes) > 1 else 0

    @property
    def per_second(self) -> np.ndarray:
        """Way in a second at a velocity of 1, x and y, in the units of velocity and position."""
        return np.array(self.units[2:]) / np.array(self.units[:2])
