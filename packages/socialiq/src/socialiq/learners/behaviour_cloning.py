"""Behaviour cloning: maximum likelihood of the actions, on the same data and network.

All demonstrations count alike, or are weighted by how well they score at an angle. The weights are
those of Eq B.2, with each episode's undiscounted total as its score, or with each transition's
advantage. At a high τ_w the clone is the plain one. The weights exp(A/τ_w) of advantages are those
of MARWIL (Wang et al. 2018) and of advantage-weighted regression (Peng et al. 2019).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, PRNGKeyArray

from socialiq.learners import settings
from socialiq.learners.expert_table import Batch, ExpertTable
from socialiq.learners.iq_learn import losses
from socialiq.learners.kernel import Learner, Terms
from socialiq.learners.state import HyperparameterArrays, TrainState, stack
from socialiq.nn.actor import Actor, log_density
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.q_network import QNetwork
from socialiq.types import Transitions


@dataclass(frozen=True, kw_only=True)
class CloningConfig(settings.LearnerConfig):
    """Choices that shape the program."""

    weighted: bool = False
    """Whether demonstrations count by their score, or all alike."""
    weighted_by: Literal["trajectory", "advantage", "advantage_fitted"] = "trajectory"
    """Score of weighted runs: the episode's total, the same for all of its rows, or the row's
    advantage, by states that are seen again or by a fitted network."""


@dataclass(frozen=True, kw_only=True)
class CloningHyperparameters(settings.Optimiser, settings.Dataset):
    """Numbers of one run, all traced."""

    angle: settings.Angle = 0.0
    """α of the score, in degrees; only of weighted runs."""
    reweight_temperature: settings.Positive = 1.0
    """τ_w of Eq B.2, in units of the score; only of weighted runs."""


class Carry(NamedTuple):
    """A random key, and the cumulative weights of Eq B.2; None where all rows count alike."""

    key: Array
    cumulative: Array | None


class BehaviourCloning(Learner):
    """The maximum-likelihood classifier of actions; its soft policy is the fitted distribution."""

    StaticConfig: ClassVar[type] = CloningConfig
    Hyperparameters: ClassVar[type] = CloningHyperparameters
    name: ClassVar[str] = "behaviour_cloning"
    has_target: ClassVar[bool] = False

    @classmethod
    def of(cls, static: Any, datasets: Sequence[Transitions]) -> BehaviourCloning:
        """Make the learner of sets of demonstrations.

        Args:
            static: Config of all runs.
            datasets: Sets of demonstrations with discrete actions.

        Returns:
            The learner.

        Raises:
            UserError: If there is no set, or they differ in features or actions, or have continuous
                actions.
        """
        sizes = (datasets[0].observation.shape[1], datasets[0].n_actions)
        return cls(static, sizes, _table_of(static, datasets, False))

    def initialise(self, hyperparameters: HyperparameterArrays) -> tuple[TrainState, Carry]:
        """Draw a network from the run's seed, and weigh the demonstrations."""
        assert self.table is not None
        state, key = super().initialise(hyperparameters)
        if not self.static.weighted:
            return state, Carry(key, None)
        return state, Carry(key, jnp.cumsum(losses.table_weights(self.table, hyperparameters)))

    def draw(
        self, hyperparameters: HyperparameterArrays, state: TrainState, carry: Carry
    ) -> tuple[Batch, Carry]:
        """Return demonstrations, by their weights or all alike.

        Args:
            hyperparameters: Numbers of one run.
            state: State of one run, which has no influence.
            carry: Random key, and cumulative weights.

        Returns:
            A batch of `batch_size` demonstrations, and the carry with the next key.
        """
        if carry.cumulative is None:
            batch, key = super().draw(hyperparameters, state, carry.key)
            return batch, carry._replace(key=key)
        assert self.table is not None
        key, for_batch = jax.random.split(carry.key)
        size = self.static.batch_size
        batch = self.table.sample_weighted(for_batch, carry.cumulative, size)
        return batch, carry._replace(key=key)

    def no_angle(self) -> str:
        """Return why no term reads an angle; "" if one does, by the weights of demonstrations."""
        plain = "demonstrations count alike, without --set weighted=true"
        return super().no_angle() if self.static.weighted else plain

    def loss(self, network: Any, _target: Any, batch: Any, _numbers: Any) -> tuple[Array, Terms]:
        """Return the negative log-likelihood of the demonstrated actions.

        Args:
            network: Network of logits.
            batch: Demonstrations.

        Returns:
            The loss in nats, and the only term, "loss".
        """
        loss = negative_log_likelihood(network, batch.observation, batch.action)
        return loss, {"loss": loss}


class GaussianCloning(BehaviourCloning):
    """The maximum-likelihood squashed Gaussian of continuous actions, kept from their bounds."""

    name: ClassVar[str] = "gaussian_behaviour_cloning"

    @classmethod
    def of(cls, static: Any, datasets: Sequence[Transitions]) -> GaussianCloning:
        """Make the learner of sets of demonstrations.

        Args:
            static: Config of all runs.
            datasets: Sets of demonstrations with continuous actions.

        Returns:
            The learner.

        Raises:
            UserError: If there is no set, or they differ in features or actions, or have discrete
                actions.
        """
        table = _table_of(static, datasets, True)
        return cls(static, (datasets[0].observation.shape[1], datasets[0].action.shape[1]), table)

    def network(self, key: PRNGKeyArray) -> Actor:
        """Draw an actor."""
        static = self.static
        n_features, size = self.sizes
        shape = (n_features, static.hidden, size, static.activation, static.input_scale)
        return Actor.initialise(key, *shape, view=static.view)

    def loss(self, network: Any, _target: Any, batch: Any, _numbers: Any) -> tuple[Array, Terms]:
        """Return -E[log π(a|s)] of the demonstrated actions.

        Args:
            network: The actor.
            batch: Demonstrations.

        Returns:
            The loss in nats, and the only term, "loss".
        """
        mean, log_std = jax.vmap(network)(batch.observation)
        loss = -jnp.mean(jax.vmap(log_density)(batch.action, mean, log_std))
        return loss, {"loss": loss}

    def policy(self, hyperparameters: Any, state: TrainState, _retained: Any = None) -> ActorPolicy:
        """Return the clone of one run.

        Args:
            hyperparameters: Numbers of the run, for the record.
            state: State of the run.

        Returns:
            The trained actor as a policy.
        """
        return ActorPolicy.of(state.network, self.record(hyperparameters))


def effective_size(data: Transitions, hyperparameters: CloningHyperparameters) -> float:
    """Return how many transitions of equal weight a weighted run's data are worth (B.2).

    Args:
        data: Demonstrations.
        hyperparameters: Numbers of the run; the angle and τ_w are read. Weights are by trajectory.

    Returns:
        1 / Σ w² of the weights of Eq B.2.
    """
    table = _table_of(CloningConfig(weighted=True), [data], False)
    run = stack([dataclasses.replace(hyperparameters, dataset=0)])[0]
    return float(losses.effective_sample_size(losses.table_weights(table, run)))


def _table_of(
    static: CloningConfig, datasets: Sequence[Transitions], continuous: bool
) -> ExpertTable:
    """Return the sets; where they are weighted, with each row's score."""
    if not static.weighted:
        return ExpertTable.of(datasets, "instantaneous", 0.0, continuous)
    discount = 1.0 if static.weighted_by == "trajectory" else 0.99
    return ExpertTable.of(datasets, static.weighted_by, discount, continuous)


def negative_log_likelihood(network: QNetwork, observation: Array, action: Array) -> Array:
    """Return -E[log softmax(network(s))[a]].

    Args:
        network: Network of logits.
        observation: Observations, (batch, feature).
        action: Actions, integers (batch,).

    Returns:
        The mean over the batch, in nats.
    """
    logits = jax.vmap(network)(observation)
    return optax.softmax_cross_entropy_with_integer_labels(logits, action).mean()
