"""Fleets: several policies drive the vehicles of an episode together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Int64

from socialiq.errors import UserError
from socialiq.evaluation.measures import Episodes, Quantity, columns_of
from socialiq.evaluation.simulate import simulate
from socialiq.types import Policy
from socialiq.worlds.highway.batch import RoadBatch, seeds_of


def drive(
    batch: RoadBatch,
    policies: Sequence[Policy],
    seeds: int | Sequence[int] | np.ndarray,
    drivers: Int64[np.ndarray, "episode agent"] | None = None,
) -> Episodes:
    """Run one greedy episode of each seed, in which every agent may have another policy.

    A policy of one ego drives any agent: it sees what that agent sees, with the time at the end if
    it has one feature more.

    Args:
        batch: Episodes of a world of `worlds.registry.make_fleet`.
        policies: The policies; agents take them in turn.
        seeds: Seed of each episode, or the first of consecutive ones.
        drivers: Number of each agent's policy in each episode, in place of the turns.

    Returns:
        Columns (episode, agent) over the agent's own episode: `r_env`, `r_social`, `length`, the
        sums of the signals, `signal_NAME`, and its `ending`.

    Raises:
        UserError: If there is no policy, a number of one is unknown, or the batch has one ego.
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
    actor = FleetActor(batch, policies, drivers)

    def driven(column: np.ndarray) -> np.ndarray:
        return np.where(actor.driving, column, 0)

    quantities = {
        "r_env": Quantity("reward", lambda step: driven(step.made.rewards.env)),
        "r_social": Quantity("reward", lambda step: driven(step.made.rewards.social)),
        # the ending is `NONE`, 0, before the last decision
        "ending": Quantity("", lambda step: driven(step.made.ending), "count"),
        "length": Quantity("decisions", lambda _: actor.driving, "count"),
        "signal": Quantity(
            "", lambda step: {name: driven(row) for name, row in step.made.signals.items()}
        ),
    }
    queue = seeds_of(seeds, batch.size)
    return columns_of(simulate(batch, actor, queue), len(queue), quantities)


class FleetActor:
    """Lets several policies drive the agents of an episode.

    Attributes:
        driving: Whether each agent took part in the last decision, (episode, agent).
    """

    def __init__(
        self,
        batch: RoadBatch,
        policies: Sequence[Policy],
        drivers: Int64[np.ndarray, "episode agent"],
    ) -> None:
        self._batch = batch
        self._policies = policies
        self._drivers = drivers
        self.driving = np.zeros(batch.shape, bool)

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Do nothing: policies keep nothing of an episode."""

    def decide(self, observation: Any, running: np.ndarray) -> np.ndarray:  # noqa: ARG002
        """Return an action for each agent, 0 for agents that don't drive.

        Args:
            observation: Not used: each policy sees what `RoadBatch.seen_by` says.
            running: Whether each episode runs, bool (episode,).

        Returns:
            Numbers (episode, agent); continuous actions (episode, agent, value), float32.
        """
        self.driving = self._batch.driving & running[:, None]
        options = self._batch.options
        actions = np.zeros(self._batch.shape, np.int64)
        if options.continuous:
            actions = np.zeros((*self._batch.shape, options.width), np.float32)
        for number, policy in enumerate(self._policies):
            chosen = self.driving & (self._drivers == number)
            if chosen.any():
                actions[chosen] = policy.predict(self._batch.seen_by(policy)[chosen])[0]
        return actions
