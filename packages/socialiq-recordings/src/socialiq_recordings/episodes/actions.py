"""Inference of the simulator's actions from a recorded driver's speeds."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int32

from socialiq.worlds.highway.core.vehicle import SPEED_GAIN
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.state import FASTER, IDLE, SLOWER


class Inferred(NamedTuple):
    """Inferred actions of a driver.

    Attributes:
        action: The closest action of each decision.
        residual: Speed at the next decision minus that predicted by the action, m/s.
    """

    action: Int32[np.ndarray, " decision"]
    residual: Float64[np.ndarray, " decision"]


def inferred(speed: Float64[np.ndarray, " decision_and_one"], options: Options) -> Inferred:
    """Infer the actions of a driver from the speeds at its decisions.

    Each action of the simulator sets a target speed, from which the speed one decision later
    follows. The action with the closest speed is taken, `idle` in a tie.
    `idle` keeps the target speed, which is not recorded: it is that of the previous action,
    initially the target nearest to the speed.

    Args:
        speed: Speed at every decision, and at the end of the last decision, m/s.
        options: Target speeds and frequencies.
    """
    targets = np.array(options.target_speeds)
    left = (1 - SPEED_GAIN / options.simulation_frequency) ** options.frames
    action = np.full(len(speed) - 1, IDLE, np.int32)
    residual = np.zeros(len(speed) - 1)
    target = targets[_nearest(speed[0], targets)]
    for decision, (now, then) in enumerate(itertools.pairwise(speed)):
        place = _nearest(now, targets)
        wanted = {
            IDLE: target,
            SLOWER: targets[max(place - 1, 0)],
            FASTER: targets[min(place + 1, len(targets) - 1)],
        }
        misses = {name: then - (aim + (now - aim) * left) for name, aim in wanted.items()}
        action[decision] = min(misses, key=lambda name: (round(abs(misses[name]), 9), name != IDLE))
        residual[decision] = misses[int(action[decision])]
        target = wanted[int(action[decision])]
    return Inferred(action, residual)


def _nearest(speed: float, targets: Float64[np.ndarray, " target"]) -> int:
    """Return the index of the simulator's present target speed (`core.ego.speed_index`)."""
    share = (speed - targets[0]) / (targets[-1] - targets[0])
    return int(np.clip(np.rint(share * (len(targets) - 1)), 0, len(targets) - 1))
