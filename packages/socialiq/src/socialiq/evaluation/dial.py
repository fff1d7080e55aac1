"""Evaluation of a dial: exact in an enumerable world, by rollouts and mixtures elsewhere."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int64

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.evaluation import exact
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.exact import Metrics, Readout
from socialiq.evaluation.measures import DECISION, Episodes
from socialiq.mdp.front import AttainableSet, attainable_set
from socialiq.nn.actor_policy import ActorDial
from socialiq.nn.dial_policy import Dial, DialPolicy
from socialiq.social.angle import AngleEstimate, estimate_angle, exact_weights
from socialiq.social.dial import Setting, setting
from socialiq.types import RewardPair
from socialiq.worlds.enumerate import Table
from socialiq.worlds.world import Simulator


@dataclass(frozen=True)
class Sweep:
    """Metrics of a dial's policy at each queried angle, in degrees, ascending."""

    angles: tuple[float, ...]
    metrics: tuple[Metrics, ...]

    @property
    def points(self) -> Float[np.ndarray, "angle 2"]:
        """Return the expected sums (r_env, r_social) at each angle."""
        return np.array([metrics.totals for metrics in self.metrics])

    def regrets(self, best: AttainableSet) -> Float[np.ndarray, " angle"]:
        """Return the regret J*(α) - J(α) at each angle."""
        pairs = zip(self.angles, self.metrics, strict=True)
        return np.array(
            [best.optimum(angle).value - policy.value(angle) for angle, policy in pairs]
        )

    def backward_steps(self) -> RewardPair:
        """Return the largest changes in the wrong direction between successive angles.

        With a larger angle the sum of r_env should not rise, and that of r_social should not fall.
        """
        steps = np.diff(self.points, axis=0)
        return RewardPair(max(0.0, float(steps[:, 0].max())), max(0.0, float(-steps[:, 1].min())))


def sweep(
    dial: DialPolicy, table: Table, readout: Readout = "greedy", angles: Sequence[float] = ()
) -> Sweep:
    """Query a dial at each of some angles, and evaluate its policies exactly.

    Args:
        dial: The dial.
        table: World of the training, or its reachable part.
        readout: "greedy" for the best action, "soft" for the dial's probabilities.
        angles: Angles in degrees, ascending; by default every degree of the dial's range.
    """
    chosen = tuple(angles) or tuple(np.arange(dial.low, dial.high + 0.5).tolist())
    metrics = [
        exact.evaluate_exactly(table, exact.action_table(dial.at(angle), table, readout))
        for angle in chosen
    ]
    return Sweep(chosen, tuple(metrics))


def stands(dial: Dial[Any], observations: Float[np.ndarray, "row feature"]) -> bool:
    """Whether a dial of several angles takes the same action of each observation at all of them.

    Args:
        dial: The dial, which is read at 19 angles of its range.
        observations: Observations at which it decides.

    Returns:
        False for a dial of one angle.
    """
    angles = np.linspace(dial.high, dial.low, 19).tolist()
    first = dial.at(dial.low).predict(observations)[0]
    return dial.low < dial.high and all(
        np.array_equal(first, dial.at(angle).predict(observations)[0]) for angle in angles
    )


def calibrated(dial: DialPolicy, sweep: Sweep) -> DialPolicy:
    """Return a dial that answers an angle with the best of the evaluated policies at this angle.

    The policies that are best at some angle are the corners of their points' convex hull. From one
    corner to the next, R_social rises and R_env falls, so the effect of the angle is monotone where
    the points are exact, and with no value below that of the dial at its own angles.

    Args:
        dial: Dial without settings.
        sweep: Its policies at some angles, evaluated.

    Raises:
        UserError: If it has settings already.
    """
    if dial.settings:
        raise UserError("this dial is calibrated already: take the one that it was made of")
    points = sweep.points
    at = dial.low
    best = int(np.argmax(points @ np.array(exact_weights(at))))
    settings = [(at, sweep.angles[best])]
    while True:
        less = points[best] - points
        gain = points - points[best]
        rises = gain[:, 1] > 0.0
        turn = np.where(rises, np.degrees(np.arctan2(less[:, 0], gain[:, 1])), np.inf)
        best = int(np.lexsort((-points[:, 1], turn))[0])
        if not turn[best] <= dial.high:
            return dataclasses.replace(dial, settings=tuple(settings))
        if turn[best] <= at:  # as good as the last corner, and further
            settings.pop()
        at = max(at, float(turn[best]))
        settings.append((at, sweep.angles[best]))


def support_ceiling(data: Demonstrations, table: Table, timed: bool) -> AttainableSet:
    """Return the attainable set of demonstrated actions, the limit of offline learning.

    In states without demonstrations all actions are allowed, so a learner that stays in the support
    can't exceed it. `Optimum` has the limit of all policies.

    Args:
        data: Demonstrations of the world.
        table: The world, or its reachable part.
        timed: Whether an action counts only at the time at which it was demonstrated.
    """
    counts = exact.visit_counts(data, table)
    allowed = np.asarray((counts if timed else counts.sum(axis=0)) > 0)
    return attainable_set(table.mdp, table.world.horizon, allowed)


def ceiling_regrets(
    ceiling: AttainableSet, best: exact.Optimum, angles: Sequence[float]
) -> Float[np.ndarray, " angle"]:
    """Return the regret of the support at each angle: J*(α) less its best value.

    Args:
        ceiling: Attainable set of the demonstrated actions (`support_ceiling`).
        best: Optimum of the world.
        angles: Angles in degrees.
    """
    return np.array(
        [best.attainable.optimum(angle).value - ceiling.optimum(angle).value for angle in angles]
    )


@dataclass(frozen=True)
class DialRollouts:
    """Rollouts of a dial at several angles, on common seeds.

    Attributes:
        sweep: Means over all episodes at each angle.
        episodes: The episodes by angle.
    """

    sweep: Sweep
    episodes: tuple[Episodes, ...]

    @property
    def totals(self) -> list[Float[np.ndarray, "episode 2"]]:
        """Sums of (r_env, r_social) of each episode, by angle."""
        return [np.stack(episodes.totals, axis=1) for episodes in self.episodes]

    def mixture(self, behavioural: float, seed: int) -> tuple[Setting, AngleEstimate]:
        """Return the mixture of two queried policies with a behavioural angle in degrees.

        The first half of the episodes selects it, the second half measures it: an interval over the
        selecting episodes would be biased towards the angle. Both policies drove the same seeds, so
        the mixture's expected sums on a seed are resampled.

        Raises:
            UserError: If no mixture of these policies has this angle.
        """
        totals = self.totals
        half = len(totals[0]) // 2
        angle = setting(np.array([sums[:half].mean(axis=0) for sums in totals]), behavioural)
        fresh = np.stack([sums[half:] for sums in totals])
        on_seed = (1.0 - angle.share) * fresh[angle.first] + angle.share * fresh[angle.second]
        return angle, estimate_angle(on_seed[:, 0], on_seed[:, 1], seed)


def rollout_dial(
    dial: DialPolicy | ActorDial,
    batch: Simulator,
    angles: Sequence[float],
    seeds: Int64[np.ndarray, " episode"],
    readout: Readout = "greedy",
) -> DialRollouts:
    """Run seeded episodes of a dial in any world, the same ones at each angle.

    Args:
        dial: The dial.
        batch: Episodes of the world.
        angles: Angles in degrees, ascending.
        seeds: Seed of each episode.
        readout: "greedy" for the best action, "soft" for the dial's probabilities.

    Raises:
        UserError: If there are fewer than two episodes, or an angle is outside the dial's range.
    """
    if len(seeds) < 2:
        raise UserError("a mixture needs two episodes or more: one half selects, one measures")
    driven = tuple(
        episodes_of(batch, dial.at(angle), seeds, readout == "greedy", DECISION) for angle in angles
    )
    return DialRollouts(
        Sweep(tuple(angles), tuple(episodes.metrics() for episodes in driven)), driven
    )
