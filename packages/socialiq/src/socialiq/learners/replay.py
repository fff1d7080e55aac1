"""A ring of the learner's own transitions, or other rows, as pure functions of arrays."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PRNGKeyArray

from socialiq.learners.expert_table import Batch, draw_between
from socialiq.types import RewardPair


class Replay(NamedTuple):
    """Ring of the newest transitions.

    Attributes:
        columns: Storage, a NamedTuple of arrays (capacity, ...).
        added: Number of rows ever added.
    """

    columns: Any
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


def empty_of(capacity: int, row: Any) -> Replay:
    """Return an empty ring of rows like this one."""
    columns = jax.tree.map(lambda one: jnp.zeros((capacity, *one.shape), one.dtype), row)
    return Replay(columns, jnp.zeros((), jnp.int32))


def add(replay: Replay, transition: Any) -> Replay:
    """Add one transition (no batch axis), over the oldest when the ring is full."""
    slot = replay.added % _length(replay.columns)
    columns = jax.tree.map(
        lambda column, value: column.at[slot].set(value), replay.columns, transition
    )
    return Replay(columns, replay.added + 1)


def sample(replay: Replay, key: PRNGKeyArray, size: int) -> Any:
    """Draw uniformly with replacement from what has been added."""
    filled = jnp.minimum(replay.added, _length(replay.columns))
    rows = draw_between(key, size, 0, filled)
    return jax.tree.map(lambda column: column[rows], replay.columns)


def add_many(replay: Replay, transitions: Any) -> Replay:
    """Add transitions in order (leading axis); of more than the ring holds, the newest stay."""
    capacity = _length(replay.columns)
    count = _length(transitions)
    stored = min(count, capacity)  # two writes to one slot would be in no defined order
    slots = (replay.added + count - stored + jnp.arange(stored)) % capacity
    columns = jax.tree.map(
        lambda column, values: column.at[slots].set(values[-stored:]), replay.columns, transitions
    )
    return Replay(columns, replay.added + count)


def _length(columns: Any) -> int:
    return jax.tree.leaves(columns)[0].shape[0]
