"""Multi-intention inverse reinforcement learning by EM (Babes et al. 2011), offline.

K intentions, each with a Q of its own. The M step is IQ-Learn of every episode, weighted by how
likely it is of the intention; the E step takes these weights, the responsibilities, from the
likelihoods of the episodes' actions under softmax(Q_k/τ). No label is seen. At an angle the
intention is taken whose episodes score best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners import settings
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.iq_learn import losses
from socialiq.learners.kernel import Trained
from socialiq.learners.state import Runs, stack
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import score, weights
from socialiq.types import RewardPair
from studies.compare_methods.baselines import shared
from studies.compare_methods.baselines.offline import ValueConfig


@dataclass(frozen=True)
class IntentionConfig(ValueConfig):
    """Choices that shape the program."""

    intentions: settings.Count = 3
    """K."""


@dataclass(frozen=True)
class IntentionHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced; `angle` has no effect, the policy takes every angle."""

    chi2_alpha: settings.Positive = 0.5
    """α_χ of term 3."""


@dataclass(frozen=True)
class IntentionPolicy:
    """A policy of each intention, and the mean totals of its episodes."""

    policies: tuple[QPolicy, ...]
    totals: Float[np.ndarray, "intention 2"]

    def at(self, angle: float) -> QPolicy:
        """Return the policy of the intention that scores best at an angle in degrees."""
        return self.policies[int(score(weights(angle), RewardPair(*self.totals.T)).argmax())]


class MultiIntention(shared.EpisodeLearner):
    """IQ-Learn of K intentions, found by EM; carries responsibilities, (episode, intention)."""

    StaticConfig: ClassVar[type] = IntentionConfig
    Hyperparameters: ClassVar[type] = IntentionHyperparameters
    name: ClassVar[str] = "multi_intention_irl"

    def network(self, key: PRNGKeyArray) -> tuple[Any, ...]:
        """Draw a network for each intention."""
        return tuple(map(super().network, jax.random.split(key, self.static.intentions)))

    def initialise(self, hyperparameters: Any):
        """Draw networks, and the first responsibilities: random ones break the symmetry."""
        state, key = super().initialise(hyperparameters)
        key, for_first = jax.random.split(key)
        count, concentration = self.episodes.inside.shape[0], jnp.ones(self.static.intentions)
        return state, shared.Carry(key, jax.random.dirichlet(for_first, concentration, (count,)))

    def draw(self, hyperparameters: Any, state: Any, carry: Any) -> tuple[Any, Any]:  # noqa: ARG002
        """Draw demonstrations with their episodes' responsibilities."""
        key, for_rows = jax.random.split(carry.key)
        rows = self.rows(for_rows, hyperparameters.dataset)
        share = carry.known[self.episodes.of_row[rows]]
        return (self.table.rows(rows), share), carry._replace(key=key)

    def loss(self, network: Any, target_network: Any, batch: Any, hyperparameters: Any):
        """-E[z r̂] + E[z (V(s) - γ V(s'))] + E[z r̂²] / (4 α_χ): L_IQ (Eq 2.7), summed over z."""
        (rows, responsibility), run, total = batch, hyperparameters, jnp.zeros(())
        for number, (learned, steady) in enumerate(zip(network, target_network, strict=True)):
            q = jax.vmap(learned)(rows.observation)
            follows = shared.soft_continuation(steady, rows, run, self.static.endings)
            reward = losses.implicit_reward(shared.of_taken(q, rows.action), follows, run.discount)
            flow = losses.soft_value(q, run.temperature) - run.discount * follows
            square = jnp.square(reward) / (4.0 * run.chi2_alpha)
            total += jnp.mean(responsibility[:, number] * (flow - reward + square))
        return total, {"loss": total}

    def expectation(
        self,
        hyperparameters: Any,
        network: Sequence[Any],
        responsibility: Float[Array, "episode intention"],
        longest: int,
    ) -> Float[Array, "episode intention"]:
        """Return P(intention | episode) of the run's set, by the last ones' priors."""
        table, episodes, count = self.table, self.episodes, self.episodes.inside.shape[0]
        of_set = hyperparameters.dataset + jnp.arange(2)
        bounds, (first, end) = table.row_bounds[of_set], episodes.bounds[of_set]
        rows = bounds[0] + jnp.arange(longest)
        columns = table.rows(jnp.minimum(rows, bounds[1] - 1))
        episode = jnp.where(rows < bounds[1], episodes.of_row[rows], count)  # beyond: left out
        sums = []
        for intention in network:
            logits = jax.vmap(intention)(columns.observation) / hyperparameters.temperature
            likelihood = shared.log_likelihood(logits, columns.action)
            sums.append(jax.ops.segment_sum(likelihood, episode, count))
        in_set = (jnp.arange(count) >= first) & (jnp.arange(count) < end)
        prior = jnp.sum(jnp.where(in_set[:, None], responsibility, 0.0), axis=0) / jnp.sum(in_set)
        return jax.nn.softmax(jnp.stack(sums, 1) + jnp.log(jnp.maximum(prior, 1e-6)), axis=1)

    def train(
        self,
        hyperparameters: Sequence[Any],
        callbacks: Callbacks | None = None,
        chunk: int = 200,
        before_chunk: Any = None,  # noqa: ARG002
        world: str = "",
    ) -> Trained:
        """Train as every learner; an E step stands before each chunk of updates but the first."""
        arrays, longest = stack(hyperparameters), int(jnp.diff(self.table.row_bounds).max())

        @jax.jit
        def step(learner: MultiIntention, *runs: Any) -> Array:  # one by one: it takes much memory
            return jax.lax.map(lambda run: learner.expectation(*run, longest), runs)

        def e_step(runs: Runs, done: int) -> Runs:
            if done == 0:  # the networks know nothing yet
                return runs
            responsibility = step(self, arrays, runs.state.network, runs.carry.known)
            return runs._replace(carry=runs.carry._replace(known=responsibility))

        return super().train(hyperparameters, callbacks, chunk, e_step, world)

    def kept(self, carry: shared.Carry) -> Array:
        """Return the responsibilities."""
        return carry.known

    def policy(self, hyperparameters: Any, state: Any, kept: Any = None) -> IntentionPolicy:
        """Return the policies of the intentions with their episodes' mean totals."""
        record = self.record(hyperparameters)
        first, end = map(int, self.episodes.bounds[hyperparameters.dataset + jnp.arange(2)])
        share = np.asarray(kept)[first:end]
        totals = np.stack([np.asarray(total)[first:end] for total in self.episodes.totals], 1)
        means = share.T @ totals / np.maximum(share.sum(axis=0), 1e-9)[:, None]
        # An intention without episodes has no score.
        means = np.where(share.sum(axis=0)[:, None] > 1e-3, means, -np.inf)
        temperature = hyperparameters.temperature
        policies = [QPolicy.of(network, temperature, record) for network in state.network]
        return IntentionPolicy(tuple(policies), means)
