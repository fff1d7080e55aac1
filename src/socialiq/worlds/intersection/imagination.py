"""States of the intersection that fit what an ego sees, so that a driver can think ahead."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, UInt64

from socialiq.worlds.intersection.batch import State
from socialiq.worlds.intersection.interface import FEATURES
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.settings import settings_of
from socialiq.worlds.intersection.state import EPISODE, VEHICLE


def imagined(
    options: Options,
    observations: Float32[np.ndarray, "row feature"],
    entropy: UInt64[np.ndarray, " row"],
) -> State:
    """One state for each observation, drawn among those that would be seen so.

    Drawn are where the others go, their parameters and the traffic to come. What else isn't seen
    is taken for the likeliest: nobody is beyond the rows of the observation, nobody has crashed,
    the ego wants the speed nearest to its own, and there is time enough.

    Args:
        options: The scenario that the driver believes to be in.
        observations: What it sees, `observed_vehicles` rows of seven numbers, flat.
        entropy: Seed of each draw: the same seed and observation give the same state.
    """
    from socialiq.worlds.intersection.core import imagine  # Numba loads when it is needed

    rows = len(observations)
    seen = np.ascontiguousarray(observations.reshape(rows, -1, len(FEATURES)))
    episodes = np.zeros(rows, EPISODE)
    vehicles = np.zeros((rows, options.capacity), VEHICLE)
    imagine.run(seen, entropy, episodes, vehicles, settings_of(options))
    return State(episodes, vehicles, seen, np.zeros(rows, bool))
