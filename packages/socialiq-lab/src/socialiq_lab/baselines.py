"""Parts of learners that several studies share, from methods that others have published.

`socialiq.learners.kernel` trains them all. Demonstrations lie in an `ExpertTable`, of which
`Episodes` knows the episodes and ranks them by R(α).
"""

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from socialiq import QPolicy, RewardPair, score
from socialiq.learners import expert_table, kernel
from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.iq_learn.train import IQLearn
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.q_network import QNetwork
from socialiq.types import Transitions


def of_taken(
    values: Float[Array, "batch action"], action: Int[Array, " batch"]
) -> Float[Array, " batch"]:
    """Return the values of the actions that were taken.

    Args:
        values: Value of each action, (batch, action).
        action: Number of the taken action, (batch,).
    """
    return jnp.take_along_axis(values, action[:, None], axis=1)[:, 0]


def log_likelihood(
    logits: Float[Array, "batch action"], action: Int[Array, " batch"]
) -> Float[Array, " batch"]:
    """Return log π(a|s) of the taken actions, with π = softmax of the logits.

    Args:
        logits: Logit of each action, (batch, action).
        action: Number of the taken action, (batch,).
    """
    return of_taken(jax.nn.log_softmax(logits), action)


def soft_continuation(
    network: Any, batch: expert_table.Batch, hyperparameters: Any, endings: Endings
) -> Float[Array, " batch"]:
    """Return (1 - d) V(s') of Eq 2.6, with V(s') = τ logsumexp(Q(s', ·)/τ).

    Args:
        network: Q of one observation; commonly the target network.
        batch: Rows of transitions.
        hyperparameters: Numbers of the run; τ and γ are read.
        endings: Treatment of each kind of ending.
    """
    q_next = jax.vmap(network)(batch.next_observation)
    temperature = hyperparameters.temperature
    discount = hyperparameters.discount
    return losses.continuation(
        losses.soft_value(q_next, temperature),
        batch.ending,
        endings.by_kind(),
        losses.absorbing_value(q_next.shape[-1], temperature, discount),
    )


def totals_of(data: Transitions) -> Float[np.ndarray, "episode 2"]:
    """Return the undiscounted totals (G_env, G_social) of each episode."""
    returns = data.returns("trajectory", 1.0)
    return np.stack([total[data.episode_starts] for total in returns], axis=1)


def summed(terms: dict[str, Array]) -> tuple[Array, dict[str, Array]]:
    """Return the sum of a loss' terms, and the terms with the sum as "loss"."""
    total = jnp.sum(jnp.stack(list(terms.values())))
    return total, terms | {"loss": total}


class Pairs(NamedTuple):
    """Pairs of episodes whose ranks are known; both episodes' rows are (2, pair, step) leading."""

    rows: expert_table.Batch
    inside: Array  # whether an element is a row of the episode
    better: Array  # by how much the first episode is better than the second; 0 leaves the pair out


def preference_loss(reward: Callable[[Array], Array], pairs: Pairs) -> Float[Array, ""]:
    """Return -log P(ranks), P(first) = σ(Σ r of the first - Σ r of the second) (T-REX, their Eq 1).

    Args:
        reward: Function that returns the rewards of all actions, given one observation.
        pairs: Pairs of episodes, of which those of equal rank add 0.

    Returns:
        The mean over all pairs.
    """
    over_rows = jax.vmap(jax.vmap(jax.vmap(reward)))(pairs.rows.observation)
    taken = jnp.take_along_axis(over_rows, pairs.rows.action[..., None], axis=-1)
    first, second = jnp.sum(jnp.where(pairs.inside, taken[..., 0], 0.0), axis=-1)
    side = jnp.sign(pairs.better)
    return jnp.mean(jnp.abs(side) * jax.nn.softplus(-side * (first - second)))


class Episodes(NamedTuple):
    """Episodes of one or more sets of demonstrations, in the order of an `ExpertTable`.

    Attributes:
        rows: Rows of each episode in the table, filled up with 0.
        inside: Whether an element of `rows` is a row of the episode.
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
    def of(datasets: Sequence[Transitions], table: expert_table.ExpertTable) -> "Episodes":
        """Lay out the episodes of the sets that a table was made of.

        Args:
            datasets: Sets of demonstrations, in the order of the table.
            table: Table of these sets.
        """
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

    def levels(
        self, weights: RewardPair, dataset: Int[Array, ""], count: int
    ) -> Int[Array, " episode"]:
        """Return each episode's level by R(α) in its set.

        Args:
            weights: (cos α, sin α) of R(α).
            dataset: Number of the set.
            count: Number of levels.

        Returns:
            Level of each episode: 0 is the best, and `count` marks episodes of another set. Of
            equal episodes all have the better level.
        """
        numbers = jnp.arange(self.inside.shape[0])
        in_set = (numbers >= self.bounds[dataset]) & (numbers < self.bounds[dataset + 1])
        scores = jnp.where(in_set, score(weights, self.totals), -jnp.inf)
        above = len(scores) - jnp.searchsorted(
            jnp.sort(scores), scores, side="right"
        )  # ties: the better level
        return jnp.where(in_set, count * above // jnp.sum(in_set), count)

    def pairs(
        self,
        table: expert_table.ExpertTable,
        key: PRNGKeyArray,
        dataset: Int[Array, ""],
        size: int,
        scores: Float[Array, " episode"],
    ) -> Pairs:
        """Draw pairs of episodes of one set with replacement, ranked by the episodes' scores.

        Args:
            table: Table that has the rows of the episodes.
            key: Random key.
            dataset: Number of the set.
            size: Number of pairs.
            scores: Score of each episode; a larger one is better.
        """
        bounds = self.bounds[dataset], self.bounds[dataset + 1]
        sides = expert_table.draw_between(key, 2 * size, *bounds).reshape(2, size)
        rows = jax.tree.map(lambda column: column[self.rows[sides]], table.columns)
        first, second = scores[sides]
        return Pairs(rows, self.inside[sides], first - second)


class Carry(NamedTuple):
    """A random key, and what a learner knows of its demonstrations or their episodes."""

    key: Array
    known: Array


class Baseline(kernel.Learner):
    """Base class of learners whose network has several parts, of which one is the policy."""

    table: Any = None
    episodes: Any = None
    acting: ClassVar[str] = "policy"  # or "values", by softmax(Q/τ)

    def conditioned_network(self, key: PRNGKeyArray) -> DialNetwork:
        """Draw a network with two inputs in addition to the observation."""
        static = self.static
        n_features, n_actions = self.sizes
        shape = (static.hidden, n_actions, static.activation, static.view)
        return DialNetwork.initialise(key, n_features, *shape)

    def policy(self, hyperparameters: Any, state: Any, _retained: Any = None) -> Any:
        """Return the policy of the acting part.

        Args:
            hyperparameters: Numbers of the run.
            state: State of the run, with the trained network.
        """
        temperature = 1.0 if self.acting == "policy" else hyperparameters.temperature
        network = getattr(state.network, self.acting)
        return QPolicy.of(network, temperature, self.record(hyperparameters))


class EpisodeLearner(Baseline):
    """Base class of learners that see demonstrations by episodes."""

    @classmethod
    def of(cls, static: Any, datasets: Sequence[Transitions]) -> Any:
        """Make the learner of sets of demonstrations and their episodes.

        Args:
            static: Static configuration of all runs.
            datasets: Sets of demonstrations.
        """
        learner: Any = super().of(static, datasets)
        return cls(static, learner.sizes, learner.table, Episodes.of(datasets, learner.table))

    def rows(self, key: PRNGKeyArray, dataset: Int[Array, ""]) -> Int[Array, " batch"]:
        """Draw the numbers of demonstrated rows of one set, uniformly and with replacement.

        Args:
            key: Random key.
            dataset: Number of the set.

        Returns:
            Numbers of rows of the table, as many as a batch has.
        """
        bounds = self.table.row_bounds[dataset], self.table.row_bounds[dataset + 1]
        return expert_table.draw_between(key, self.static.batch_size, *bounds)


class ValuesLearner(IQLearn):
    """Base class of learners that act in the world, whose network has Q as its part `values`."""

    def bellman_error(
        self, network: Any, target_network: Any, rows: expert_table.Batch, reward: Any, run: Any
    ) -> Float[Array, ""]:
        """Return half the squared Bellman error of Q on a reward.

        Args:
            network: Network of the learner.
            target_network: Slow copy of the network, whose Q gives the value of the next
                observation.
            rows: The learner's own rows.
            reward: Reward of each row.
            run: Numbers of the run.
        """
        follows = soft_continuation(target_network.values, rows, run, self.static.endings)
        target = reward + run.discount * follows
        q = of_taken(jax.vmap(network.values)(rows.observation), rows.action)
        return jnp.mean(jnp.square(q - jax.lax.stop_gradient(target))) / 2

    def policy(self, hyperparameters: Any, state: Any, _retained: Any = None) -> QPolicy:
        """Return the policy of Q.

        Args:
            hyperparameters: Numbers of the run.
            state: State of the run, with the trained networks.
        """
        record = self.record(hyperparameters)
        return QPolicy.of(state.network.values, hyperparameters.temperature, record)


class ActingByValues(eqx.Module):
    """Base class of networks whose part `values` acts."""

    values: QNetwork

    def __call__(self, observation: Array) -> Array:
        """Return Q of one observation."""
        return self.values(observation)
