"""Options as the compiled core reads them: one record of numbers."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np

from socialiq.worlds.highway.options import (
    MOST_SPEEDS,
    Counted,
    Crash,
    Disruption,
    RoadOptions,
    Zone,
)

SIGNALS = (
    "progress",
    "speed",
    "step",
    "collision",
    "arrival",
    "timeout",
    "yielding",
    "disruption",
    "neighbour_collision",
)
"""All signals, those of r_env first; a signal's weight is the option of that name."""

ENV_SIGNALS = SIGNALS[:6]
SOCIAL_SIGNALS = SIGNALS[6:]

SETTINGS = np.dtype(
    [
        ("dt", np.float64),  # s of a sub-step
        ("decision", np.float64),  # s between decisions
        ("duration", np.float64),
        ("frames", np.int64),  # sub-steps of a decision
        ("warm_up", np.int64),  # sub-steps before the ego enters
        ("rule_period", np.int64),  # sub-steps between applications of the road rules
        ("tie", np.float64),
        ("initial_vehicle_count", np.int64),
        ("spawn_probability", np.float64),
        ("destination", np.int64),  # arm; 0 draws one
        ("n_speeds", np.int64),
        ("target_speeds", np.float64, (MOST_SPEEDS,)),
        ("connected_lanes", np.bool_),
        ("population", np.float64, (5, 4)),
        ("progress_unit", np.float64),
        ("zone", np.int64),  # place in the option's list of names
        ("counted", np.int64),
        ("disruption", np.int64),
        ("crash", np.int64),
        ("conflict_distance", np.float64),
        ("max_speed", np.float64),
        ("speed_threshold", np.float64),
        ("speed_cap", np.float64),
        ("weights", np.float64, (len(SIGNALS),)),
        ("continuous", np.bool_),  # the ego's record holds its commands
        ("offroad_terminal", np.bool_),
    ],
    align=True,
)
"""Record of one set of options; from `warm_up` on some fields are of the intersection alone."""


def settings_of(options: RoadOptions) -> np.ndarray:
    """Return the record as an array of one element.

    What only the intersection has stays 0; `intersection.settings` writes it.
    """
    record = np.zeros(1, SETTINGS)
    for name in SETTINGS.names or ():
        if hasattr(RoadOptions, name) and name not in ("target_speeds", *_NAMED):
            record[name] = getattr(options, name)
    for name, kind in _NAMED.items():
        record[name] = get_args(kind).index(getattr(options, name))
    # highway-env divides in this order, and its rounding decides how many sub-steps fit.
    record["dt"] = 1 / options.simulation_frequency
    record["decision"] = 1 / options.policy_frequency
    record["n_speeds"] = len(options.target_speeds)
    record["target_speeds"][0, : len(options.target_speeds)] = options.target_speeds
    record["weights"] = [getattr(options, f"{name}_weight") for name in SIGNALS]
    return record


_NAMED = {"zone": Zone, "counted": Counted, "disruption": Disruption, "crash": Crash}


_UNITS = (
    "policy_frequency",  # rewards come with each decision
    "duration",
    "target_speeds",  # the fastest is what speeds are relative to
    "progress_unit",
    "zone",
    "counted",
    "disruption",
    "crash",
    "conflict_distance",
    "speed_threshold",
    "speed_cap",
)


def reward_definition(options: RoadOptions) -> dict[str, Any]:
    """Return the weights and units that define the reward pair of a road, as JSON."""
    sides = {"env": ENV_SIGNALS, "social": SOCIAL_SIGNALS}
    weights = {
        side: {name: getattr(options, f"{name}_weight") for name in signals}
        for side, signals in sides.items()
    }
    return weights | {"units": {name: getattr(options, name) for name in _UNITS}}
