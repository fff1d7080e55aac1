"""Rows that a compiled learner samples from: demonstrations, and the learner's own transitions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair, Transitions

_ROWS = 2048
"""Columns are filled up to a multiple of this with rows that are never drawn, so that sets of about
the same size share one compiled program."""


class Batch(NamedTuple):
    """A batch of transitions, from demonstrations or from replay.

    Attributes:
        observation: s.
        action: a, integers (batch,); continuous ones are float32 (batch, size).
        next_observation: s'.
        ending: Value of `types.Ending`.
        target: What the social prior compares r̂ with, before the angle: the pair
            (G_env, G_social) of the chosen target kind.
        direction: (cos α, sin α) at which a dial drove; None where it is not stored.
    """

    observation: Float[Array, "batch feature"]
    action: Int[Array, " batch"] | Float[Array, "batch size"]
    next_observation: Float[Array, "batch feature"]
    ending: Int[Array, " batch"]
    target: RewardPair
    direction: RewardPair | None = None

    @staticmethod
    def empty(n_features: int, *action_size: int) -> Batch:
        """Return a row of zeros, with the shapes and types of a replay's rows."""
        observation = jnp.zeros(n_features)
        zero = jnp.zeros(())
        action = jnp.zeros(action_size, jnp.float32 if action_size else jnp.int32)
        ending = jnp.zeros((), jnp.int32)
        return Batch(observation, action, observation, ending, RewardPair(zero, zero))


class ExpertTable(NamedTuple):
    """One or more sets of demonstrations end to end; each run samples from one of them.

    Attributes:
        columns: All transitions, and empty rows at the end.
        starts: Rows of first transitions, of all sets.
        row_bounds: First row of each set, and the end.
        start_bounds: The same for `starts`.
    """

    columns: Batch
    starts: Int[Array, " episode"]
    row_bounds: Int[Array, " bound"]
    start_bounds: Int[Array, " bound"]

    @staticmethod
    def of(
        datasets: Sequence[Transitions],
        target_kind: str,
        social_discount: float,
        continuous: bool = False,
    ) -> ExpertTable:
        """Lay out sets of demonstrations and derive their cumulative returns.

        Args:
            datasets: Sets of demonstrations.
            target_kind: A kind of `Transitions.returns`.
            social_discount: γ_svo of the returns.
            continuous: Whether the learner takes continuous actions; else discrete ones.

        Returns:
            The table, whose targets are the returns.

        Raises:
            UserError: If there is none, or they differ in features or actions, or their actions are
                not those that the learner takes.
        """
        if not datasets:
            raise UserError("no demonstrations: pass at least one set")
        if len({data.observation.shape[1] for data in datasets}) > 1:
            raise UserError("the sets of demonstrations have different observations")
        if len({data.n_actions for data in datasets}) > 1:
            raise UserError("the sets of demonstrations have different actions")
        shapes = {data.action.shape[1:] for data in datasets}
        if len(shapes) > 1:
            raise UserError("the sets of demonstrations have actions of different sizes")
        if (shapes != {()}) != continuous:
            raise UserError(
                "this learner takes continuous actions: the demonstrations have discrete ones"
                if continuous
                else "this learner takes discrete actions: train on continuous ones with a learner "
                "of learners.continuous"
            )
        returns = [data.returns(target_kind, social_discount) for data in datasets]
        offsets = np.cumsum([0, *(len(data.action) for data in datasets)])
        starts = [data.episode_starts for data in datasets]

        def join(arrays: Sequence[np.ndarray], dtype: str) -> Array:
            joined = np.concatenate(arrays).astype(dtype)
            empty = np.zeros((-len(joined) % _ROWS, *joined.shape[1:]), dtype)
            return jnp.asarray(np.concatenate([joined, empty]))

        columns = Batch(
            join([data.observation for data in datasets], "float32"),
            join([data.action for data in datasets], "float32" if continuous else "int32"),
            join([data.next_observation for data in datasets], "float32"),
            join([data.ending for data in datasets], "int32"),
            RewardPair(
                join([pair.env for pair in returns], "float32"),
                join([pair.social for pair in returns], "float32"),
            ),
        )
        firsts = [first + offset for first, offset in zip(starts, offsets[:-1], strict=True)]
        episodes = np.cumsum([0, *map(len, starts)])
        bounds = (jnp.asarray(offsets, jnp.int32), jnp.asarray(episodes, jnp.int32))
        return ExpertTable(columns, join(firsts, "int32"), *bounds)

    def sample(self, key: PRNGKeyArray, dataset: Int[Array, ""], size: int) -> Batch:
        """Draw transitions of one set, uniformly and with replacement.

        Args:
            key: Random key.
            dataset: Index of the set.
            size: Number of rows.

        Returns:
            The rows, as a batch.
        """
        return self.rows(
            draw_between(key, size, self.row_bounds[dataset], self.row_bounds[dataset + 1])
        )

    def sample_weighted(
        self, key: PRNGKeyArray, cumulative: Float[Array, " transition"], size: int
    ) -> Batch:
        """Draw transitions by their weights, with replacement.

        Args:
            key: Random key.
            cumulative: Cumulative sum of the weights of all rows of the table; it need not end at
                1.
            size: Number of rows.

        Returns:
            The rows, as a batch.
        """
        # Scaled, because a rounded sum that ends below 1 would leave draws beyond all weights.
        draws = jax.random.uniform(key, (size,)) * cumulative[-1]
        rows = jnp.searchsorted(cumulative, draws, side="right")
        return self.rows(jnp.minimum(rows, self.row_bounds[-1] - 1))

    def sample_initial(
        self, key: PRNGKeyArray, dataset: Int[Array, ""], size: int
    ) -> Float[Array, "batch feature"]:
        """Draw true initial states of one set: its episodes' first observations.

        Args:
            key: Random key.
            dataset: Index of the set.
            size: Number of observations.

        Returns:
            The observations, drawn uniformly and with replacement.
        """
        episodes = draw_between(
            key, size, self.start_bounds[dataset], self.start_bounds[dataset + 1]
        )
        return self.columns.observation[self.starts[episodes]]

    def ending_shares(self, dataset: Int[Array, ""]) -> Float[Array, " kind"]:
        """Return the share of one set's transitions with each value of `types.Ending`."""
        first = self.row_bounds[dataset]
        end = self.row_bounds[dataset + 1]
        rows = jnp.arange(len(self.columns.ending))
        return shares_of_endings(self.columns.ending, (rows >= first) & (rows < end))

    def rows(self, rows: Int[Array, " batch"]) -> Batch:
        """Take the given rows."""
        return jax.tree.map(lambda column: column[rows], self.columns)


class Replay(NamedTuple):
    """Ring of the newest of the learner's own transitions, or other rows.

    Attributes:
        columns: Storage, a NamedTuple of arrays (capacity, ...).
        added: Number of rows ever added.
    """

    columns: Any
    added: Int[Array, ""]

    @staticmethod
    def empty(capacity: int, row: Any) -> Replay:
        """Return an empty ring.

        Args:
            capacity: Number of rows that it holds.
            row: A row with the shapes and types of all rows; its values are not stored.

        Returns:
            The ring.
        """
        columns = jax.tree.map(lambda leaf: jnp.zeros((capacity, *leaf.shape), leaf.dtype), row)
        return Replay(columns, jnp.zeros((), jnp.int32))

    def add(self, row: Any) -> Replay:
        """Add one row (no batch axis), over the oldest when the ring is full."""
        slot = self.added % _length(self.columns)
        columns = jax.tree.map(lambda column, value: column.at[slot].set(value), self.columns, row)
        return Replay(columns, self.added + 1)

    def add_many(self, rows: Any) -> Replay:
        """Add rows in order (leading axis); of more than the ring holds, the newest stay."""
        capacity = _length(self.columns)
        count = _length(rows)
        stored = min(count, capacity)  # two writes to one slot would be in no defined order
        slots = (self.added + count - stored + jnp.arange(stored)) % capacity
        columns = jax.tree.map(
            lambda column, values: column.at[slots].set(values[-stored:]), self.columns, rows
        )
        return Replay(columns, self.added + count)

    def sample(self, key: PRNGKeyArray, size: int) -> Any:
        """Draw uniformly with replacement from what has been added.

        Args:
            key: Random key.
            size: Number of rows.

        Returns:
            The rows, with a leading axis; rows of zeros if the ring is empty.
        """
        rows = draw_between(key, size, 0, jnp.minimum(self.added, _length(self.columns)))
        return jax.tree.map(lambda column: column[rows], self.columns)


class Carry(NamedTuple):
    """A random key and a ring: the loop carry of learners whose rows come from outside JAX."""

    key: Array
    replay: Replay


def _length(columns: Any) -> int:
    return jax.tree.leaves(columns)[0].shape[0]


def shares_of_endings(
    ending: Int[Array, " transition"], counted: Bool[Array, " transition"]
) -> Float[Array, " kind"]:
    """Return the share of the counted transitions with each value of `types.Ending`.

    Args:
        ending: Value of `types.Ending` of each transition.
        counted: Whether each transition counts.

    Returns:
        The share of each kind, in the order of `types.Ending`; all 0 if no transition counts.
    """
    kinds = jnp.arange(len(Ending))
    matches = (ending == kinds[:, None]) & counted
    return matches.sum(axis=1) / jnp.maximum(counted.sum(), 1)


def draw_between(
    key: PRNGKeyArray, size: int, first: Int[Array, ""] | int, end: Int[Array, ""]
) -> Int[Array, " batch"]:
    """Draw integers in [first, end), uniformly to one part in 2^24 and with replacement.

    Half the random bits of `jax.random.randint`, and half its time to compile.

    Args:
        key: Random key.
        size: Number of integers.
        first: Least integer.
        end: One more than the greatest integer.

    Returns:
        The integers.
    """
    share = jax.random.uniform(key, (size,))
    integers = first + jnp.floor(share * (end - first)).astype(jnp.int32)
    return jnp.minimum(integers, end - 1)
