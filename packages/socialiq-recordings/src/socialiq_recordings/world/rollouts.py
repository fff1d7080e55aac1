"""Returns of every action at a recorded junction, by rollouts in copies of its episodes.

A copy has the drivers and their parameters, so all actions of a state meet the same traffic.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64

from socialiq.evaluation.branching import rollouts
from socialiq.types import Ending
from socialiq.worlds.highway.options import Contact
from socialiq_recordings.world.batch import JunctionBatch

Act = Callable[[Float32[np.ndarray, "row feature"]], Int64[np.ndarray, " row"]]
"""A policy: actions of observations."""


class Branched(NamedTuple):
    """Outcomes of each action of some states.

    Attributes:
        returns: Sums of r_env and r_social to the end of the episode.
        at_fault: Whether the episode ends in a collision at fault.
    """

    returns: Float[np.ndarray, "state action 2"]
    at_fault: Bool[np.ndarray, "state action"]


class Visited(NamedTuple):
    """States that a policy visits, and what each action leads to if the policy goes on.

    Attributes:
        observation: Of each state.
        time: Decisions since the reset.
        action: The policy's.
        branched: Of each action.
    """

    observation: Float32[np.ndarray, "state feature"]
    time: Float32[np.ndarray, " state"]
    action: Int64[np.ndarray, " state"]
    branched: Branched


def branch(batch: JunctionBatch, rows: Int64[np.ndarray, " state"], policy: Act) -> Branched:
    """Take each action in a copy of each state, and follow a policy to the end of the episode.

    Args:
        batch: Episodes; they are not changed.
        rows: Episodes that run.
        policy: Followed after the first action.
    """
    count = batch.world.n_actions
    copies = batch.branch(np.repeat(rows, count))
    first = np.tile(np.arange(count), len(rows))
    returns, at_fault = np.zeros((copies.size, 2)), np.zeros(copies.size, bool)
    steps = rollouts(
        copies, first, np.ones(copies.size, bool), lambda rows: policy(copies.observation[rows])
    )
    for decided, decisions in steps:
        returns[decided] += np.column_stack(decisions.rewards)[decided]
        collided = decisions.ending == int(Ending.COLLISION)
        at_fault |= decided & collided & (decisions.contact == int(Contact.EGO_STRUCK))
    return Branched(returns.reshape(-1, count, 2), at_fault.reshape(-1, count))


def visit(batch: JunctionBatch, policy: Act, seeds: Int64[np.ndarray, " episode"]) -> Visited:
    """Drive an episode for each seed, and branch in every state.

    Args:
        batch: As many episodes as seeds.
        policy: Greedy or not; it is followed in the copies too.
        seeds: Of the episodes.
    """
    batch.reset(seeds)
    running, visited = np.ones(batch.size, bool), []
    while running.any():
        rows = np.flatnonzero(running)
        observation, time, action = batch.observation, batch.time, np.zeros(batch.size, np.int64)
        action[rows] = policy(observation[rows])
        visited.append((observation[rows], time[rows], action[rows], *branch(batch, rows, policy)))
        decisions = batch.step(action, rows=running)
        running &= decisions.ending == int(Ending.NONE)
    observation, time, action, returns, at_fault = (
        np.concatenate(column) for column in zip(*visited, strict=True)
    )
    return Visited(observation, time, action, Branched(returns, at_fault))
