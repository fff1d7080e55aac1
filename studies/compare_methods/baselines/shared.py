"""Parts that baselines share: values of taken actions, episodes ranked by R(α), losses of ranks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from socialiq.learners.expert_table import Batch, ExpertTable, draw_between
from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.kernel import Learner
from socialiq.learners.state import HyperparameterArrays
from socialiq.social.angle import score
from socialiq.types import RewardPair, Transitions


def of_taken(
    values: Float[Array, "batch action"], action: Int[Array, " batch"]
) -> Float[Array, " batch"]:
    """Return the values of the actions that were taken."""
    return jnp.take_along_axis(values, action[:, None], axis=1)[:, 0]


def soft_continuation(
    network: Any, batch: Batch, hyperparameters: HyperparameterArrays, endings: Endings
) -> Float[Array, " batch"]:
    """(1 - d) V(s') of Eq 2.6, with V(s') = τ logsumexp(Q(s', ·)/τ) of the given network."""
    q_next = jax.vmap(network)(batch.next_observation)
    return losses.continuation(
        losses.soft_value(q_next, hyperparameters.temperature),
        batch.ending,
        endings.by_kind(),
        losses.absorbing_value(
            q_next.shape[-1], hyperparameters.temperature, hyperparameters.discount
        ),
    )


def log_likelihood(
    logits: Float[Array, "batch action"], action: Int[Array, " batch"]
) -> Float[Array, " batch"]:
    """Return log π(a|s) of the taken actions, π = softmax of the logits."""
    return of_taken(jax.nn.log_softmax(logits), action)


class Episodes(NamedTuple):
    """Episodes of one or more sets of demonstrations, in the order of an `ExpertTable`.

    Attributes:
        rows: Rows of each episode in the table, filled up with 0.
        inside: Whether such a place is a row of the episode.
        of_row: Episode of each row of the table; of its empty rows one beyond the last.
        totals: Undiscounted totals of each episode.
        bounds: First episode of each set, and the end.
    """

    rows: Int[Array, "episode step"]
    inside: Bool[Array, "episode step"]
    of_row: Int[Array, " transition"]
    totals: RewardPair
    bounds: Int[Array, " bound"]

    @staticmethod
    def of(datasets: Sequence[Transitions], table: ExpertTable) -> Episodes:
        """Lay out the episodes of the sets that a table was made of."""
        lengths = np.concatenate(
            [np.diff(data.episode_starts, append=len(data.action)) for data in datasets]
        )
        starts = np.cumsum(lengths) - lengths
        steps = np.arange(lengths.max())
        inside = steps < lengths[:, None]
        of_row = np.full(table.columns.action.shape[0], len(lengths))
        of_row[: lengths.sum()] = np.repeat(np.arange(len(lengths)), lengths)
        totals = np.concatenate([totals_of(data) for data in datasets])
        return Episodes(
            jnp.asarray(np.where(inside, starts[:, None] + steps, 0), jnp.int32),
            jnp.asarray(inside),
            jnp.asarray(of_row, jnp.int32),
            RewardPair(*jnp.asarray(totals.T, jnp.float32)),
            table.start_bounds,
        )

    def rows_of(self, table: ExpertTable, episodes: Int[Array, "*shape"]) -> Batch:
        """Return the rows of episodes, in columns of the shape ``(*shape, step)``."""
        places = self.rows[episodes]
        return jax.tree.map(lambda column: column[places], table.columns)

    def levels(
        self, weights: RewardPair, dataset: Int[Array, ""], count: int
    ) -> Int[Array, " episode"]:
        """Return each episode's level by R(α) in its set: 0 is the best, `count` of another set.

        Episodes of equal scores share the better level, so that the best level is never empty.
        """
        places = jnp.arange(self.inside.shape[0])
        in_set = (places >= self.bounds[dataset]) & (places < self.bounds[dataset + 1])
        scores = jnp.where(in_set, score(weights, self.totals), -jnp.inf)
        above = len(scores) - jnp.searchsorted(jnp.sort(scores), scores, side="right")
        return jnp.where(in_set, count * above // jnp.sum(in_set), count)

    def pairs(
        self, key: PRNGKeyArray, dataset: Int[Array, ""], size: int
    ) -> tuple[Int[Array, " pair"], Int[Array, " pair"]]:
        """Draw pairs of episodes of one set, with replacement."""
        episodes = draw_between(key, 2 * size, self.bounds[dataset], self.bounds[dataset + 1])
        return episodes[:size], episodes[size:]


class EpisodeLearner(Learner):
    """Base class of learners that see demonstrations by episodes.

    Attributes:
        episodes: Episodes of the table.
    """

    episodes: Episodes | None = None

    @classmethod
    def of(cls, static: Any, datasets: Sequence[Transitions]) -> Any:
        """Make the learner of sets of demonstrations."""
        table = ExpertTable.of(datasets, "instantaneous", 1.0)
        sizes = (int(datasets[0].observation.shape[1]), datasets[0].n_actions)
        return cls(static, sizes, table, Episodes.of(datasets, table))


def best_rows(
    episodes: Episodes, weights: RewardPair, dataset: Int[Array, ""], parts: int
) -> Float[Array, " transition"]:
    """Return the cumulative weights by which `ExpertTable.sample_weighted` draws the best episodes.

    Args:
        episodes: Episodes of the table.
        weights: (cos α, sin α).
        dataset: The set.
        parts: One part in so many is drawn from.
    """
    levels = jnp.append(episodes.levels(weights, dataset, parts), parts)
    best = levels[episodes.of_row] == 0
    return jnp.cumsum(best / jnp.sum(best))


def preference_loss(
    first: Float[Array, " pair"],
    second: Float[Array, " pair"],
    better: Float[Array, " pair"],
) -> Float[Array, ""]:
    """-log P of the ranks under Bradley and Terry, P(first) = σ(first - second) (T-REX, Eq 1).

    Args:
        first: Learned sums of the first episodes.
        second: Of the second ones.
        better: True sums' difference, first minus second; where it is 0 the pair is left out.
    """
    side = jnp.sign(better)
    return jnp.mean(jnp.abs(side) * jax.nn.softplus(-side * (first - second)))


def totals_of(data: Transitions) -> Float[np.ndarray, "episode 2"]:
    """Return the undiscounted totals (G_env, G_social) of each episode."""
    returns = data.returns("trajectory", 1.0)
    return np.stack([total[data.episode_starts] for total in returns], axis=1)


def learned_sums(reward: Callable[[Array], Array], drawn: Any) -> Float[Array, "2 pair"]:
    """Return the learned reward's sums over both episodes of each pair."""
    rows = drawn.pairs
    over_rows = jax.vmap(jax.vmap(jax.vmap(reward)))
    taken = jnp.take_along_axis(over_rows(rows.observation), rows.action[..., None], axis=-1)
    return jnp.sum(jnp.where(drawn.inside, taken[..., 0], 0.0), axis=-1)
