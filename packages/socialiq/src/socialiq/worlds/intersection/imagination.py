"""States consistent with an ego's observation, for online planning."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, UInt64

from socialiq.worlds.highway.episodes import State
from socialiq.worlds.highway.state import EPISODE, FEATURES
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.settings import settings_of
from socialiq.worlds.intersection.state import VEHICLE


def imagined(
    options: Options,
    observations: Float32[np.ndarray, "row feature"],
    entropy: UInt64[np.ndarray, " row"],
) -> State:
    """Draw one state for each observation, consistent with it.

    The destinations and parameters of the other vehicles and the later traffic are drawn. Other
    unobserved quantities take their most likely value: there is no vehicle beyond the rows of the
    observation, no vehicle has crashed, the ego's target speed is the nearest to its speed, and
    the time limit is not reached.

    Args:
        options: Scenario that the driver assumes.
        observations: Observations, `observed_vehicles` rows of seven numbers, flat.
        entropy: Seed of each draw. The same seed and observation give the same state.
    """
    # Numba is imported only when it is needed.
    from socialiq.worlds.highway.core.compile import run_in_parts
    from socialiq.worlds.intersection.core import imagine

    rows = len(observations)
    rows_seen = np.ascontiguousarray(observations.reshape(rows, -1, len(FEATURES)))
    episodes = np.zeros(rows, EPISODE)
    vehicles = np.zeros((rows, options.capacity), VEHICLE)
    arguments = rows_seen, entropy, episodes, vehicles, settings_of(options)
    run_in_parts(imagine.run, 0, rows, *arguments)
    return State(episodes, vehicles, rows_seen, np.zeros(rows, bool))
