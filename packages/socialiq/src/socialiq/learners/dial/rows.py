"""The rows of an update: demonstrations and own steps, each at an angle drawn for it."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners.dial.config import DialConfig
from socialiq.learners.expert_table import Batch, ExpertTable, Replay, draw_between
from socialiq.learners.settings import DrawnAngles
from socialiq.social.angle import exact_weights
from socialiq.types import ByClass, Ending, RewardPair


class Rows(NamedTuple):
    """Rows of one update.

    Attributes:
        batch: Transitions; the first `n_expert` are demonstrations.
        direction: (cos α, sin α) of each row.
        n_expert: How many are demonstrations.
    """

    batch: Batch
    direction: RewardPair
    n_expert: int


class Acting(NamedTuple):
    """Running episodes in a compiled world: one, or several along the leading axis of all arrays.

    Attributes:
        episode: State of the world.
        observation: Of that state.
        direction: (cos α, sin α) at which the learner acts in the episode.
    """

    episode: Any
    observation: Array
    direction: RewardPair


def draw_rows(
    static: DialConfig,
    table: ExpertTable | None,
    dataset: Array,
    ring: Replay | None,
    key: Array,
) -> Rows:
    """Draw demonstrations, then the learner's own steps, each row at an angle drawn for it.

    Args:
        static: Config of the run.
        table: Demonstrations; None without.
        dataset: Index of the run's set of demonstrations.
        ring: The learner's own transitions; None offline.
        key: Random key.

    Returns:
        The rows: `expert_batch` demonstrations if they are used, then `replay_batch` own steps.
    """
    for_expert, for_replay, for_angle, for_time = jax.random.split(key, 4)
    batches = list[Batch]()
    driven = None
    if static.demonstrations and table is not None:
        batches.append(table.sample(for_expert, dataset, static.expert_batch))
    if ring is not None:
        sampled = ring.sample(for_replay, static.replay_batch)
        driven = sampled.direction
        batches.append(sampled._replace(direction=None))
    batch = jax.tree.map(lambda *columns: jnp.concatenate(columns), *batches)
    if static.redraw_times:
        times = (static.redraw_times, static.timeout_reward, static.redraw_share)
        batch = at_other_times(for_time, batch, *times)
    direction = draw_directions(for_angle, len(batch.action), static, static.classes)
    if driven is not None:  # some of the own rows, which are the last, are at the driven angles
        key = jax.random.fold_in(for_angle, 1)
        size = len(driven.env)
        as_driven = jax.random.uniform(key, (size,)) < static.driven_share

        def joined(new: Array, old: Array) -> Array:
            return new.at[-size:].set(jnp.where(as_driven, old, new[-size:]))

        direction = jax.tree.map(joined, direction, driven)
    return Rows(batch, direction, static.expert_batch if static.demonstrations else 0)


def draw_directions(
    key: PRNGKeyArray, size: int, static: DrawnAngles, classes: bool = False
) -> RewardPair:
    """Draw (cos α, sin α), α between the config's `low` and `high` and its margin.

    α is uniform, or with `high_share` uniform on each side of `high_from`.

    Args:
        key: Random key.
        size: Number of directions.
        static: Config with the range of angles.
        classes: Whether sin α has parts by class, of a class angle drawn uniformly between 0 and 90
            degrees and the margin.

    Returns:
        The directions, each part (size,).
    """
    low = static.low - static.margin
    high = static.high + static.margin
    if static.high_share is None:
        angles = jax.random.uniform(key, (size,), minval=low, maxval=high)
    else:
        angles = _angles_at(jax.random.uniform(key, (size,)), static)
    radians = jnp.deg2rad(angles)
    env = jnp.cos(radians)
    social = jnp.sin(radians)
    if not classes:
        return RewardPair(env, social)
    low = -static.margin
    high = 90.0 + static.margin
    key = jax.random.fold_in(key, 1)
    of_class = jnp.deg2rad(jax.random.uniform(key, (size,), minval=low, maxval=high))
    return RewardPair(env, ByClass(social * jnp.cos(of_class), social * jnp.sin(of_class)))


def stratified_angles(
    static: DrawnAngles, count: int, rng: np.random.Generator
) -> Float[np.ndarray, " count"]:
    """Return angles, one as drawn within each of `count` equal parts of the angles.

    Args:
        static: Config with the range of angles.
        count: Number of angles.
        rng: Random numbers.

    Returns:
        The angles in degrees, in ascending order.
    """
    places = np.arange(count) + rng.random(count)
    if static.high_share is None:
        low = static.low - static.margin
        high = static.high + static.margin
        return low + (high - low) * places / count
    return _angles_at(places / count, static)


def stratified(static: DrawnAngles, count: int, rng: np.random.Generator) -> RewardPair:
    """Return the directions of `stratified_angles`.

    Args:
        static: Config with the range of angles.
        count: Number of directions.
        rng: Random numbers.

    Returns:
        (cos α, sin α), each (count,), float32.
    """
    angles = stratified_angles(static, count, rng)
    pairs = np.array([exact_weights(angle) for angle in angles.tolist()], np.float32)
    return RewardPair(pairs[:, 0], pairs[:, 1])


def _angles_at(shares: Any, static: DrawnAngles) -> Any:
    """Return the angles in degrees below which these shares of the drawn ones lie."""
    assert static.high_share is not None
    low = static.low - static.margin
    high = static.high + static.margin
    below = 1.0 - static.high_share
    middle = static.high_from
    return shares.__array_namespace__().where(
        shares < below,
        low + (middle - low) * shares / max(below, 1e-12),
        high - (high - middle) * (1.0 - shares) / max(static.high_share, 1e-12),
    )


def at_other_times(
    key: PRNGKeyArray,
    batch: Batch,
    horizon: int,
    timeout_reward: float = 0.0,
    share: float = 1.0,
) -> Batch:
    """Return the same transitions at newly drawn times: the clock's feature and timeouts change.

    Args:
        key: Random key.
        batch: Transitions whose observations end with the time.
        horizon: Number of steps after which an episode is cut.
        timeout_reward: r_env of a timeout itself, which is moved too.
        share: Share of the rows that gets another time.

    Returns:
        The transitions, with changed observations, endings and targets.
    """
    time = draw_between(key, len(batch.action), 0, jnp.asarray(horizon))
    if share < 1.0:
        recorded = batch.observation[:, -1].astype(jnp.int32)
        for_share = jax.random.fold_in(key, 1)
        time = jnp.where(jax.random.uniform(for_share, time.shape) < share, time, recorded)
    ended = (batch.ending != int(Ending.NONE)) & (batch.ending != int(Ending.TIMEOUT))
    cut = jnp.where(time == horizon - 1, int(Ending.TIMEOUT), int(Ending.NONE))
    ending = jnp.where(ended, batch.ending, cut)
    target = batch.target
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
