"""Episodes worth looking at: three ordinary ones and the three worst."""

from __future__ import annotations

from typing import Any

import numpy as np

from socialiq.audit.outcomes import Evidence, Outcomes
from socialiq.social.angle import exact_weights
from socialiq.social.score import score
from socialiq.types import Ending, RewardPair
from socialiq.worlds.intersection.state import Contact

SHOWN = 3


def selected(evidence: Evidence, angle: float) -> dict[str, list[dict[str, Any]]]:
    """The policy's median and worst episodes by what the declared weights say of them.

    Args:
        evidence: Of the audit.
        angle: Declared, degrees.

    Returns:
        Rows by "median" and "worst"; equal values in the order of the episodes.
    """
    values = value_of(evidence.policy, angle)
    order = np.argsort(values, kind="stable")
    count = min(SHOWN, len(order))
    first = (len(order) - count) // 2
    places = {"median": order[first : first + count], "worst": order[:count]}
    return {
        name: [_row(evidence, int(place), float(values[place])) for place in chosen.tolist()]
        for name, chosen in places.items()
    }


_COLLISIONS = {
    Contact.NONE: "collision",  # nobody tells who struck whom
    Contact.EGO_STRUCK: "drove into another",
    Contact.EGO_WAS_STRUCK: "struck by another",
}


def value_of(driver: Outcomes, angle: float) -> np.ndarray:
    """R(α) of each of a driver's episodes."""
    return np.asarray(score(exact_weights(angle), RewardPair(*driver.totals.T)))


def kind_of_ending(driver: Outcomes, place: int) -> str:
    """How an episode ended, in one word or two."""
    ending = Ending(int(driver.ending[place]))
    if ending is not Ending.COLLISION:
        return ending.name.lower()
    return _COLLISIONS[Contact(int(driver.contact[place]))]


def _row(evidence: Evidence, place: int, value: float) -> dict[str, Any]:
    env, social = evidence.policy.totals[place].tolist()
    return {
        "episode": place,
        # Text, since many readers of JSON keep no more than 53 bits of a number.
        "seed": str(int(evidence.seeds[place])),
        "r_env": env,
        "r_social": social,
        "value": value,
        "ending": kind_of_ending(evidence.policy, place),
        "decisions": int(evidence.policy.length[place]),
    }
