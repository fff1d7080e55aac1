"""T-REX (Brown et al. 2019): a reward from ranked episodes, and reinforcement learning on it.

Episodes are ranked by R(α). The reward r(s, a) explains the ranks of pairs; soft Q-learning on it
acts in the world meanwhile. The paper has two stages and a reward of observations alone: in these
worlds a state doesn't show what was done.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners.baselines.bellman import of_taken, soft_continuation
from socialiq.learners.baselines.ranking import Episodes, preference_loss
from socialiq.learners.expert_table import Batch, ExpertTable
from socialiq.learners.iq_learn import config
from socialiq.learners.iq_learn.train import Carry, IQLearn
from socialiq.learners.kernel import Terms
from socialiq.learners.settings import check_counts
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import score
from socialiq.types import Simulator, Transitions


@dataclass(frozen=True)
class StaticConfig(config.IQLearnConfig):
    """Choices that shape the program; those of acting are IQ-Learn's."""

    pairs: int = 8
    """Pairs of episodes of an update."""

    def __post_init__(self) -> None:
        """Refuse sizes that make no run."""
        super().__post_init__()
        check_counts(self, ("pairs",))


class Networks(eqx.Module):
    """Q(s, ·), which acts, and the learned reward r(s, ·)."""

    values: QNetwork
    reward: QNetwork

    def __call__(self, observation: Array) -> Array:
        """Return Q of one observation."""
        return self.values(observation)


class Drawn(NamedTuple):
    """Rows of one update.

    Attributes:
        replay: The learner's own transitions.
        pairs: Rows of both episodes of each pair, (2, pair, step) leading.
        inside: Whether such a place is a row.
        better: R(α) of the first episode less that of the second.
    """

    replay: Batch
    pairs: Batch
    inside: Array
    better: Array


class TREX(IQLearn):
    """Reward from ranks, and soft Q-learning on it.

    Attributes:
        episodes: Episodes of the table.
    """

    episodes: Episodes | None = None

    StaticConfig: ClassVar[type] = StaticConfig
    Hyperparameters: ClassVar[type] = config.IQLearnHyperparameters
    name: ClassVar[str] = "trex"

    @classmethod
    def of(
        cls, static: Any, datasets: Sequence[Transitions], simulator: Simulator | None = None
    ) -> TREX:
        """Make the learner of sets of demonstrations and the world to act in."""
        table = ExpertTable.of(datasets, "instantaneous", 1.0)
        sizes = (int(datasets[0].observation.shape[1]), datasets[0].n_actions)
        episodes = Episodes.of(datasets, table)
        return cls(static, sizes, table, simulator=simulator, episodes=episodes)

    def network(self, key: PRNGKeyArray) -> Networks:
        """Draw both networks."""
        for_reward = jax.random.fold_in(key, 1)
        return Networks(super().network(key), super().network(for_reward))

    def draw(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, hyperparameters: HyperparameterArrays, state: TrainState, carry: Carry
    ) -> tuple[Drawn, Carry]:
        """Act, sample the replay, and draw pairs of episodes."""
        assert self.table is not None and self.episodes is not None
        batches, carry = super().draw(hyperparameters, state, carry)
        assert batches.replay is not None
        key, for_pairs = jax.random.split(carry.key)
        drawn = self.episodes.pairs(for_pairs, hyperparameters.dataset, self.static.pairs)
        both = jnp.stack(drawn)
        totals = score(hyperparameters.weights, self.episodes.totals)[both]
        return Drawn(
            batches.replay,
            self.episodes.rows_of(self.table, both),
            self.episodes.inside[both],
            totals[0] - totals[1],
        ), carry._replace(key=key)

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Ranks of pairs, and half the squared Bellman error of Q on the learned reward."""
        first, second = learned_sums(network.reward, batch)
        own = batch.replay
        follows = soft_continuation(
            target_network.values, own, hyperparameters, self.static.endings
        )
        reward = of_taken(jax.vmap(network.reward)(own.observation), own.action)
        target = hyperparameters.strength * reward + hyperparameters.discount * follows
        q = of_taken(jax.vmap(network.values)(own.observation), own.action)
        terms = {
            "ranks": preference_loss(first, second, batch.better),
            "bellman": jnp.mean(jnp.square(q - jax.lax.stop_gradient(target))) / 2,
        }
        return terms["ranks"] + terms["bellman"], terms | {
            "loss": terms["ranks"] + terms["bellman"]
        }

    def policy(self, hyperparameters: Any, state: TrainState, kept: Any = None) -> QPolicy:  # noqa: ARG002
        """Return the policy of Q."""
        record = self.record(hyperparameters)
        return QPolicy.of(state.network.values, hyperparameters.temperature, record)


def learned_sums(reward: Callable[[Array], Array], drawn: Any) -> Float[Array, "2 pair"]:
    """Return the learned reward's sums over both episodes of each pair."""
    rows = drawn.pairs
    over_rows = jax.vmap(jax.vmap(jax.vmap(reward)))
    taken = jnp.take_along_axis(over_rows(rows.observation), rows.action[..., None], axis=-1)
    return jnp.sum(jnp.where(drawn.inside, taken[..., 0], 0.0), axis=-1)
