"""Learners of values from demonstrations alone: IQL on R(α), SPRINQL, and multiple intentions.

IQL (Kostrikov et al. 2022): V is an upper expectile of Q over the demonstrated actions, Q is fitted
to r + γ V(s'), and the policy clones the demonstrations with the weight exp(β (Q - V)). So Q is
never evaluated at an action that the data don't have.

SPRINQL (Hoang et al. 2024): IQ-Learn with graded demonstrators. Episodes have levels of expertise,
here by R(α). A reference reward in (0, 1), learned from the ranks of the levels, gives level i its
weight w_i, the mean reference reward of its transitions as a share of all levels', and is what r̂ is
drawn to. With U the mixture of the levels by their weights, and β the conservative weight:

    - Σ_i w_i E_i[r̂] + E_U[V(s) - γ (1 - d) V(s')] + a E_U[(r̂ - λ r_ref)²] + β E_U[V(s) - Q(s, a)].

Multi-intention inverse reinforcement learning by EM (Babes et al. 2011): K intentions, each with
its own Q. The M step is IQ-Learn of every episode, weighted by the probability that the episode
has the intention; the E step takes these weights, the responsibilities, from the likelihoods of
the episodes' actions under softmax(Q_k/τ). No label is seen. At an angle the intention is taken
whose episodes score best.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq import QPolicy, RewardPair, score, weights
from socialiq.learners import settings
from socialiq.learners.expert_table import Batch
from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.state import Runs, stack
from socialiq.nn.q_network import QNetwork
from socialiq_lab import baselines as shared

LARGEST_WEIGHT = 100.0  # bound of IQL's exp(β (Q - V)), as in the paper


@dataclass(frozen=True)
class ValueConfig(settings.LearnerConfig):
    """Choices that shape the program."""

    endings: Endings = field(default_factory=Endings)  # value of V(s') after each kind of ending


@dataclass(frozen=True)
class IQLHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced."""

    expectile: settings.Share = 0.7
    """Expectile of Q over demonstrated actions that V is: 0.5 the mean, towards 1 the maximum."""
    inverse_temperature: settings.Positive = 3.0  # β of the policy's weights


class IQLNetworks(NamedTuple):
    """Q(s, ·), V(s), and the policy's logits."""

    values: QNetwork
    state_value: QNetwork
    policy: QNetwork


class ImplicitQLearning(shared.Baseline):
    """Implicit Q-learning of demonstrations; the policy is a separate network."""

    StaticConfig: ClassVar[type] = ValueConfig
    Hyperparameters: ClassVar[type] = IQLHyperparameters
    name: ClassVar[str] = "implicit_q_learning"

    def network(self, key: PRNGKeyArray) -> IQLNetworks:
        """Draw three networks of the same hidden layers."""
        static = self.static
        n_features, n_actions = self.sizes
        keys = jax.random.split(key, 3)
        networks = []
        for number, outputs in enumerate((n_actions, 1, n_actions)):
            shape = (n_features, static.hidden, outputs, static.activation, static.view)
            networks.append(QNetwork.initialise(keys[number], *shape, scale=static.input_scale))
        return IQLNetworks(*networks)

    def loss(self, network: Any, target_network: Any, batch: Any, hyperparameters: Any):
        """Return the losses of V, Q and the policy (Eq 5 to 7); none has another's gradient.

        Args:
            network: Q, V and the policy.
            target_network: Slow copy of the network, whose Q is used.
            batch: Demonstrated rows.
            hyperparameters: Numbers of the run.

        Returns:
            The sum, and the terms "state_value", "values", "policy" and "loss".
        """
        observation = batch.observation
        action = batch.action
        run = hyperparameters
        steady = shared.of_taken(jax.vmap(target_network.values)(observation), action)
        value = jax.vmap(network.state_value)(observation)[:, 0]
        next_value = jax.vmap(network.state_value)(batch.next_observation)[:, 0]
        endings = self.static.endings.by_kind()
        follows = losses.continuation(next_value, batch.ending, endings, 0.0)
        reward = run.strength * score(run.weights, batch.target)
        target = jax.lax.stop_gradient(reward + run.discount * follows)
        q = shared.of_taken(jax.vmap(network.values)(observation), action)
        advantage = run.inverse_temperature * jax.lax.stop_gradient(steady - value)
        weight = jnp.minimum(jnp.exp(advantage), LARGEST_WEIGHT)
        cloned = shared.log_likelihood(jax.vmap(network.policy)(observation), action)
        difference = jax.lax.stop_gradient(steady) - value
        asymmetry = jnp.abs(run.expectile - (difference < 0))
        return shared.summed(
            {
                "state_value": jnp.mean(asymmetry * jnp.square(difference)),
                "values": jnp.mean(jnp.square(target - q)),
                "policy": -jnp.mean(weight * cloned),
            }
        )


@dataclass(frozen=True)
class SPRINQLConfig(ValueConfig):
    """Choices that shape the program."""

    levels: settings.Count = 3  # levels of expertise, of equal numbers of episodes
    pairs: settings.Count = 8  # pairs of episodes of an update


@dataclass(frozen=True)
class SPRINQLHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced; `strength` is λ, the scale of the reference reward."""

    reference_weight: settings.NotNegative = 0.5
    """a of the squared distance to the reference reward."""
    conservatism: settings.NotNegative = 0.0  # β of the conservative term


class SPRINQLNetworks(NamedTuple):
    """Q(s, ·), and the reference reward before its sigmoid."""

    values: QNetwork
    reference: QNetwork


class Graded(NamedTuple):
    """Demonstrations of all levels alike, the level of each row (0 the best), pairs of episodes."""

    batch: Batch
    level: Array
    pairs: shared.Pairs


class SPRINQL(shared.EpisodeLearner):
    """IQ-Learn of graded demonstrations with a learned reference reward; carries the levels."""

    StaticConfig: ClassVar[type] = SPRINQLConfig
    Hyperparameters: ClassVar[type] = SPRINQLHyperparameters
    name: ClassVar[str] = "sprinql"
    acting: ClassVar[str] = "values"

    def network(self, key: PRNGKeyArray) -> SPRINQLNetworks:
        """Draw both networks."""
        return SPRINQLNetworks(super().network(key), super().network(jax.random.fold_in(key, 1)))

    def initialise(self, hyperparameters: Any):
        """Draw the networks, and grade the episodes."""
        state, key = super().initialise(hyperparameters)
        run = hyperparameters.weights, hyperparameters.dataset
        return state, shared.Carry(key, self.episodes.levels(*run, self.static.levels))

    def draw(self, hyperparameters: Any, state: Any, carry: Any) -> tuple[Any, Any]:  # noqa: ARG002
        """Draw demonstrations with their levels, and pairs of episodes.

        Args:
            hyperparameters: Numbers of the run.
            state: Not used.
            carry: Random key, and the level of each episode.

        Returns:
            Rows with levels and pairs (`Graded`), and the next carry.
        """
        key, for_rows, for_pairs = jax.random.split(carry.key, 3)
        dataset = hyperparameters.dataset
        scores = -carry.known.astype(jnp.float32)
        rows = self.rows(for_rows, dataset)
        level = carry.known[self.episodes.of_row[rows]]
        options = self.table, for_pairs, dataset, self.static.pairs, scores
        graded = Graded(self.table.rows(rows), level, self.episodes.pairs(*options))
        return graded, carry._replace(key=key)

    def loss(self, network: Any, target_network: Any, batch: Any, hyperparameters: Any):
        """Return the loss of Q, and that of the reference reward.

        The reference reward is fitted to be equal within a level, and ranked between levels.

        Args:
            network: Q and the reference reward before its sigmoid.
            target_network: Slow copy of the network, whose Q gives the value of the next
                observation.
            batch: Rows with levels, and pairs of episodes.
            hyperparameters: Numbers of the run.

        Returns:
            The sum, and the terms "expert", "value", "distance", "conservative", "reference" and
            "loss".
        """
        rows, level, pairs = batch
        run = hyperparameters

        def reference_reward(observation: Array) -> Array:
            return jax.nn.sigmoid(network.reference(observation))

        reference = shared.of_taken(jax.vmap(reference_reward)(rows.observation), rows.action)
        row = jax.lax.stop_gradient(row_weights(reference, level, self.static.levels))
        q = jax.vmap(network.values)(rows.observation)
        value = losses.soft_value(q, run.temperature)
        taken = shared.of_taken(q, rows.action)
        follows = shared.soft_continuation(target_network.values, rows, run, self.static.endings)
        reward = losses.implicit_reward(taken, follows, run.discount)
        centre = run.strength * jax.lax.stop_gradient(reference)
        alike = level == jnp.roll(level, 1)
        gap = jnp.square(reference - jnp.roll(reference, 1))
        terms = {
            "expert": -jnp.sum(row * reward),
            "value": jnp.sum(row * (value - run.discount * follows)),
            "distance": run.reference_weight * jnp.sum(row * jnp.square(reward - centre)),
            "conservative": run.conservatism * jnp.sum(row * (value - taken)),
            "reference": jnp.mean(jnp.where(alike, gap, 0.0))
            + shared.preference_loss(reference_reward, pairs),
        }
        return shared.summed(terms)


def row_weights(
    reference: Float[Array, " batch"], level: Array, levels: int
) -> Float[Array, " batch"]:
    """Return the weight of each row, w_i over the rows of its level; they sum to 1.

    Args:
        reference: Reference reward of each row.
        level: Level of each row, 0 for the best.
        levels: Number of levels.
    """
    member = level[:, None] == jnp.arange(levels)
    count = jnp.maximum(jnp.sum(member, axis=0), 1)
    means = jnp.sum(jnp.where(member, reference[:, None], 0.0), axis=0) / count
    return (means / jnp.sum(means) / count)[level]


@dataclass(frozen=True)
class IntentionConfig(ValueConfig):
    """Choices that shape the program."""

    intentions: settings.Count = 3  # K


@dataclass(frozen=True)
class IntentionHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced; `angle` has no effect, the policy takes every angle."""

    chi2_alpha: settings.Positive = 0.5  # α_χ of term 3


@dataclass(frozen=True)
class IntentionPolicy:
    """A policy of each intention, and the mean totals of its episodes; -inf without episodes."""

    policies: tuple[QPolicy, ...]
    totals: Float[np.ndarray, "intention 2"]

    def at(self, angle: float) -> QPolicy:
        """Return the policy of the intention that scores best at an angle in degrees."""
        with np.errstate(invalid="ignore"):  # a weight of 0 times -inf is NaN, which is no score
            scores = score(weights(angle), RewardPair(*self.totals.T))
        return self.policies[int(np.nanargmax(scores))]


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
        count = self.episodes.inside.shape[0]
        concentration = jnp.ones(self.static.intentions)
        return state, shared.Carry(key, jax.random.dirichlet(for_first, concentration, (count,)))

    def draw(self, hyperparameters: Any, state: Any, carry: Any) -> tuple[Any, Any]:  # noqa: ARG002
        """Draw demonstrations with their episodes' responsibilities.

        Args:
            hyperparameters: Numbers of the run.
            state: Not used.
            carry: Random key, and the responsibilities.

        Returns:
            Rows with the responsibilities of their episodes, (batch, intention), and the next
            carry.
        """
        key, for_rows = jax.random.split(carry.key)
        rows = self.rows(for_rows, hyperparameters.dataset)
        share = carry.known[self.episodes.of_row[rows]]
        return (self.table.rows(rows), share), carry._replace(key=key)

    def loss(self, network: Any, target_network: Any, batch: Any, hyperparameters: Any):
        """-E[z r̂] + E[z (V(s) - γ V(s'))] + E[z r̂²] / (4 α_χ): L_IQ (Eq 2.7), summed over z.

        Args:
            network: Network of each intention.
            target_network: Slow copies of the networks, for the value of the next observation.
            batch: Rows, and the responsibilities z of their episodes.
            hyperparameters: Numbers of the run.

        Returns:
            The sum over intentions, and the same as the term "loss".
        """
        rows, responsibility = batch
        run = hyperparameters
        total = jnp.zeros(())
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
        """Return P(intention | episode), with the mean of the last responsibilities as prior.

        Args:
            hyperparameters: Numbers of the run.
            network: Network of each intention.
            responsibility: Last responsibilities, (episode, intention).
            longest: Number of rows of the largest set.

        Returns:
            Responsibilities (episode, intention); episodes of sets that the run does not use get
            the prior.
        """
        table = self.table
        episodes = self.episodes
        count = self.episodes.inside.shape[0]
        of_set = hyperparameters.dataset + jnp.arange(2)
        bounds = table.row_bounds[of_set]
        first, end = episodes.bounds[of_set]
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
        callbacks: Any = None,
        chunk: int = 200,
        before_chunk: Any = None,  # noqa: ARG002
        world: str = "",
    ) -> Any:
        """Train as every learner; an E step precedes each chunk of updates except the first.

        Args:
            hyperparameters: Numbers of each run.
            callbacks: Progress, monitor and checkpoint.
            chunk: Updates between two E steps, and between two calls of the callbacks.
            before_chunk: Not used.
            world: Description for the checkpoint.

        Returns:
            The outcome of all runs, `kernel.Trained`.
        """
        arrays = stack(hyperparameters)
        longest = int(jnp.diff(self.table.row_bounds).max())

        @jax.jit
        def step(learner: MultiIntention, *runs: Any) -> Array:  # one by one: it takes much memory
            return jax.lax.map(lambda run: learner.expectation(*run, longest=longest), runs)

        def e_step(runs: Runs, done: int) -> Runs:
            if done == 0:  # the networks know nothing yet
                return runs
            responsibility = step(self, arrays, runs.state.network, runs.carry.known)
            return runs._replace(carry=runs.carry._replace(known=responsibility))

        return super().train(hyperparameters, callbacks, chunk, e_step, world)

    def retained(self, carry: shared.Carry) -> Array:
        """Return the responsibilities."""
        return carry.known

    def policy(
        self, hyperparameters: Any, state: Any, responsibilities: Any = None
    ) -> IntentionPolicy:
        """Return the policies of the intentions with their episodes' mean totals.

        Args:
            hyperparameters: Numbers of the run.
            state: State of the run, with the trained networks.
            responsibilities: Responsibilities of all episodes, (episode, intention).
        """
        record = self.record(hyperparameters)
        first, end = map(int, self.episodes.bounds[hyperparameters.dataset + jnp.arange(2)])
        share = np.asarray(responsibilities)[first:end]
        totals = np.stack([np.asarray(total)[first:end] for total in self.episodes.totals], 1)
        means = share.T @ totals / np.maximum(share.sum(axis=0), 1e-9)[:, None]
        # An intention without episodes has no score.
        means = np.where(share.sum(axis=0)[:, None] > 1e-3, means, -np.inf)
        temperature = hyperparameters.temperature
        policies = [QPolicy.of(network, temperature, record) for network in state.network]
        return IntentionPolicy(tuple(policies), means)
