"""A ring of the learner's own transitions, as pure functions of arrays."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PRNGKeyArray

from socialiq.learners.expert_table import Batch, draw_between
from socialiq.types import RewardPair


class Replay(NamedTuple):
    """Ring of the newest transitions.

    Attributes:
        columns: Storage, (capacity, ...).
        added: Number of transitions ever added.
    """

    columns: Batch
    added: Int[Array, ""]


def empty(capacity: int, n_features: int) -> Replay:
    """Return an empty ring."""
    observation = jnp.zeros((capacity, n_features), jnp.float32)
    integers = jnp.zeros(capacity, jnp.int32)
    hyperparameters = jnp.zeros(capacity, jnp.float32)
    pair = RewardPair(hyperparameters, hyperparameters)
    return Replay(
        Batch(observation, integers, observation, integers, pair), jnp.zeros((), jnp.int32)
    )


def add(replay: Replay, transition: Batch) -> Replay:
    """Add one transition (no batch axis), over the oldest when the ring is full."""
    slot = replay.added % replay.columns.action.shape[0]
    columns = jax.tree.map(
        lambda column, value: column.at[slot].set(value), replay.columns, transition
    )
    return Replay(columns, replay.added + 1)


def sample(replay: Replay, key: PRNGKeyArray, size: int) -> Batch:
    """Draw uniformly with replacement from what has been added."""
    filled = jnp.minimum(replay.added, replay.columns.action.shape[0])
    rows = draw_between(key, size, 0, filled)
    return jax.tree.map(lambda column: column[rows], replay.columns)


def add_many(replay: Replay, transitions: Batch) -> Replay:
    """Add transitions in order (leading axis); of more than the ring holds, the newest stay."""
    capacity = replay.columns.action.shape[0]
    count = transitions.action.shape[0]
    kept = min(count, capacity)  # two writes to one slot would be in no defined order
    slots = (replay.added + count - kept + jnp.arange(kept)) % capacity
    columns = jax.tree.map(
        lambda column, values: column.at[slots].set(values[-kept:]), replay.columns, transitions
    )
    return Replay(columns, replay.added + count)
