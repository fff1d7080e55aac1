"""The rows of an update: demonstrations and own steps, each at an angle drawn for it."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners import replay
from socialiq.learners.dial.config import DialConfig
from socialiq.learners.expert_table import Batch, ExpertTable, draw_between
from socialiq.social.angle import exact_weights
from socialiq.types import Ending, RewardPair


class Rows(NamedTuple):
    """Rows of one update.

    Attributes:
        batch: Transitions; the first `n_expert` are demonstrations.
        direction: (cos α, sin α) of each row.
        n_expert: How many are demonstrations.
        own: The demonstrators' own directions, of the demonstrations; None if they are not given.
    """

    batch: Batch
    direction: RewardPair
    n_expert: int
    own: RewardPair | None = None


class Driven(NamedTuple):
    """Own transitions with the direction (cos α, sin α) at which they were driven.

    Attributes:
        observation: As in `Batch`, and so on up to `target`.
        direction: Of each transition.
    """

    observation: Array
    action: Array
    next_observation: Array
    ending: Array
    target: RewardPair
    direction: RewardPair

    @staticmethod
    def of(batch: Batch, direction: RewardPair) -> Driven:
        """Join transitions with their directions."""
        return Driven(*batch, direction)

    @property
    def batch(self) -> Batch:
        """The transitions."""
        return Batch(*self[:-1])


def empty_ring(static: DialConfig, n_features: int) -> replay.Replay:
    """Return an empty ring; it also holds directions if rows are learned from at theirs."""
    ring = replay.empty(static.replay_capacity, n_features)
    if not static.driven_share:
        return ring
    nothing = jnp.zeros(static.replay_capacity, jnp.float32)
    return ring._replace(columns=Driven.of(ring.columns, RewardPair(nothing, nothing)))


def draw_rows(
    static: DialConfig,
    table: ExpertTable | None,
    dataset: Array,
    ring: replay.Replay | None,
    key: Array,
) -> Rows:
    """Demonstrations, then the learner's own steps, each row at an angle drawn for it."""
    for_expert, for_replay, for_angle, for_time = jax.random.split(key, 4)
    batches, driven = list[Batch](), None
    if static.demonstrations and table is not None:
        batches += _shown(static, table, dataset, for_expert)
    if ring is not None:
        sampled = replay.sample(ring, for_replay, static.replay_batch)
        if static.driven_share:
            sampled, driven = sampled.batch, sampled.direction
        batches.append(sampled)
    batch = jax.tree.map(lambda *columns: jnp.concatenate(columns), *batches)
    if static.redraw_times:
        batch = at_other_times(
            for_time, batch, static.redraw_times, static.timeout_reward, static.redraw_share
        )
    n_expert = static.expert_batch if static.demonstrations else 0
    directions = draw_directions(for_angle, len(batch.action), static)
    if driven is not None:
        directions = _some_as_driven(jax.random.fold_in(for_angle, 1), directions, driven, static)
    return Rows(batch, directions, n_expert, _own_directions(static))


def _shown(static: DialConfig, table: ExpertTable, dataset: Array, key: Array) -> list[Batch]:
    """Demonstrations; of several demonstrators as many of each, in their order."""
    count = len(static.demonstrators)
    if not count:
        return [table.sample(key, dataset, static.expert_batch)]
    return [
        table.sample(row_key, dataset * count + number, static.expert_batch // count)
        for number, row_key in enumerate(jax.random.split(key, count))
    ]


def _own_directions(static: DialConfig) -> RewardPair | None:
    """Each demonstrator's own direction, for as many rows as there are of it."""
    if not static.demonstrators:
        return None
    pairs = jnp.array([exact_weights(angle) for angle in static.demonstrators])
    rows = jnp.repeat(pairs, static.expert_batch // len(static.demonstrators), axis=0)
    return RewardPair(rows[:, 0], rows[:, 1])


def _some_as_driven(
    key: PRNGKeyArray, drawn: RewardPair, driven: RewardPair, static: DialConfig
) -> RewardPair:
    """Return the drawn directions, but of some own rows, which are the last, those driven."""
    count = len(driven.env)
    as_driven = jax.random.uniform(key, (count,)) < static.driven_share

    def joined(new: Array, old: Array) -> Array:
        return new.at[-count:].set(jnp.where(as_driven, old, new[-count:]))

    return jax.tree.map(joined, drawn, driven)


@runtime_checkable
class AngleRange(Protocol):
    """Angles that a static config trains for, in degrees."""

    @property
    def low(self) -> float:
        """Smallest angle."""
        ...

    @property
    def high(self) -> float:
        """Largest angle."""
        ...

    @property
    def margin(self) -> float:
        """Degrees beyond both ends in which angles are also drawn."""
        ...

    @property
    def high_from(self) -> float:
        """Angle from which `high_share` counts."""
        ...

    @property
    def high_share(self) -> float | None:
        """Share of the drawn angles beyond `high_from`; None: uniform."""
        ...


def draw_directions(key: PRNGKeyArray, size: int, static: AngleRange) -> RewardPair:
    """Draw (cos α, sin α), α between the structure's `low` and `high` and its margin.

    α is uniform, or with `high_share` uniform on each side of `high_from`.
    """
    low, high = static.low - static.margin, static.high + static.margin
    if static.high_share is None:
        angles = jax.random.uniform(key, (size,), minval=low, maxval=high)
    else:
        angles = angles_at(jax.random.uniform(key, (size,)), static)
    radians = jnp.deg2rad(angles)
    return RewardPair(jnp.cos(radians), jnp.sin(radians))


def angles_at(shares: Any, static: AngleRange) -> Any:
    """Return the angles in degrees below which these shares of the drawn ones lie.

    Args:
        shares: Numbers in [0, 1], a NumPy or JAX array.
        static: Structure with a `high_share`.
    """
    assert static.high_share is not None
    low, high = static.low - static.margin, static.high + static.margin
    below, middle = 1.0 - static.high_share, static.high_from
    xp = shares.__array_namespace__()
    return xp.where(
        shares < below,
        low + (middle - low) * shares / max(below, 1e-12),
        high - (high - middle) * (1.0 - shares) / max(static.high_share, 1e-12),
    )


def stratified_angles(
    static: AngleRange, count: int, rng: np.random.Generator
) -> Float[np.ndarray, " count"]:
    """Return α in degrees, one as drawn within each of `count` equal parts of the angles."""
    places = np.arange(count) + rng.random(count)
    if static.high_share is None:
        low, high = static.low - static.margin, static.high + static.margin
        return low + (high - low) * places / count
    return angles_at(places / count, static)


def at_other_times(
    key: PRNGKeyArray,
    batch: Batch,
    horizon: int,
    timeout_reward: float = 0.0,
    share: float = 1.0,
) -> Batch:
    """The same transitions at newly drawn times: the clock's feature and its timeouts change.

    Args:
        key: Random key.
        batch: Transitions whose observations end with the time.
        horizon: At which an episode is cut.
        timeout_reward: r_env of a timeout itself, which is moved too.
        share: Of the rows that get another time; the others keep theirs.
    """
    time = draw_between(key, len(batch.action), 0, jnp.asarray(horizon))
    if share < 1.0:
        recorded = batch.observation[:, -1].astype(jnp.int32)
        for_share = jax.random.fold_in(key, 1)
        time = jnp.where(jax.random.uniform(for_share, time.shape) < share, time, recorded)
    ended = (batch.ending != int(Ending.NONE)) & (batch.ending != int(Ending.TIMEOUT))
    cut = jnp.where(time == horizon - 1, int(Ending.TIMEOUT), int(Ending.NONE))
    ending, target = jnp.where(ended, batch.ending, cut), batch.target
    if timeout_reward:
        now, before = (kinds == int(Ending.TIMEOUT) for kinds in (ending, batch.ending))
        moved = now.astype(jnp.float32) - before.astype(jnp.float32)
        target = target._replace(env=target.env + timeout_reward * moved)
    return batch._replace(
        observation=batch.observation.at[:, -1].set(time.astype(jnp.float32)),
        next_observation=batch.next_observation.at[:, -1].set((time + 1).astype(jnp.float32)),
        ending=ending,
        target=target,
    )
