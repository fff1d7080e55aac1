"""Clones, offline: of outcomes (RvS, PEDA), of optimal actions (CFGRL), of the best rows (DWBC).

RvS (Emmons et al. 2022; PEDA, Zhu et al. 2023): one network clones every demonstration given the
pair of totals (G_env, G_social) of its episode, as in RvS constant over the episode. At an angle
its condition is the demonstrated pair that scores best.

CFGRL (Frans et al. 2025): one network clones the demonstrations twice, without a condition,
π̂(a|s), and given that the advantage A(s, a) of R(α) is 0 or more, π̂(a|s, o = 1). With the
guidance weight w the policy is

    π_w(a|s) ∝ π̂(a|s) (π̂(a|s, o = 1) / π̂(a|s))^w ∝ π̂(a|s) p(o = 1|s, a)^w.

DWBC (Xu et al. 2022): the best share of the episodes by R(α) are the expert's, E. All episodes are
the mixed set O, which holds more of what the expert would do. A discriminator d(s, a, log π(a|s))
learns which rows are E's from positive and unlabelled rows, and gives the clone's rows their
weights.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray
from scipy.linalg import block_diag

from socialiq import QPolicy, RewardPair, score, weights
from socialiq.learners import expert_table, settings
from socialiq.nn.dial_network import DialNetwork
from socialiq.types import Transitions
from socialiq_lab import baselines as shared


class ConditionedClone(shared.Baseline):
    """A clone with two further inputs; `draw` returns rows and their conditions."""

    has_target: ClassVar[bool] = False

    def network(self, key: PRNGKeyArray) -> DialNetwork:
        """Draw a network whose two further inputs are the condition."""
        return self.conditioned_network(key)

    def loss(self, network: Any, target_network: Any, batch: Any, hyperparameters: Any):  # noqa: ARG002
        """Return the negative log-likelihood of the demonstrated actions under the conditions.

        Args:
            network: The clone.
            target_network: Not used.
            batch: Demonstrated rows, and the pair of their conditions.
            hyperparameters: Not used.

        Returns:
            The mean over the batch, and the same as the term "loss".
        """
        rows, condition = batch
        logits = jax.vmap(network)(rows.observation, condition)
        loss = -jnp.mean(shared.log_likelihood(logits, rows.action))
        return loss, {"loss": loss}


@dataclasses.dataclass(frozen=True)
class OutcomeHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced; `angle` has no effect, the policy takes every angle."""

    quantile: settings.Share = 1.0
    """Quantile of R(α) among the demonstrated episodes of the one whose outcome is asked for."""


@dataclasses.dataclass(frozen=True)
class OutcomePolicy:
    """Clone that is conditioned on one of the `totals` of the demonstrated episodes."""

    network: DialNetwork
    totals: Float[np.ndarray, "episode 2"]
    quantile: float
    record: Mapping[str, Any]

    def at(self, angle: float) -> QPolicy:
        """Return the policy under the condition of the best outcome at an angle in degrees."""
        scores = score(weights(angle), RewardPair(*self.totals.T))
        rank = round(self.quantile * (len(scores) - 1))
        mean, scale = scaling(self.totals)
        condition = (self.totals[np.argsort(scores, kind="stable")[rank]] - mean) / scale
        fixed = self.network.at(RewardPair(*jnp.asarray(condition, jnp.float32)))
        return QPolicy.of(fixed, 1.0, {**self.record, "angle": angle})


def scaling(
    totals: Float[np.ndarray, "episode 2"],
) -> tuple[Float[np.ndarray, " pair"], Float[np.ndarray, " pair"]]:
    """Return mean and standard deviation of the outcomes; a spread of 0 counts as 1."""
    spread = totals.std(axis=0)
    return totals.mean(axis=0), np.where(spread > 0.0, spread, 1.0)


class OutcomeConditioned(ConditionedClone):
    """Clone of demonstrations given their episodes' outcomes."""

    scales: Any = None  # mean and spread of the outcomes of each set, (set, 2, 2)
    Hyperparameters: ClassVar[type] = OutcomeHyperparameters
    name: ClassVar[str] = "outcome_conditioned"
    target_kind: ClassVar[str] = "trajectory"

    @classmethod
    def of(cls, static: Any, datasets: Sequence[Transitions]) -> "OutcomeConditioned":
        """Make the learner of sets of demonstrations, each row with its episode's totals.

        Args:
            static: Static configuration of all runs.
            datasets: Sets of demonstrations.
        """
        scales = jnp.asarray([scaling(shared.totals_of(data)) for data in datasets], jnp.float32)
        return dataclasses.replace(super().of(static, datasets), scales=scales)

    def draw(self, hyperparameters: Any, state: Any, carry: Any) -> tuple[Any, Any]:
        """Draw demonstrations with their outcomes, scaled.

        Args:
            hyperparameters: Numbers of the run.
            state: State of the run.
            carry: Random key.

        Returns:
            Rows with the pair of their scaled outcomes, and the next key.
        """
        rows, key = super().draw(hyperparameters, state, carry)
        columns = zip(rows.target, *self.scales[hyperparameters.dataset], strict=True)
        outcome = RewardPair(*((total - mean) / spread for total, mean, spread in columns))
        return (rows, outcome), key

    def policy(self, hyperparameters: Any, state: Any, _retained: Any = None) -> OutcomePolicy:
        """Return the clone with the outcomes of its demonstrations.

        Args:
            hyperparameters: Numbers of the run.
            state: State of the run, with the trained network.
        """
        first, end = self.table.start_bounds[hyperparameters.dataset + jnp.arange(2)]
        starts = self.table.starts[int(first) : int(end)]
        totals = np.stack([np.asarray(total[starts]) for total in self.table.columns.target], 1)
        record = self.record(hyperparameters)
        return OutcomePolicy(state.network, totals, hyperparameters.quantile, record)


@dataclasses.dataclass(frozen=True)
class GuidanceConfig(settings.LearnerConfig):
    """Choices that shape the program."""

    advantage: Literal["advantage", "advantage_fitted"] = "advantage"
    """V of the advantage: by states that are seen again, or by a fitted network."""


@dataclasses.dataclass(frozen=True)
class GuidanceHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced."""

    guidance: settings.NotNegative = 3.0
    """w: 0 is the plain clone, 1 the clone of actions with o = 1."""
    dropped: settings.Share = 0.2  # share of rows that are learned without their condition


class GuidedCloning(ConditionedClone):
    """A clone with and without the condition of optimality; its policy is their product.

    A condition is (1, o), or (0, 0) of a row that is learned without it.
    """

    StaticConfig: ClassVar[type] = GuidanceConfig
    Hyperparameters: ClassVar[type] = GuidanceHyperparameters
    name: ClassVar[str] = "guidance"

    @classmethod
    def of(cls, static: Any, datasets: Sequence[Transitions]) -> "GuidedCloning":
        """Make the learner of sets of demonstrations, with their advantages.

        Args:
            static: Static configuration of all runs.
            datasets: Sets of demonstrations.
        """
        table = expert_table.ExpertTable.of(datasets, static.advantage, 0.99)
        return cls(static, (int(datasets[0].observation.shape[1]), datasets[0].n_actions), table)

    def draw(self, hyperparameters: Any, state: Any, carry: Any) -> tuple[Any, Any]:
        """Draw demonstrations, and decide which rows show their condition.

        Args:
            hyperparameters: Numbers of the run.
            state: State of the run.
            carry: Random key.

        Returns:
            Rows with the pair of their conditions, and the next key.
        """
        rows, key = super().draw(hyperparameters, state, carry)
        key, for_drop = jax.random.split(key)
        draws = jax.random.uniform(for_drop, rows.action.shape)
        is_shown = (draws >= hyperparameters.dropped).astype(jnp.float32)
        optimal = score(hyperparameters.weights, rows.target) >= 0.0
        return (rows, RewardPair(is_shown, is_shown * optimal)), key

    def policy(self, hyperparameters: Any, state: Any, _retained: Any = None) -> QPolicy:
        """Return the guided policy; its logits are those of π_w.

        Args:
            hyperparameters: Numbers of the run.
            state: State of the run, with the trained network.
        """
        record = self.record(hyperparameters)
        conditions = [RewardPair(value, value) for value in (jnp.zeros(()), jnp.ones(()))]
        plain, optimal = (QPolicy.of(state.network.at(c), 1.0, record) for c in conditions)
        return guided(plain, optimal, hyperparameters.guidance)


def guided(plain: QPolicy, optimal: QPolicy, guidance: float) -> QPolicy:
    """Return one network with the logits (1 - w) plain + w optimal.

    Args:
        plain: Clone without a condition.
        optimal: Clone under the condition of optimality, with layers of the same sizes.
        guidance: Weight w: 0 is the plain clone, 1 the optimal one.

    Returns:
        Network whose hidden layers are twice as wide, with the further fields of `plain`.
    """
    share = 1.0 - guidance
    matrices = list(zip(plain.weights, optimal.weights, strict=True))
    biases = list(zip(plain.biases, optimal.biases, strict=True))
    if len(matrices) == 1:
        combined = [share * a + guidance * b for a, b in matrices]
    else:
        ends = np.concatenate([share * matrices[-1][0], guidance * matrices[-1][1]], axis=1)
        inner = [np.asarray(block_diag(a, b), np.float32) for a, b in matrices[1:-1]]
        combined = [np.concatenate(matrices[0]), *inner, ends]
    shifts = [np.concatenate(pair) for pair in biases[:-1]]
    shifts.append(share * biases[-1][0] + guidance * biases[-1][1])
    return dataclasses.replace(plain, weights=tuple(combined), biases=tuple(shifts))


CLIPPED = 0.1, 0.9  # bounds of DWBC's d in the weights, as in the paper


@dataclasses.dataclass(frozen=True)
class DWBCConfig(settings.LearnerConfig):
    """Choices that shape the program."""

    parts: settings.Count = 3  # one part in so many of the episodes are the expert's


@dataclasses.dataclass(frozen=True)
class DWBCHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced."""

    expert_weight: settings.NotNegative = 7.5
    """α of the paper: weight of the plain likelihood of E's rows."""
    positive_share: settings.NotNegative = 0.5
    """η of the paper: how much E's rows count in the discriminator's loss."""


class DWBCNetworks(NamedTuple):
    """The clone's logits, and the discriminator's, whose further inputs are log π(a|s) and 0."""

    policy: Any
    discriminator: DialNetwork


class DiscriminatorWeighted(shared.EpisodeLearner):
    """A clone whose rows are weighted by a discriminator; carries the weights of E's rows."""

    StaticConfig: ClassVar[type] = DWBCConfig
    Hyperparameters: ClassVar[type] = DWBCHyperparameters
    name: ClassVar[str] = "discriminator_weighted_bc"
    has_target: ClassVar[bool] = False

    def network(self, key: PRNGKeyArray) -> DWBCNetworks:
        """Draw both networks."""
        discriminator = self.conditioned_network(jax.random.fold_in(key, 1))
        return DWBCNetworks(super().network(key), discriminator)

    def initialise(self, hyperparameters: Any):
        """Draw the networks, and select the expert's rows: those of the best level."""
        state, key = super().initialise(hyperparameters)
        count = self.static.parts
        run = hyperparameters.weights, hyperparameters.dataset
        levels = jnp.append(self.episodes.levels(*run, count), count)
        best = levels[self.episodes.of_row] == 0
        return state, shared.Carry(key, jnp.cumsum(best / jnp.sum(best)))

    def draw(self, hyperparameters: Any, state: Any, carry: Any) -> tuple[Any, Any]:
        """Draw equal numbers of rows of E and of O.

        Args:
            hyperparameters: Numbers of the run.
            state: State of the run.
            carry: Random key, and the cumulative weights of E's rows.

        Returns:
            The pair of rows of E and of O, and the next carry.
        """
        of_all, key = super().draw(hyperparameters, state, carry.key)
        key, for_expert = jax.random.split(key)
        expert = self.table.sample_weighted(for_expert, carry.known, self.static.batch_size)
        return (expert, of_all), carry._replace(key=key)

    def loss(self, network: Any, target_network: Any, batch: Any, hyperparameters: Any):  # noqa: ARG002
        """Return the loss of the discriminator, and the weighted one of the clone (their Eq 17).

        α E_E[-log π] - E_E[-log π η / (d (1 - d))] + E_O[-log π / (1 - d)]

        Args:
            network: The clone and the discriminator.
            target_network: Not used.
            batch: Rows of E, and rows of O.
            hyperparameters: Numbers of the run.

        Returns:
            The sum of both, and the terms "discriminator", "clone" and "loss".
        """
        run = hyperparameters
        logits = []
        likelihoods = []
        chances = []
        for rows in batch:
            likelihood = shared.log_likelihood(
                jax.vmap(network.policy)(rows.observation), rows.action
            )
            told = jax.lax.stop_gradient(likelihood)  # the clone learns nothing from d
            inputs = rows.observation, RewardPair(told, jnp.zeros_like(told))
            logit = shared.of_taken(jax.vmap(network.discriminator)(*inputs), rows.action)
            likelihoods.append(likelihood)
            logits.append(logit)
            chances.append(jnp.clip(jax.nn.sigmoid(jax.lax.stop_gradient(logit)), *CLIPPED))
        share = run.positive_share
        expert, of_all = likelihoods
        expert_chance, chance = chances
        weight = run.expert_weight - share / (expert_chance * (1.0 - expert_chance))
        return shared.summed(
            {
                "discriminator": discriminator_loss(logits[0], logits[1], share),
                "clone": -jnp.mean(weight * expert) - jnp.mean(of_all / (1.0 - chance)),
            }
        )


def discriminator_loss(
    expert: Float[Array, " batch"], mixed: Float[Array, " batch"], share: Array | float
) -> Float[Array, ""]:
    """Return η E_E[-log d] + E_O[-log (1 - d)] - η E_E[-log (1 - d)] (their Eq 10).

    Args:
        expert: Logits of d for rows of E.
        mixed: Logits of d for rows of O.
        share: η, the weight of E's rows.
    """
    positive = jax.nn.softplus(-expert) - jax.nn.softplus(expert)
    return jnp.mean(share * positive) + jnp.mean(jax.nn.softplus(mixed))
