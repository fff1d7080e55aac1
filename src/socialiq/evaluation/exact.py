"""Exact evaluation in an enumerable world: no sampling noise at all."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from socialiq.evaluation.metrics import Metrics
from socialiq.mdp.front import AttainableSet, attainable_set
from socialiq.mdp.horizon import horizon_evaluation
from socialiq.worlds.enumerate import Table


def evaluate_exactly(
    table: Table,
    policy: Float[np.ndarray, "state action"] | Float[np.ndarray, "time state action"],
) -> Metrics:
    """Propagate the state distribution over one episode of the world's horizon.

    Args:
        table: The world, or its reachable part.
        policy: Action probabilities in the table's states, stationary or by time.
    """
    result = horizon_evaluation(table.mdp, policy, table.world.horizon)
    share = result.visits / result.length
    return Metrics.of(
        totals=result.totals,
        endings=result.endings,
        mean_speed=float((share * table.speed).sum()),
        stopped=float(share[table.speed == 0].sum()),
        length=result.length,
    )


class Optimum:
    """J*(α) of a world: the best mean total that any policy, even one with a clock, can reach.

    Args:
        table: The world, or its reachable part.
    """

    def __init__(self, table: Table) -> None:
        self.attainable: AttainableSet = attainable_set(table.mdp, table.world.horizon)

    def regret(self, metrics: Metrics, angle: float) -> float:
        """J*(α) - J(α) of a policy, 0 at best; angle in degrees."""
        return self.attainable.optimum(angle).value - metrics.value(angle)
