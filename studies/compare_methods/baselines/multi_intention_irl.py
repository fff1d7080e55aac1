"""Multi-intention inverse reinforcement learning by EM (Babes et al. 2011), offline.

K intentions, each with a Q of its own. The M step is IQ-Learn of every episode, weighted by how
likely it is of the intention; the E step takes these weights from the likelihoods of the episodes'
actions under softmax(Q_k/τ). No label is seen. At an angle the intention is taken whose episodes
score best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners import settings
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.expert_table import Batch, draw_between
from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.kernel import Terms, Trained
from socialiq.learners.state import HyperparameterArrays, Runs, TrainState, stack
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import score, weights
from socialiq.types import RewardPair, Transitions
from studies.compare_methods.baselines.shared import (
    EpisodeLearner,
    log_likelihood,
    of_taken,
    soft_continuation,
)


@dataclass(frozen=True)
class IntentionConfig(settings.LearnerConfig):
    """Choices that shape the program."""

    endings: Endings = field(default_factory=Endings)
    """Value of V(s') after each kind of ending."""
    intentions: settings.Count = 3
    """K."""


@dataclass(frozen=True)
class IntentionHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced; `angle` has no effect, the policy takes every angle."""

    chi2_alpha: settings.Positive = 0.5
    """α_χ of term 3."""


class IntentionCarry(NamedTuple):
    """A random key, and the responsibilities, (episode, intention)."""

    key: Array
    responsibility: Array


class Weighted(NamedTuple):
    """Demonstrations, and each row's responsibilities, (row, intention)."""

    batch: Batch
    responsibility: Array


@dataclass(frozen=True)
class IntentionPolicy:
    """Policies of the intentions; `at` returns the one that is taken at an angle.

    Attributes:
        policies: Of each intention.
        totals: Mean totals of each intention's episodes, (intention, 2).
    """

    policies: tuple[QPolicy, ...]
    totals: Float[np.ndarray, "intention 2"]

    def at(self, angle: float) -> QPolicy:
        """Return the policy of the intention that scores best at an angle in degrees."""
        return self.policies[int(score(weights(angle), RewardPair(*self.totals.T)).argmax())]


class MultiIntention(EpisodeLearner):
    """IQ-Learn of K intentions, found by EM."""

    StaticConfig: ClassVar[type] = IntentionConfig
    Hyperparameters: ClassVar[type] = IntentionHyperparameters
    name: ClassVar[str] = "multi_intention_irl"

    def network(self, key: PRNGKeyArray) -> tuple[QNetwork, ...]:
        """Draw a network for each intention."""
        keys = jax.random.split(key, self.static.intentions)
        return tuple(super(MultiIntention, self).network(own_key) for own_key in keys)

    def initialise(
        self, hyperparameters: HyperparameterArrays
    ) -> tuple[TrainState, IntentionCarry]:
        """Draw networks, and the first responsibilities: random ones break the symmetry."""
        assert self.episodes is not None
        state, key = super().initialise(hyperparameters)
        key, for_first = jax.random.split(key)
        count = self.episodes.inside.shape[0]
        concentration = jnp.ones(self.static.intentions)
        return state, IntentionCarry(key, jax.random.dirichlet(for_first, concentration, (count,)))

    def draw(
        self,
        hyperparameters: HyperparameterArrays,
        state: TrainState,  # noqa: ARG002
        carry: IntentionCarry,
    ) -> tuple[Weighted, IntentionCarry]:
        """Draw demonstrations with their episodes' responsibilities."""
        table, episodes = self.table, self.episodes
        assert table is not None and episodes is not None
        key, for_rows = jax.random.split(carry.key)
        dataset = hyperparameters.dataset
        bounds = table.row_bounds[dataset], table.row_bounds[dataset + 1]
        rows = draw_between(for_rows, self.static.batch_size, *bounds)
        share = carry.responsibility[episodes.of_row[rows]]
        return Weighted(table.rows(rows), share), carry._replace(key=key)

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Weighted L_IQ (Eq 2.7, value_expert) of each intention, summed."""
        total = jnp.zeros(())
        for number, (learned, steady) in enumerate(zip(network, target_network, strict=True)):
            share = batch.responsibility[:, number]
            total += weighted_iq_loss(
                learned, steady, batch.batch, share, hyperparameters, self.static
            )
        return total, {"loss": total}

    def kept(self, carry: IntentionCarry) -> Array:
        """Return the responsibilities."""
        return carry.responsibility

    def policy(self, hyperparameters: Any, state: TrainState, kept: Any = None) -> IntentionPolicy:
        """Return the policies of the intentions with their episodes' mean totals."""
        assert self.episodes is not None
        episodes, record = self.episodes, self.record(hyperparameters)
        first, end = (
            int(bound) for bound in episodes.bounds[hyperparameters.dataset + jnp.arange(2)]
        )
        share = np.asarray(kept)[first:end]
        totals = np.stack([np.asarray(total)[first:end] for total in episodes.totals], 1)
        means = share.T @ totals / np.maximum(share.sum(axis=0), 1e-9)[:, None]
        # An intention without episodes has no score.
        means = np.where(share.sum(axis=0)[:, None] > 1e-3, means, -np.inf)
        temperature = hyperparameters.temperature
        policies = [QPolicy.of(network, temperature, record) for network in state.network]
        return IntentionPolicy(tuple(policies), means)


def weighted_iq_loss(
    network: QNetwork,
    target_network: QNetwork,
    batch: Batch,
    share: Float[Array, " batch"],
    hyperparameters: HyperparameterArrays,
    static: IntentionConfig,
) -> Float[Array, ""]:
    """-E[z r̂] + E[z (V(s) - γ V(s'))] + E[z r̂²] / (4 α_χ), by responsibilities z."""
    q = jax.vmap(network)(batch.observation)
    follows = soft_continuation(target_network, batch, hyperparameters, static.endings)
    taken = of_taken(q, batch.action)
    reward = losses.implicit_reward(taken, follows, hyperparameters.discount)
    value = losses.soft_value(q, hyperparameters.temperature)
    flow = value - hyperparameters.discount * follows
    square = jnp.square(reward) / (4.0 * hyperparameters.chi2_alpha)
    return jnp.mean(share * (flow - reward + square))


def expectation(
    learner: MultiIntention,
    hyperparameters: HyperparameterArrays,
    network: Sequence[QNetwork],
    responsibility: Float[Array, "episode intention"],
    longest: int,
) -> Float[Array, "episode intention"]:
    """Return P(intention | episode), with the priors that the last responsibilities give.

    Only the rows of the run's own set are evaluated; its episodes alone have meaning.
    """
    table, episodes = learner.table, learner.episodes
    assert table is not None and episodes is not None
    count = episodes.inside.shape[0]
    bounds = table.row_bounds[hyperparameters.dataset + jnp.arange(2)]
    rows = bounds[0] + jnp.arange(longest)
    columns = table.rows(jnp.minimum(rows, bounds[1] - 1))
    episode = jnp.where(rows < bounds[1], episodes.of_row[rows], count)  # out of range: left out
    sums = [
        jax.ops.segment_sum(
            log_likelihood(
                jax.vmap(intention)(columns.observation) / hyperparameters.temperature,
                columns.action,
            ),
            episode,
            count,
        )
        for intention in network
    ]
    first, end = episodes.bounds[hyperparameters.dataset + jnp.arange(2)]
    in_set = (jnp.arange(count) >= first) & (jnp.arange(count) < end)
    prior = jnp.sum(jnp.where(in_set[:, None], responsibility, 0.0), axis=0) / jnp.sum(in_set)
    return jax.nn.softmax(jnp.stack(sums, 1) + jnp.log(jnp.maximum(prior, 1e-6)), axis=1)


def train(
    static: IntentionConfig,
    hyperparameters: Sequence[IntentionHyperparameters],
    datasets: Sequence[Transitions],
    callbacks: Callbacks | None = None,
    chunk: int = 200,
) -> Trained:
    """Train one run for each entry of `hyperparameters`; an E step stands before each chunk.

    Args:
        static: Shared by all runs.
        hyperparameters: One entry for each run.
        datasets: Sets of demonstrations; `Hyperparameters.dataset` picks the set of each run.
        callbacks: Progress, monitor, checkpoint.
        chunk: Updates between two E steps.

    Raises:
        UserError: If there is no run.
        Stopped: On Ctrl-C.
    """
    learner = MultiIntention.of(static, datasets)
    arrays = stack(hyperparameters)
    longest = max(len(data.action) for data in datasets)

    @jax.jit
    def step(learner: MultiIntention, *runs: Any) -> Array:  # one by one: it takes much memory
        return jax.lax.map(lambda one: expectation(learner, one[0], one[1], one[2], longest), runs)

    def e_step(runs: Runs, done: int) -> Runs:
        if done == 0:  # the networks know nothing yet
            return runs
        responsibility = step(learner, arrays, runs.state.network, runs.carry.responsibility)
        return runs._replace(carry=runs.carry._replace(responsibility=responsibility))

    return learner.train(hyperparameters, callbacks, chunk, e_step)
