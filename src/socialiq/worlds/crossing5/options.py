"""Options for what thesis 5.1.1 leaves open, each with its default and the reason for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Options:
    """Options of the 5x5 world. The defaults give the thesis' three expert sequences."""

    ends_on: Literal["ego_arrival", "both_arrived", "time_limit"] = "ego_arrival"
    """Event that ends an episode before its 20 steps. The thesis names only the cap. With
    `ego_arrival` value iteration gives the published sequences GGGG, WGGGG and WWWWGGGG;
    with `both_arrived` the egoist takes a fifth step that has no effect."""

    social_cost: Literal["until_other_arrives", "always"] = "until_other_arrives"
    """Steps in which r_social's -1 is charged. If it never stopped, the altruist would hurry to
    end the episode (WGGGG), so the published WWWWGGGG needs the cost to stop."""

    arrival: Literal["added", "override"] = "added"
    """Whether +10 on arrival is added to that step's -1 or replaces it. No optimal sequence
    changes; the text's "and" reads as a sum."""
