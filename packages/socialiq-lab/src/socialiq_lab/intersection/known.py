"""The best policies known on the studies' common episodes, from the committed results."""

from __future__ import annotations

from socialiq.social.angle import exact_weights
from socialiq.storage import packaged_results
from socialiq.types import Row
from socialiq_lab import results as store
from socialiq_lab.intersection.episodes import EPISODES

_STUDIES = ("intersection", "intersection-networks", "intersection-ahead", "intersection-dial")
_ELSEWHERE = ("varied_drivers", "connected_lanes")
"""Parts of the names of policies that were driven in other scenarios."""
_TOTALS = ("r_env", "r_social")
_FORESIGHT = "foresight"
"""First part of the names of those that see the true future, and so are no policies."""


def known_policies() -> list[Row]:
    """Return study, policy, r_env and r_social of every policy on the 2,000 common episodes.

    Experts, learners, rules, rollout policies, dials and agents; not those that see the true
    future, and not those of other scenarios.

    Raises:
        UserError: If the results did not come with the package.
    """
    found: list[Row] = []
    for study in _STUDIES:
        for row in store.load(packaged_results() / study).tables["policies"]:
            parts = _name(row).split("/")
            here = parts[0] != _FORESIGHT and not set(_ELSEWHERE) & set(parts)
            if here and row["episodes"] == EPISODES:
                told = {"policy": _name(row), "readout": row.get("readout", "greedy")}
                found.append({"study": study, **told} | {name: row[name] for name in _TOTALS})
    return found


def _name(row: Row) -> str:
    """Return a policy's name; a dial's or an agent's has its family, seed and angle."""
    if "policy" in row:
        return row["policy"]
    return f"{row['family']}/{row['seed']}/{row['asked']:g}"


def value_at(row: Row, angle: float) -> float:
    """Return J(α) of a policy's mean totals (Eq 4.3)."""
    direction = exact_weights(angle)
    return direction.env * row["r_env"] + direction.social * row["r_social"]
