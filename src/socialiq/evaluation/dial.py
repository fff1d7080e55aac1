"""Evaluation of a dial: exactly in an enumerable world, by rollouts and mixtures elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.evaluation.exact import Optimum, Readout, action_table, evaluate_exactly, visit_counts
from socialiq.evaluation.metrics import Metrics
from socialiq.evaluation.play import episodes_of
from socialiq.mdp.front import AttainableSet, attainable_set
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle import AngleEstimate, estimate_angle
from socialiq.social.dial import Setting, setting
from socialiq.types import RewardPair
from socialiq.worlds.enumerate import Table
from socialiq.worlds.intersection.batch import Batch


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
    counts = visit_counts(data, table)
    allowed = np.asarray((counts if timed else counts.sum(axis=0)) > 0)
    return attainable_set(table.mdp, table.world.horizon, allowed)


def ceiling_regrets(
    ceiling: AttainableSet, best: Optimum, angles: Sequence[float]
) -> Float[np.ndarray, " angle"]:
    """What the support costs at each angle: J*(α) less the best value inside the support."""
    return np.array(
        [best.attainable.optimum(one).value - ceiling.optimum(one).value for one in angles]
    )


@dataclass(frozen=True)
class DialRollouts:
    """What a dial did at each angle, on seeds that all angles share.

    Attributes:
        sweep: Means over all episodes.
        totals: Sums of (r_env, r_social) of each episode, by angle.
    """

    sweep: Sweep
    totals: tuple[Float[np.ndarray, "episode 2"], ...]

    def mixture(self, wanted: float, seed: int) -> tuple[Setting, AngleEstimate]:
        """The mixture of two queried policies whose behaviour lies at an angle.

        The first half of the episodes chooses it, the second half measures it: an interval over the
        episodes that chose would be about its own wish. Both policies drove the same seeds, so what
        is resampled is the mixture's expected sums on a seed.

        Args:
            wanted: Behavioural angle in degrees.
            seed: Of the bootstrap.

        Raises:
            UserError: If no mixture of these policies has this angle.
        """
        half = len(self.totals[0]) // 2
        one = setting(np.array([sums[:half].mean(axis=0) for sums in self.totals]), wanted)
        fresh = np.stack([sums[half:] for sums in self.totals])
        on_seed = (1.0 - one.share) * fresh[one.first] + one.share * fresh[one.second]
        return one, estimate_angle(on_seed[:, 0], on_seed[:, 1], seed)


def rollout_dial(
    dial: DialPolicy,
    batch: Batch,
    angles: Sequence[float],
    seeds: Int64[np.ndarray, " episode"],
    readout: Readout = "greedy",
) -> DialRollouts:
    """Drive a dial at some angles.

    Args:
        dial: The dial.
        batch: Where to drive.
        angles: In degrees, rising.
        seeds: One for each episode; every angle drives them all.
        readout: "greedy" or "soft".

    Raises:
        UserError: If there are fewer than two episodes, or an angle is outside the dial's range.
    """
    if len(seeds) < 2:
        raise UserError("a mixture needs two episodes or more: one half chooses, one measures")
    driven = [
        episodes_of(batch, dial.at(angle), seeds, deterministic=readout == "greedy")
        for angle in angles
    ]
    return DialRollouts(
        Sweep(tuple(angles), tuple(one.metrics() for one in driven)),
        tuple(np.stack([one.totals.env, one.totals.social], axis=1) for one in driven),
    )
