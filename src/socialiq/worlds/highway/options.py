"""Options of a scene: those of the intersection that mean something on any road."""

from __future__ import annotations

from typing import Any

from socialiq.errors import one_of
from socialiq.worlds.highway.scenes import scene_of
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.settings import SIGNALS

NAMES = (
    "duration",
    "target_speeds",
    "observed_vehicles",
    "progress_unit",
    "zone",
    "counted",
    "disruption",
    "crash",
    "conflict_distance",
    *(f"{name}_weight" for name in SIGNALS),
    "speed_threshold",
    "speed_cap",
)
"""Options that a scene has; `intersection.options.Options` says what they mean."""

_OWN = {"simulation_frequency": 15, "observed_vehicles": 5}


def options_of(name: str, **given: Any) -> Options:
    """Return a scene's options, with highway-env's clock of 15 sub-steps a second.

    Args:
        name: Name of the scene.
        given: Values by name of the option, one of `NAMES`.

    Raises:
        UserError: If the scene, an option or a value is unknown.
    """
    for option in given:
        one_of(f"option of {name}", option, NAMES)
    return Options(**{**_OWN, **scene_of(name).defaults, **given})
