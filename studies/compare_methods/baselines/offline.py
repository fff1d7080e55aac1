"""Learners of values from demonstrations alone: IQL on R(α), and SPRINQL's objective.

IQL (Kostrikov et al. 2022): V is an upper expectile of Q over the demonstrated actions, Q is fitted
to r + γ V(s'), and the policy clones the demonstrations with the weight exp(β (Q - V)). So Q is
never asked for an action that the data don't have.

SPRINQL (Hoang et al. 2024): IQ-Learn with graded demonstrators. Episodes have levels of expertise,
here by R(α). A reference reward in (0, 1), learned from the ranks of the levels, gives level i its
weight w_i, the mean reference reward of its transitions as a share of all levels', and is what r̂ is
drawn to. With U the mixture of the levels by their weights, and β the conservative weight:

    - Σ_i w_i E_i[r̂] + E_U[V(s) - γ (1 - d) V(s')] + a E_U[(r̂ - λ r_ref)²] + β E_U[V(s) - Q(s, a)].
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners import settings
from socialiq.learners.expert_table import Batch, draw_between
from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.kernel import Learner, Terms
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import score
from studies.compare_methods.baselines.shared import (
    EpisodeLearner,
    learned_sums,
    log_likelihood,
    of_taken,
    preference_loss,
    soft_continuation,
)

LARGEST_WEIGHT = 100.0
"""Bound of exp(β (Q - V)), as in the paper."""


@dataclass(frozen=True)
class IQLConfig(settings.LearnerConfig):
    """Choices that shape the program."""

    endings: Endings = field(default_factory=Endings)
    """Value of V(s') after each kind of ending."""


@dataclass(frozen=True)
class IQLHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced."""

    expectile: settings.Share = 0.7
    """Expectile of Q over demonstrated actions that V is: 0.5 the mean, towards 1 the maximum."""
    inverse_temperature: settings.Positive = 3.0
    """β of the policy's weights."""


class IQLNetworks(NamedTuple):
    """Q(s, ·), V(s), and the policy's logits."""

    values: QNetwork
    state_value: QNetwork
    policy: QNetwork


class ImplicitQLearning(Learner):
    """Implicit Q-learning of demonstrations; the policy is a network of its own."""

    StaticConfig: ClassVar[type] = IQLConfig
    Hyperparameters: ClassVar[type] = IQLHyperparameters
    name: ClassVar[str] = "implicit_q_learning"

    def network(self, key: PRNGKeyArray) -> IQLNetworks:
        """Draw three networks of the same hidden layers."""
        static, (n_features, n_actions) = self.static, self.sizes
        return IQLNetworks(
            *(
                QNetwork.initialise(
                    of_part,
                    n_features,
                    static.hidden,
                    outputs,
                    static.activation,
                    static.view,
                    scale=static.input_scale,
                )
                for of_part, outputs in zip(
                    jax.random.split(key, 3), (n_actions, 1, n_actions), strict=True
                )
            )
        )

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Sum of the three losses; none has a gradient in another's network."""
        return implicit_loss(network, target_network, batch, hyperparameters, self.static)

    def policy(self, hyperparameters: Any, state: TrainState, kept: Any = None) -> QPolicy:  # noqa: ARG002
        """Return the cloned policy."""
        return QPolicy.of(state.network.policy, 1.0, self.record(hyperparameters))


def expectile_loss(
    difference: Float[Array, " batch"], expectile: Float[Array, ""] | float
) -> Float[Array, ""]:
    """``E[|τ - 1(u < 0)| u²]`` of differences u (their Eq 5)."""
    return jnp.mean(jnp.abs(expectile - (difference < 0)) * jnp.square(difference))


def implicit_loss(
    network: IQLNetworks,
    target_network: IQLNetworks,
    batch: Batch,
    hyperparameters: HyperparameterArrays,
    static: IQLConfig,
) -> tuple[Float[Array, ""], Terms]:
    """Losses of V (Eq 5), of Q (Eq 6) and of the policy (Eq 7), each with its own batch mean."""
    observation, action = batch.observation, batch.action
    steady = of_taken(jax.vmap(target_network.values)(observation), action)
    value = jax.vmap(network.state_value)(observation)[:, 0]
    next_value = jax.vmap(network.state_value)(batch.next_observation)[:, 0]
    follows = losses.continuation(next_value, batch.ending, static.endings.by_kind(), 0.0)
    reward = hyperparameters.strength * score(hyperparameters.weights, batch.target)
    target = jax.lax.stop_gradient(reward + hyperparameters.discount * follows)
    q = of_taken(jax.vmap(network.values)(observation), action)
    advantage = jax.lax.stop_gradient(steady - value)
    weight = jnp.minimum(jnp.exp(hyperparameters.inverse_temperature * advantage), LARGEST_WEIGHT)
    cloned = log_likelihood(jax.vmap(network.policy)(observation), action)
    terms = {
        "state_value": expectile_loss(
            jax.lax.stop_gradient(steady) - value, hyperparameters.expectile
        ),
        "values": jnp.mean(jnp.square(target - q)),
        "policy": -jnp.mean(weight * cloned),
    }
    return sum(terms.values(), jnp.zeros(())), terms | {"loss": sum(terms.values(), jnp.zeros(()))}


@dataclass(frozen=True)
class SPRINQLConfig(settings.LearnerConfig):
    """Choices that shape the program."""

    endings: Endings = field(default_factory=Endings)
    """Value of V(s') after each kind of ending."""
    levels: settings.Count = 3
    """Levels of expertise, of equal numbers of episodes."""
    pairs: settings.Count = 8
    """Pairs of episodes of an update."""


@dataclass(frozen=True)
class SPRINQLHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced; `strength` is λ, the scale of the reference reward."""

    reference_weight: settings.NotNegative = 0.5
    """a of the squared distance to the reference reward."""
    conservatism: settings.NotNegative = 0.0
    """β of the conservative term."""


class SPRINQLNetworks(NamedTuple):
    """Q(s, ·), and the reference reward before its sigmoid."""

    values: QNetwork
    reference: QNetwork


class SPRINQLCarry(NamedTuple):
    """A random key, and the level of each episode."""

    key: Array
    levels: Array


class Graded(NamedTuple):
    """Rows of one update.

    Attributes:
        batch: Demonstrations of all levels alike.
        level: Level of each row, 0 the best.
        pairs: Rows of both episodes of each pair.
        inside: Whether such a place is a row.
        better: Level of the second episode less that of the first.
    """

    batch: Batch
    level: Array
    pairs: Batch
    inside: Array
    better: Array


class SPRINQL(EpisodeLearner):
    """IQ-Learn of graded demonstrations with a learned reference reward."""

    StaticConfig: ClassVar[type] = SPRINQLConfig
    Hyperparameters: ClassVar[type] = SPRINQLHyperparameters
    name: ClassVar[str] = "sprinql"

    def network(self, key: PRNGKeyArray) -> SPRINQLNetworks:
        """Draw both networks."""
        return SPRINQLNetworks(super().network(key), super().network(jax.random.fold_in(key, 1)))

    def initialise(self, hyperparameters: HyperparameterArrays) -> tuple[TrainState, SPRINQLCarry]:
        """Draw the networks, and grade the episodes."""
        assert self.episodes is not None
        state, key = super().initialise(hyperparameters)
        levels = self.episodes.levels(
            hyperparameters.weights, hyperparameters.dataset, self.static.levels
        )
        return state, SPRINQLCarry(key, levels)

    def draw(
        self,
        hyperparameters: HyperparameterArrays,
        state: TrainState,  # noqa: ARG002
        carry: SPRINQLCarry,
    ) -> tuple[Graded, SPRINQLCarry]:
        """Draw demonstrations with their levels, and pairs of episodes."""
        table, episodes = self.table, self.episodes
        assert table is not None and episodes is not None
        key, for_rows, for_pairs = jax.random.split(carry.key, 3)
        dataset = hyperparameters.dataset
        bounds = table.row_bounds[dataset], table.row_bounds[dataset + 1]
        rows = draw_between(for_rows, self.static.batch_size, *bounds)
        pairs = jnp.stack(episodes.pairs(for_pairs, dataset, self.static.pairs))
        graded = carry.levels[pairs]
        return Graded(
            table.rows(rows),
            carry.levels[episodes.of_row[rows]],
            episodes.rows_of(table, pairs),
            episodes.inside[pairs],
            (graded[1] - graded[0]).astype(jnp.float32),
        ), carry._replace(key=key)

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Loss of the reference reward, and that of Q."""
        return sprinql_loss(network, target_network, batch, hyperparameters, self.static)

    def policy(self, hyperparameters: Any, state: TrainState, kept: Any = None) -> QPolicy:  # noqa: ARG002
        """Return the policy of Q."""
        record = self.record(hyperparameters)
        return QPolicy.of(state.network.values, hyperparameters.temperature, record)


def sprinql_loss(
    network: SPRINQLNetworks,
    target_network: SPRINQLNetworks,
    graded: Graded,
    hyperparameters: HyperparameterArrays,
    static: SPRINQLConfig,
) -> tuple[Float[Array, ""], Terms]:
    """Return the loss and its terms: `reference` is the learned reward's, the others are Q's."""
    batch = graded.batch
    learned = jax.nn.sigmoid(jax.vmap(network.reference)(batch.observation))
    reference = of_taken(learned, batch.action)
    row = jax.lax.stop_gradient(row_weights(reference, graded.level, static.levels))
    q = jax.vmap(network.values)(batch.observation)
    value = losses.soft_value(q, hyperparameters.temperature)
    follows = soft_continuation(target_network.values, batch, hyperparameters, static.endings)
    taken = of_taken(q, batch.action)
    reward = losses.implicit_reward(taken, follows, hyperparameters.discount)
    centre = hyperparameters.strength * jax.lax.stop_gradient(reference)
    terms = {
        "expert": -jnp.sum(row * reward),
        "value": jnp.sum(row * (value - hyperparameters.discount * follows)),
        "distance": hyperparameters.reference_weight * jnp.sum(row * jnp.square(reward - centre)),
        "conservative": hyperparameters.conservatism * jnp.sum(row * (value - taken)),
        "reference": reference_loss(network.reference, reference, graded),
    }
    total = jnp.sum(jnp.stack(list(terms.values())))
    return total, terms | {"loss": total}


def row_weights(
    reference: Float[Array, " batch"], level: Array, levels: int
) -> Float[Array, " batch"]:
    """Return the weight of each row, w_i over the rows of its level; they sum to 1.

    w_i is the mean reference reward of level i over the sum of all levels' means. A level without
    a row in the batch has none of the weight.
    """
    member = level[:, None] == jnp.arange(levels)
    count = jnp.maximum(jnp.sum(member, axis=0), 1)
    means = jnp.sum(jnp.where(member, reference[:, None], 0.0), axis=0) / count
    return (means / jnp.sum(means) / count)[level]


def reference_loss(
    network: QNetwork, reference: Float[Array, " batch"], graded: Graded
) -> Float[Array, ""]:
    """Equal rewards within a level, and sums that rank the levels."""

    def learned(observation: Array) -> Array:
        return jax.nn.sigmoid(network(observation))

    first, second = learned_sums(learned, graded)
    alike = graded.level == jnp.roll(graded.level, 1)
    gap = jnp.square(reference - jnp.roll(reference, 1))
    return jnp.mean(jnp.where(alike, gap, 0.0)) + preference_loss(first, second, graded.better)
