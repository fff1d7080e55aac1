"""Planted drivers: rules of different courtesy that see what a policy sees, and nothing else.

If another vehicle, at its present velocity, comes into the strip in front of the ego within some
seconds, the ego brakes or waits; otherwise it accelerates. The longer it looks, the more it yields.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int64

from socialiq.worlds.highway.options import FEATURES
from socialiq.worlds.intersection.options import POSITION_RANGE, SPEED_RANGE
from socialiq_recordings.world.recorded_world import RecordedWorld

_BRAKES = -2.0  # m/s²
_STANDS = 0.2  # m/s
_SIDE = 2.5  # m to either side of the ego's route
_BEHIND, _BEFORE, _MORE = 4.0, 8.0, 0.5  # m, m, s: the strip's length grows with the speed
_PASSED = 1.0  # m; others less far ahead are beside or behind
_EVERY = 0.5  # s between the moments looked at


def blocked(
    observation: Float[np.ndarray, "row feature"], seconds: float
) -> tuple[Bool[np.ndarray, " row"], Float[np.ndarray, " row"]]:
    """Return whether another vehicle comes into the strip before the ego in some seconds; m/s."""
    vehicles = observation.reshape(len(observation), -1, len(FEATURES))
    ego, neighbours = vehicles[:, 0], vehicles[:, 1:]
    speed = -ego[:, 4] * SPEED_RANGE
    ahead = (ego[:, None, 2] - neighbours[..., 2]) * POSITION_RANGE
    side = neighbours[..., 1] * POSITION_RANGE
    right, forward = neighbours[..., 3] * SPEED_RANGE, -neighbours[..., 4] * SPEED_RANGE
    met = np.zeros(len(vehicles), bool)
    for time in np.arange(0.0, seconds + 0.1, _EVERY):
        along = ahead + (forward - speed[:, None]) * time
        inside = (np.abs(side + right * time) < _SIDE) & (along > -_BEHIND)
        inside &= along < _BEFORE + _MORE * speed[:, None]
        met |= (inside & (neighbours[..., 0] > 0) & (ahead > _PASSED)).any(axis=1)
    return met, speed


@dataclass(frozen=True)
class Rule:
    """A planted driver."""

    name: str  # its name
    seconds: float  # how far it looks ahead
    acceleration: float  # on a free way, m/s²
    levels: tuple[float, ...]  # accelerations of the world's actions, m/s²

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002  part of the protocol
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[Int64[np.ndarray, " row"], Any]:
        """Return its actions."""
        met, speed = blocked(observation, self.seconds)
        brakes = np.where(speed > _STANDS, self._nearest(_BRAKES), self._nearest(0.0))
        return np.where(met, brakes, self._nearest(self.acceleration)), state

    def _nearest(self, rate: float) -> int:
        return int(np.argmin(np.abs(np.array(self.levels) - rate)))


def rules(world: RecordedWorld) -> list[Rule]:
    """Return the planted drivers, the least courteous first."""
    looking = ((0.5, 2.0), (1.5, 2.0), (3.0, 2.0), (5.0, 1.0))
    return [Rule(f"looks {s:g} s ahead", s, rate, world.config.levels) for s, rate in looking]
