"""Names of drivers in words, for readers who don't know the package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from socialiq.audit.evidence.drive_junction import DRIVER
from socialiq.audit.evidence.outcomes import AS_DECLARED
from socialiq.audit.evidence.trivial import PREFIX, RANDOM

OPTIMUM = "optimum_"
"""Beginning of the names of exact optima (`evidence.drive_grid.exact_optima`)."""

_SIMPLER = "simpler network, "

_TRAINED = {
    "egoistic": "trained for 0°: own progress alone",
    "prosocial": "trained for 45°: own progress and others alike",
    "altruistic": "trained for 90°: others alone",
}

_NAMES = {
    "go": "always goes",
    "wait": "always waits",
    "idm": "Intelligent Driver Model: follows the car in front and gives way",
    DRIVER: "calibrated driver of the recording",
    "gap_2s": "goes at gaps of 2 s",
    "gap_3s": "goes at gaps of 3 s",
    "gap_4s": "goes at gaps of 4 s",
    RANDOM: "chooses at random",
    AS_DECLARED: "decides as declared",
    **{f"set_{mode}": text for mode, text in _TRAINED.items()},
    **{f"expert_{mode}": f"{_SIMPLER}{text}" for mode, text in _TRAINED.items()},
}


def plain_name(name: str, angles: Sequence[float] = ()) -> str:
    """Return the name of one of the package's drivers in words; another's is returned as it is.

    Args:
        name: Name of the driver in the report.
        angles: Ends of the interval of angles for which an exact optimum is the best.
    """
    if name.startswith(OPTIMUM) and angles:
        low, high = (_degrees(angle) for angle in (angles[0], angles[-1]))
        return f"best possible for {low} to {high}"
    if name.startswith(PREFIX) and name not in _NAMES:
        return f"always chooses “{name.removeprefix(PREFIX).replace('_', ' ')}”"
    return _NAMES.get(name, name)


def names_of(report: Mapping[str, Any]) -> dict[str, str]:
    """Return the name in words of every reference and trivial driver of a report, by its name.

    A driver of the user's keeps its name, even if the package has a driver of that name.
    """
    rows = [*report["references"], *report["left_out"]]
    found = {one["name"]: _named(one) if _shipped(one) else one["name"] for one in rows}
    return found | {one["name"]: plain_name(one["name"]) for one in report["trivial"]}


def _named(reference: Mapping[str, Any]) -> str:
    found, record = plain_name(reference["name"], reference["angles"]), reference["record"]
    # There is one family with continuous actions, so none is the simpler.
    one_family = record is not None and "action_size" in record
    return found.removeprefix(_SIMPLER) if one_family else found


def _shipped(reference: Mapping[str, Any]) -> bool:
    """Whether a reference is the package's own: without a record, or a rule, or of the atlas."""
    record = reference["record"]
    return record is None or record["kind"] == "rule" or record["source"].startswith("atlas:")


def _degrees(angle: float) -> str:
    turned = -((180.0 - angle) % 360.0 - 180.0)
    return f"{round(turned, 1) + 0.0:g}°".replace("-", "−")
