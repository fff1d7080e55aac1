"""Fleets: several policies drive the vehicles of an episode together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int8, Int64

from socialiq.errors import UserError
from socialiq.types import Policy, RewardPair
from socialiq.worlds.highway.world import RoadBatch


class Driven(NamedTuple):
    """Episodes of a fleet, by episode and agent."""

    rewards: RewardPair  # sums over the agent's own episode
    ending: Int8[np.ndarray, "episode agent"]  # values of `types.Ending`
    decisions: Int64[np.ndarray, "episode agent"]  # of the agent's own episode
    signals: dict[str, Float64[np.ndarray, "episode agent"]]  # sums, unweighted


def drive(
    batch: RoadBatch,
    policies: Sequence[Policy],
    seeds: int | Sequence[int] | np.ndarray,
    drivers: Int64[np.ndarray, "episode agent"] | None = None,
) -> Driven:
    """Run one greedy episode of each seed, in which every agent has a policy of its own.

    A policy of one ego drives any agent: it sees what that agent sees, with the time at the end if
    it has one feature more.

    Args:
        batch: Episodes of a world of `worlds.registry.make_fleet`.
        policies: The policies; agents take them in turn.
        seeds: Seed of each episode, or the first of consecutive ones.
        drivers: Number of each agent's policy in each episode, in place of the turns.

    Raises:
        UserError: If there is no policy, a number of one is unknown, or the batch is of one ego.
    """
    if len(batch.shape) != 2:
        raise UserError("the batch has one ego: make the world by make_fleet")
    if not policies:
        raise UserError("policies must have at least one policy")
    if drivers is None:
        turns = np.arange(batch.options.agents) % len(policies)
        drivers = np.broadcast_to(turns, batch.shape)
    if drivers.shape != batch.shape or not np.isin(drivers, np.arange(len(policies))).all():
        raise UserError(
            f"drivers must have the shape {batch.shape} and numbers below {len(policies)}"
        )
    batch.reset(seeds)
    decisions, totals = np.zeros(batch.shape, np.int64), np.zeros((2, *batch.shape))
    signals: dict[str, np.ndarray] = {}
    ending = np.zeros(batch.shape, np.int8)
    while batch.running.any():
        driving = batch.driving & batch.running[:, None]
        actions = np.zeros(batch.shape, np.int64)
        for number, policy in enumerate(policies):
            chosen = driving & (drivers == number)
            if chosen.any():
                actions[chosen] = policy.predict(batch.seen_by(policy)[chosen])[0]
        results = batch.step(actions, auto_reset=False, rows=batch.running)
        decisions += driving
        totals += np.where(driving, results.rewards, 0.0)
        for name, values in results.signals.items():
            signals[name] = signals.get(name, 0.0) + np.where(driving, values, 0.0)
        ending = np.where(driving, results.ending, ending)
    return Driven(RewardPair(*totals), ending, decisions, signals)
