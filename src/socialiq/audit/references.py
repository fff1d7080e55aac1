"""The drivers that a policy under audit is compared with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from socialiq.audit.grid_play import drive_timed
from socialiq.audit.outcomes import Outcomes
from socialiq.mdp.front import AttainableSet, attainable_set
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.social.angle import exact_weights
from socialiq.social.score import score
from socialiq.types import Policy
from socialiq.worlds.enumerate import Table
from socialiq.worlds.intersection.policies import policy

RULES = ("go", "wait", "idm")
"""Drivers by rule that are always among the references at the intersection."""


@dataclass(frozen=True)
class Reference:
    """A driver to compare with.

    Attributes:
        name: Of its own.
        policy: Anything with `predict`.
        angle: Social angle in degrees for which it was made, if any; it makes a point of the
            reference curve.
    """

    name: str
    policy: Policy
    angle: float | None = None

    @property
    def angles(self) -> tuple[float, ...]:
        """The angle as `Outcomes` keep it."""
        return () if self.angle is None else (self.angle,)


def by_rule() -> tuple[Reference, ...]:
    """Always faster, always slower, and the Intelligent Driver Model at the ego's seat."""
    return tuple(Reference(name, policy(name)) for name in RULES)


def exact_optima(table: Table, fate: Float[np.ndarray, "episode draw"]) -> tuple[Outcomes, ...]:
    """The exact optima of a gridworld on episodes of given fates, one for each vertex.

    Together they are the best at every angle, so the largest J(α) among them is J*(α) itself.
    Each knows the time; `Outcomes.expected` has its exact expectation.

    Args:
        table: The world's reachable part.
        fate: Of `grid_play.fates`.
    """
    horizon, found = table.world.horizon, []
    best: AttainableSet = attainable_set(table.mdp, horizon)
    for vertex in range(len(best.vertices)):
        low, high = best.supporting_interval(vertex)
        middle = (low + high) / 2
        reward = np.asarray(score(exact_weights(middle), table.mdp.rewards))
        optimum = horizon_optimum(table.mdp, reward, horizon)
        exact = horizon_evaluation(
            table.mdp, optimum.probabilities(table.mdp.n_actions), horizon
        ).totals
        name = f"optimum_{vertex:02d}"
        found.append(drive_timed(table, optimum.actions, fate, name, (low, high), exact))
    return tuple(found)
