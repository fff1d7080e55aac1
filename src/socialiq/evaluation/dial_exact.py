"""A dial in an enumerable world, evaluated exactly: where each angle leads, and how far off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.exact import Optimum, Readout, action_table, evaluate_exactly
from socialiq.evaluation.metrics import Metrics
from socialiq.evaluation.visit_counts import tally
from socialiq.mdp.front import AttainableSet, attainable_set
from socialiq.nn.dial_policy import DialPolicy
from socialiq.types import RewardPair
from socialiq.worlds.enumerate import Table


@dataclass(frozen=True)
class Sweep:
    """What a dial does at each angle that it was queried at.

    Attributes:
        angles: Queried, in degrees, rising.
        metrics: Of the policy at each.
    """

    angles: tuple[float, ...]
    metrics: tuple[Metrics, ...]

    @property
    def points(self) -> Float[np.ndarray, "angle 2"]:
        """Expected sums (r_env, r_social) at each angle."""
        return np.array([one.totals for one in self.metrics])

    def regrets(self, best: AttainableSet) -> Float[np.ndarray, " angle"]:
        """J*(α) - J(α) at each angle."""
        pairs = zip(self.angles, self.metrics, strict=True)
        return np.array([best.optimum(angle).value - one.value(angle) for angle, one in pairs])

    def backward_steps(self) -> RewardPair:
        """Largest step against the dial's sense from one angle to the next, 0 if there is none.

        Turning it up should never raise the sum of r_env, and never lower that of r_social.
        """
        steps = np.diff(self.points, axis=0)
        return RewardPair(max(0.0, float(steps[:, 0].max())), max(0.0, float(-steps[:, 1].min())))


def sweep(
    dial: DialPolicy, table: Table, readout: Readout = "greedy", angles: Sequence[float] = ()
) -> Sweep:
    """Query a dial at every degree of its range, or at the given angles, and evaluate exactly.

    Args:
        dial: The dial.
        table: The world it was trained in, or its reachable part.
        readout: "greedy" or "soft".
        angles: In degrees, rising.
    """
    chosen = tuple(angles) or tuple(np.arange(dial.low, dial.high + 0.5).tolist())
    metrics = [
        evaluate_exactly(table, action_table(dial.at(angle), table, readout)) for angle in chosen
    ]
    return Sweep(chosen, tuple(metrics))


def support_ceiling(data: Demonstrations, table: Table, timed: bool) -> AttainableSet:
    """What policies can reach that take demonstrated actions only: the ceiling of offline learning.

    Where nothing is demonstrated the best is assumed, so a learner that stays in the support
    can't beat it. `Optimum` has what any policy can reach.

    Args:
        data: Demonstrations in the table's world.
        table: The world's reachable part.
        timed: Whether an action counts only at the time at which it was demonstrated.
    """
    counts = tally(data, table)
    allowed = np.asarray((counts if timed else counts.sum(axis=0)) > 0)
    return attainable_set(table.mdp, table.world.horizon, allowed)


def ceiling_regrets(
    ceiling: AttainableSet, best: Optimum, angles: Sequence[float]
) -> Float[np.ndarray, " angle"]:
    """What the support costs at each angle: J*(α) less the best value inside the support."""
    return np.array(
        [best.attainable.optimum(one).value - ceiling.optimum(one).value for one in angles]
    )
