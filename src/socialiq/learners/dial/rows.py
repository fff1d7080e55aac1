"""The rows of an update: demonstrations and own steps, each at an angle drawn for it."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, PRNGKeyArray

from socialiq.learners import replay
from socialiq.learners.dial.config import StaticConfig
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


def draw_rows(
    static: StaticConfig,
    table: ExpertTable | None,
    dataset: Array,
    ring: replay.Replay | None,
    key: Array,
) -> Rows:
    """Demonstrations, then the learner's own steps, each row at an angle drawn for it."""
    for_expert, for_replay, for_angle, for_time = jax.random.split(key, 4)
    parts: list[Batch] = []
    if static.demonstrations and table is not None:
        parts += _shown(static, table, dataset, for_expert)
    if ring is not None:
        parts.append(replay.sample(ring, for_replay, static.replay_batch))
    batch = jax.tree.map(lambda *columns: jnp.concatenate(columns), *parts)
    if static.redraw_times:
        batch = at_other_times(for_time, batch, static.redraw_times)
    n_expert = static.expert_batch if static.demonstrations else 0
    directions = draw_directions(for_angle, len(batch.action), static)
    return Rows(batch, directions, n_expert, _own_directions(static))


def _shown(static: StaticConfig, table: ExpertTable, dataset: Array, key: Array) -> list[Batch]:
    """Demonstrations; of several demonstrators as many of each, in their order."""
    count = len(static.demonstrators)
    if not count:
        return [table.sample(key, dataset, static.expert_batch)]
    return [
        table.sample(one, dataset * count + number, static.expert_batch // count)
        for number, one in enumerate(jax.random.split(key, count))
    ]


def _own_directions(static: StaticConfig) -> RewardPair | None:
    """Each demonstrator's own direction, for as many rows as there are of it."""
    if not static.demonstrators:
        return None
    pairs = jnp.array([exact_weights(angle) for angle in static.demonstrators])
    rows = jnp.repeat(pairs, static.expert_batch // len(static.demonstrators), axis=0)
    return RewardPair(rows[:, 0], rows[:, 1])


def draw_directions(key: PRNGKeyArray, size: int, static: StaticConfig) -> RewardPair:
    """Draw (cos α, sin α), α uniform between the structure's `low` and `high` and its margin."""
    low, high = static.low - static.margin, static.high + static.margin
    drawn = jax.random.uniform(key, (size,), minval=low, maxval=high)
    radians = jnp.deg2rad(drawn)
    return RewardPair(jnp.cos(radians), jnp.sin(radians))


def at_other_times(key: PRNGKeyArray, batch: Batch, horizon: int) -> Batch:
    """The same transitions at newly drawn times: the clock's feature and its timeouts change.

    Args:
        key: Random key.
        batch: Transitions whose observations end with the time.
        horizon: At which an episode is cut.
    """
    time = draw_between(key, len(batch.action), 0, jnp.asarray(horizon))
    ended = (batch.ending != int(Ending.NONE)) & (batch.ending != int(Ending.TIMEOUT))
    cut = jnp.where(time == horizon - 1, int(Ending.TIMEOUT), int(Ending.NONE))
    return batch._replace(
        observation=batch.observation.at[:, -1].set(time.astype(jnp.float32)),
        next_observation=batch.next_observation.at[:, -1].set((time + 1).astype(jnp.float32)),
        ending=jnp.where(ended, batch.ending, cut),
    )
