"""The intersection's options as the compiled core reads them."""

from __future__ import annotations

import numpy as np

from socialiq.worlds.highway import settings
from socialiq.worlds.intersection.options import (
    POPULATIONS,
    ContinuousOptions,
    Destination,
    Options,
)

TIE = 1e-9
"""Largest difference that counts as equal in canonical mode, m."""


def settings_of(options: Options) -> np.ndarray:
    """Return the SETTINGS record as an array of one element."""
    record = settings.settings_of(options)
    record["warm_up"] = 3 * options.simulation_frequency
    record["rule_period"] = int(1 / (1 / options.simulation_frequency) / 2)
    record["tie"] = TIE if options.canonical else 0.0
    record["initial_vehicle_count"] = options.initial_vehicle_count
    record["spawn_probability"] = options.spawn_probability
    record["destination"] = _ARMS[options.destination]
    record["connected_lanes"] = options.connected_lanes
    record["population"] = POPULATIONS[options.population]
    if isinstance(options, ContinuousOptions):
        record["offroad_terminal"] = options.offroad_terminal
    return record


_ARMS: dict[Destination, int] = {"random": 0, "left": 1, "straight": 2, "right": 3}
