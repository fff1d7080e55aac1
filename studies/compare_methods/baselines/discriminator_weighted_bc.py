"""Discriminator-weighted behaviour cloning (DWBC, Xu et al. 2022), offline.

The best part of the episodes by R(α) are the expert's, E; all of them are the other set, O, which
holds more of what the expert would do. A discriminator d(s, a, log π(a|s)) learns which rows are
E's from positive and unlabelled rows, and gives the clone's rows their weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners import settings
from socialiq.learners.expert_table import Batch
from socialiq.learners.kernel import Terms
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.types import RewardPair
from studies.compare_methods.baselines.shared import (
    EpisodeLearner,
    best_rows,
    log_likelihood,
    of_taken,
)

CLIPPED = 0.1, 0.9
"""Bounds of d in the weights, as in the paper."""


@dataclass(frozen=True)
class DWBCConfig(settings.LearnerConfig):
    """Choices that shape the program."""

    parts: settings.Count = 3
    """One part in so many of the episodes are the expert's."""


@dataclass(frozen=True)
class DWBCHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced."""

    expert_weight: settings.NotNegative = 7.5
    """α of the paper: weight of the plain likelihood of E's rows."""
    positive_share: settings.NotNegative = 0.5
    """η of the paper: how much E's rows count in the discriminator's loss."""


class DWBCNetworks(NamedTuple):
    """The clone's logits, and the discriminator's, whose further inputs are log π(a|s) and 0."""

    policy: QNetwork
    discriminator: DialNetwork


class DWBCCarry(NamedTuple):
    """A random key, and the cumulative weights of the expert's rows."""

    key: Array
    expert: Array


class Sides(NamedTuple):
    """Rows of the expert, and of all episodes."""

    expert: Batch
    others: Batch


class DiscriminatorWeighted(EpisodeLearner):
    """A clone whose rows are weighted by a discriminator."""

    StaticConfig: ClassVar[type] = DWBCConfig
    Hyperparameters: ClassVar[type] = DWBCHyperparameters
    name: ClassVar[str] = "discriminator_weighted_bc"
    has_target: ClassVar[bool] = False

    def network(self, key: PRNGKeyArray) -> DWBCNetworks:
        """Draw both networks."""
        static, (n_features, n_actions) = self.static, self.sizes
        shape = (static.hidden, n_actions, static.activation, static.view)
        discriminator = DialNetwork.initialise(jax.random.fold_in(key, 1), n_features, *shape)
        return DWBCNetworks(super().network(key), discriminator)

    def initialise(self, hyperparameters: HyperparameterArrays) -> tuple[TrainState, DWBCCarry]:
        """Draw the networks, and select the expert's rows."""
        assert self.episodes is not None
        state, key = super().initialise(hyperparameters)
        run = (hyperparameters.weights, hyperparameters.dataset, self.static.parts)
        return state, DWBCCarry(key, best_rows(self.episodes, *run))

    def draw(
        self, hyperparameters: HyperparameterArrays, state: TrainState, carry: DWBCCarry
    ) -> tuple[Sides, DWBCCarry]:
        """Draw as many rows of either set."""
        assert self.table is not None
        of_all, key = super().draw(hyperparameters, state, carry.key)
        key, for_expert = jax.random.split(key)
        size = self.static.batch_size
        expert = self.table.sample_weighted(for_expert, carry.expert, size)
        return Sides(expert, of_all), carry._replace(key=key)

    def loss(
        self,
        network: Any,
        target_network: Any,  # noqa: ARG002
        batch: Any,
        hyperparameters: HyperparameterArrays,
    ) -> tuple[Float[Array, ""], Terms]:
        """Loss of the discriminator, and the weighted one of the clone."""
        logits = [_judged(network, rows) for rows in batch]
        share = hyperparameters.positive_share
        likelihoods = [
            log_likelihood(jax.vmap(network.policy)(rows.observation), rows.action)
            for rows in batch
        ]
        chances = [
            jnp.clip(jax.nn.sigmoid(jax.lax.stop_gradient(side)), *CLIPPED) for side in logits
        ]
        terms = {
            "discriminator": discriminator_loss(logits[0], logits[1], share),
            "clone": weighted_loss(likelihoods, chances, share, hyperparameters.expert_weight),
        }
        total = terms["discriminator"] + terms["clone"]
        return total, terms | {"loss": total}

    def policy(self, hyperparameters: Any, state: TrainState, kept: Any = None) -> QPolicy:  # noqa: ARG002
        """Return the clone."""
        return QPolicy.of(state.network.policy, 1.0, self.record(hyperparameters))


def _judged(network: DWBCNetworks, rows: Batch) -> Float[Array, " batch"]:
    """Return the discriminator's logits of rows; the clone gets no gradient from them."""
    logits = jax.vmap(network.policy)(rows.observation)
    told = jax.lax.stop_gradient(log_likelihood(logits, rows.action))
    judged = jax.vmap(network.discriminator)(
        rows.observation, RewardPair(told, jnp.zeros_like(told))
    )
    return of_taken(judged, rows.action)


def discriminator_loss(
    expert: Float[Array, " batch"], others: Float[Array, " batch"], share: Array | float
) -> Float[Array, ""]:
    """η E_E[-log d] + E_O[-log (1 - d)] - η E_E[-log (1 - d)], of logits (their Eq 10)."""
    positive = jax.nn.softplus(-expert) - jax.nn.softplus(expert)
    return jnp.mean(share * positive) + jnp.mean(jax.nn.softplus(others))


def weighted_loss(
    likelihoods: Sequence[Float[Array, " batch"]],
    chances: Sequence[Float[Array, " batch"]],
    share: Array | float,
    expert_weight: Array | float,
) -> Float[Array, ""]:
    """α E_E[-log π] - E_E[-log π η / (d (1 - d))] + E_O[-log π / (1 - d)] (their Eq 17).

    Args:
        likelihoods: log π of E's rows and of O's.
        chances: d of E's rows and of O's, clipped.
        share: η.
        expert_weight: α.
    """
    (expert, of_all), (expert_chance, chance) = likelihoods, chances
    opposing = share / (expert_chance * (1.0 - expert_chance))
    return -jnp.mean((expert_weight - opposing) * expert) - jnp.mean(of_all / (1.0 - chance))
