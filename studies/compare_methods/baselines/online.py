"""Learners that act in the world: LS-IQ, T-REX, and the inferred rewards of ParIRL.

LS-IQ (Al-Hafez et al. 2023): with the penalty c/2 (E_E[r̂²] + E_π[r̂²]) IQ-Learn's objective is, but
for a constant, c/2 E_E[(r̂ - 1/c)²] + c/2 E_π[(r̂ + 1/c)²], so demonstrated transitions have the
reward 1/c and the learner's own -1/c. LS-IQ gives Q of a demonstrated action its largest value
1/(c (1 - γ)) as a fixed target, bounds the values that follow, and lets an episode's end be a state
for ever, whose reward is the mean over those that end there.

T-REX (Brown et al. 2019): the reward r(s, a) explains the ranks by R(α) of pairs of episodes; soft
Q-learning on it acts in the world meanwhile. The paper has two stages and a reward of observations
alone: in these worlds a state doesn't show what was done.

ParIRL (Kim et al. 2024): a reward is inferred for the egoists and one for the altruists. A policy
in between is one of their mean, weighted by its preference. One network conditioned on the
preference learns all of them by acting. The paper distils the front into a diffusion model and
measures distances of rewards by EPIC; here both are linear, so the network can learn the
interpolated rewards themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from socialiq.learners import settings
from socialiq.learners.collect import Source
from socialiq.learners.expert_table import Batch, ExpertTable
from socialiq.learners.iq_learn import config, losses
from socialiq.learners.iq_learn.train import Carry, IQLearn
from socialiq.learners.kernel import Terms
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import score
from socialiq.types import Act, Ending, RewardPair, Simulator, Transitions
from studies.compare_methods.baselines.shared import (
    Episodes,
    learned_sums,
    of_taken,
    preference_loss,
    soft_continuation,
)


@dataclass(frozen=True)
class LSIQConfig(config.IQLearnConfig):
    """Choices that shape the program; those of acting are IQ-Learn's."""

    fixed_target: bool = True
    """Whether Q of demonstrated actions has a fixed target, or r̂ has the target 1/c."""


@dataclass(frozen=True)
class LSIQHyperparameters(config.IQLearnHyperparameters):
    """Numbers of one run, all traced."""

    regularisation: settings.Positive = 0.5
    """c: rewards lie between -1/c and 1/c."""


class LSIQ(IQLearn):
    """Least-squares inverse Q-learning; acts with softmax(Q/τ)."""

    StaticConfig: ClassVar[type] = LSIQConfig
    Hyperparameters: ClassVar[type] = LSIQHyperparameters
    name: ClassVar[str] = "ls_iq"

    @classmethod
    def of(
        cls, static: Any, datasets: Sequence[Transitions], simulator: Simulator | None = None
    ) -> LSIQ:
        """Make the learner of sets of demonstrations and the world to act in."""
        table = ExpertTable.of(datasets, "instantaneous", 1.0)
        sizes = (int(datasets[0].observation.shape[1]), datasets[0].n_actions)
        return cls(static, sizes, table, simulator=simulator)

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Half the squared distances of demonstrations and of own transitions to their targets."""
        largest = 1.0 / hyperparameters.regularisation
        absorbing = absorbing_reward(batch.expert.ending, batch.replay.ending, largest)
        terms = {}
        for name, rows, reward in (
            ("expert", batch.expert, largest),
            ("own", batch.replay, -largest),
        ):
            target = reward + hyperparameters.discount * bounded_value(
                target_network, rows, hyperparameters, largest, absorbing
            )
            if name == "expert" and self.static.fixed_target:
                target = jnp.full_like(target, largest / (1.0 - hyperparameters.discount))
            q = of_taken(jax.vmap(network)(rows.observation), rows.action)
            terms[name] = jnp.mean(jnp.square(q - jax.lax.stop_gradient(target))) / 2
        total = terms["expert"] + terms["own"]
        return total, terms | {"loss": total}


def absorbing_reward(
    expert: Array, own: Array, largest: Float[Array, ""] | float
) -> Float[Array, ""]:
    """Return the least-squares reward of the state after the end: 1/c and -1/c by their shares.

    Args:
        expert: Endings of demonstrations, values of `types.Ending`.
        own: Endings of the learner's own transitions.
        largest: 1/c.
    """
    ended = [jnp.sum(ending != int(Ending.NONE)) for ending in (expert, own)]
    return largest * (ended[0] - ended[1]) / jnp.maximum(ended[0] + ended[1], 1)


def bounded_value(
    network: Any,
    rows: Batch,
    hyperparameters: HyperparameterArrays,
    largest: Float[Array, ""],
    absorbing: Float[Array, ""],
) -> Float[Array, " batch"]:
    """Return V(s') within ±1/(c (1 - γ)); after the end that of the absorbing state."""
    bound = largest / (1.0 - hyperparameters.discount)
    value = losses.soft_value(jax.vmap(network)(rows.next_observation), hyperparameters.temperature)
    value = jnp.clip(value, -bound, bound)
    ended = rows.ending != int(Ending.NONE)
    return jnp.where(ended, absorbing / (1.0 - hyperparameters.discount), value)


@dataclass(frozen=True)
class TREXConfig(config.IQLearnConfig):
    """Choices that shape the program; those of acting are IQ-Learn's."""

    pairs: settings.Count = 8
    """Pairs of episodes of an update."""


class TREXNetworks(eqx.Module):
    """Q(s, ·), which acts, and the learned reward r(s, ·)."""

    values: QNetwork
    reward: QNetwork

    def __call__(self, observation: Array) -> Array:
        """Return Q of one observation."""
        return self.values(observation)


class TREXRows(NamedTuple):
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

    StaticConfig: ClassVar[type] = TREXConfig
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

    def network(self, key: PRNGKeyArray) -> TREXNetworks:
        """Draw both networks."""
        for_reward = jax.random.fold_in(key, 1)
        return TREXNetworks(super().network(key), super().network(for_reward))

    def draw(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, hyperparameters: HyperparameterArrays, state: TrainState, carry: Carry
    ) -> tuple[TREXRows, Carry]:
        """Act, sample the replay, and draw pairs of episodes."""
        assert self.table is not None and self.episodes is not None
        batches, carry = super().draw(hyperparameters, state, carry)
        assert batches.replay is not None
        key, for_pairs = jax.random.split(carry.key)
        pairs = self.episodes.pairs(for_pairs, hyperparameters.dataset, self.static.pairs)
        sides = jnp.stack(pairs)
        totals = score(hyperparameters.weights, self.episodes.totals)[sides]
        return TREXRows(
            batches.replay,
            self.episodes.rows_of(self.table, sides),
            self.episodes.inside[sides],
            totals[0] - totals[1],
        ), carry._replace(key=key)

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Ranks of pairs, and half the squared Bellman error of Q on the learned reward."""
        first, second = learned_sums(network.reward, batch)
        replay = batch.replay
        follows = soft_continuation(
            target_network.values, replay, hyperparameters, self.static.endings
        )
        reward = of_taken(jax.vmap(network.reward)(replay.observation), replay.action)
        target = hyperparameters.strength * reward + hyperparameters.discount * follows
        q = of_taken(jax.vmap(network.values)(replay.observation), replay.action)
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


class InferredReward(eqx.Module):
    """Reward that a trained IQ-Learn implies, r̂ = Q(s, a) - γ (1 - d) V(s') (Eq 2.6).

    Attributes:
        network: Its Q.
        temperature: τ of V.
        discount: γ.
    """

    network: QNetwork
    temperature: float
    discount: float

    def __call__(
        self,
        observation: Float[Array, " feature"],
        action: Int[Array, ""],
        following: Float[Array, " feature"],
        ending: Int[Array, ""],
    ) -> Float[Array, ""]:
        """Return r̂ of one transition; after any ending nothing follows."""
        value = losses.soft_value(self.network(following), self.temperature)
        follows = jnp.where(ending == int(Ending.NONE), value, 0.0)
        return self.network(observation)[action] - self.discount * follows


Rewards = tuple[InferredReward, InferredReward]
"""The egoists' and the altruists' rewards."""


@eqx.filter_jit
def inferred_pair(rewards: Rewards, batch: Batch) -> RewardPair:
    """Return the pair of inferred rewards of transitions, in the place of (r_env, r_social)."""
    columns = (batch.observation, batch.action, batch.next_observation, batch.ending)
    return RewardPair(*(jax.vmap(reward)(*columns) for reward in rewards))


def inferring(source: Source, rewards: Rewards) -> Source:
    """Return a source outside JAX whose pair of rewards is inferred."""

    def relabelled(act: Act, rng: Any) -> Batch:
        batch = source(act, rng)
        return batch._replace(target=inferred_pair(rewards, batch))

    return relabelled
