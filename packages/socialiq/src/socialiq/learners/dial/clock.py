"""The clock of redrawn times: transitions learned from at times other than their own."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from socialiq.learners.expert_table import Batch, draw_between
from socialiq.types import Ending


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
        own = batch.observation[:, -1].astype(jnp.int32)
        for_share = jax.random.fold_in(key, 1)
        time = jnp.where(jax.random.uniform(for_share, time.shape) < share, time, own)
    ended = (batch.ending != int(Ending.NONE)) & (batch.ending != int(Ending.TIMEOUT))
    cut = jnp.where(time == horizon - 1, int(Ending.TIMEOUT), int(Ending.NONE))
    ending, target = jnp.where(ended, batch.ending, cut), batch.target
    if timeout_reward:
        now, before = (one == int(Ending.TIMEOUT) for one in (ending, batch.ending))
        moved = now.astype(jnp.float32) - before.astype(jnp.float32)
        target = target._replace(env=target.env + timeout_reward * moved)
    return batch._replace(
        observation=batch.observation.at[:, -1].set(time.astype(jnp.float32)),
        next_observation=batch.next_observation.at[:, -1].set((time + 1).astype(jnp.float32)),
        ending=ending,
        target=target,
    )
