"""Clones with a condition, offline: outcomes (RvS, PEDA) and optimality (CFGRL).

RvS (Emmons et al. 2022; PEDA, Zhu et al. 2023): one network clones every demonstration given the
pair of totals (G_env, G_social) of its episode. At an angle it is asked for the best pair that was
demonstrated there. As in RvS the outcome is constant over an episode; returns that are counted
down, as PEDA has them, would need a policy with memory.

CFGRL (Frans et al. 2025): one network clones the demonstrations twice, without a condition,
π̂(a|s), and given that the advantage A(s, a) of R(α) is 0 or more, π̂(a|s, o = 1). With the
guidance weight w the policy is

    π_w(a|s) ∝ π̂(a|s) (π̂(a|s, o = 1) / π̂(a|s))^w ∝ π̂(a|s) p(o = 1|s, a)^w,

which is better the larger w is, as long as both clones are right.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray
from scipy.linalg import block_diag

from socialiq.learners import settings
from socialiq.learners.expert_table import Batch, ExpertTable
from socialiq.learners.kernel import Learner, Terms
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import score, weights
from socialiq.types import RewardPair, Transitions
from studies.compare_methods.baselines.shared import log_likelihood, totals_of


@dataclass(frozen=True)
class OutcomeHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced; `angle` has no effect, the policy takes every angle."""

    quantile: settings.Share = 1.0
    """Quantile of R(α) among the demonstrated episodes of the one whose outcome is asked for."""


@dataclass(frozen=True)
class OutcomePolicy:
    """Clone that is asked for an outcome; `at` returns the policy of one angle.

    Attributes:
        network: Its two further inputs are the outcome, scaled.
        totals: Outcome of every demonstrated episode, (episode, 2).
        quantile: Quantile of R(α) that is asked for.
        record: JSON-compatible record.
    """

    network: DialNetwork
    totals: Float[np.ndarray, "episode 2"]
    quantile: float
    record: Mapping[str, Any] = field(default_factory=dict)

    def at(self, angle: float) -> QPolicy:
        """Return the policy that is asked for the best outcome at an angle in degrees."""
        scores = score(weights(angle), RewardPair(*self.totals.T))
        rank = round(self.quantile * (len(scores) - 1))
        outcome = self.totals[np.argsort(scores, kind="stable")[rank]]
        mean, scale = scaling(self.totals)
        condition = (outcome - mean) / scale
        fixed = self.network.at(RewardPair(*jnp.asarray(condition, jnp.float32)))
        return QPolicy.of(fixed, 1.0, {**self.record, "angle": angle})


def scaling(
    totals: Float[np.ndarray, "episode 2"],
) -> tuple[Float[np.ndarray, " pair"], Float[np.ndarray, " pair"]]:
    """Return mean and standard deviation of the outcomes; a spread of 0 counts as 1."""
    spread = totals.std(axis=0)
    return totals.mean(axis=0), np.where(spread > 0.0, spread, 1.0)


class OutcomeConditioned(Learner):
    """Clone of demonstrations given their episodes' outcomes.

    Attributes:
        scales: Mean and spread of the outcomes of each set, (set, 2, 2).
    """

    scales: Float[Array, "set 2 2"] | None = None

    Hyperparameters: ClassVar[type] = OutcomeHyperparameters
    name: ClassVar[str] = "outcome_conditioned"
    has_target: ClassVar[bool] = False

    @classmethod
    def of(cls, static: Any, datasets: Sequence[Transitions]) -> OutcomeConditioned:
        """Make the learner of sets of demonstrations, each row with its episode's totals."""
        table = ExpertTable.of(datasets, "trajectory", 1.0)
        sizes = (int(datasets[0].observation.shape[1]), datasets[0].n_actions)
        scales = jnp.asarray([scaling(totals_of(data)) for data in datasets], jnp.float32)
        return cls(static, sizes, table, scales)

    def network(self, key: PRNGKeyArray) -> DialNetwork:
        """Draw a network whose two further inputs are the outcome."""
        static, (n_features, n_actions) = self.static, self.sizes
        shape = (static.hidden, n_actions, static.activation, static.view)
        return DialNetwork.initialise(key, n_features, *shape)

    def loss(
        self,
        network: Any,
        target_network: Any,  # noqa: ARG002
        batch: Any,
        hyperparameters: HyperparameterArrays,
    ) -> tuple[Float[Array, ""], Terms]:
        """Negative log-likelihood of the demonstrated actions given the outcomes."""
        assert self.scales is not None
        mean, scale = self.scales[hyperparameters.dataset]
        pairs = zip(batch.target, mean, scale, strict=True)
        outcome = RewardPair(*((total - middle) / spread for total, middle, spread in pairs))
        logits = jax.vmap(network)(batch.observation, outcome)
        loss = -jnp.mean(log_likelihood(logits, batch.action))
        return loss, {"loss": loss}

    def policy(self, hyperparameters: Any, state: TrainState, kept: Any = None) -> OutcomePolicy:  # noqa: ARG002
        """Return the clone with the outcomes of its demonstrations."""
        assert self.table is not None
        first, end = self.table.start_bounds[hyperparameters.dataset + jnp.arange(2)]
        starts = self.table.starts[int(first) : int(end)]
        totals = np.stack([np.asarray(total[starts]) for total in self.table.columns.target], 1)
        record = self.record(hyperparameters)
        return OutcomePolicy(state.network, totals, hyperparameters.quantile, record)


@dataclass(frozen=True)
class GuidanceConfig(settings.LearnerConfig):
    """Choices that shape the program."""

    advantage: Literal["advantage", "advantage_fitted"] = "advantage"
    """V of the advantage: by states that are seen again, or by a fitted network."""


@dataclass(frozen=True)
class GuidanceHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced."""

    guidance: settings.NotNegative = 3.0
    """w: 0 is the plain clone, 1 the clone of actions with o = 1."""
    dropped: settings.Share = 0.2
    """Share of rows that are learned without their condition."""


class Conditioned(NamedTuple):
    """Rows with their conditions.

    Attributes:
        batch: Demonstrations.
        condition: (1, o) where the condition is shown, (0, 0) where it is not.
    """

    batch: Batch
    condition: RewardPair


class GuidedCloning(Learner):
    """A clone with and without the condition of optimality; its policy is their product."""

    StaticConfig: ClassVar[type] = GuidanceConfig
    Hyperparameters: ClassVar[type] = GuidanceHyperparameters
    name: ClassVar[str] = "guidance"
    has_target: ClassVar[bool] = False

    @classmethod
    def of(cls, static: Any, datasets: Sequence[Transitions]) -> GuidedCloning:
        """Make the learner of sets of demonstrations, with their advantages."""
        table = ExpertTable.of(datasets, static.advantage, 0.99)
        return cls(static, (int(datasets[0].observation.shape[1]), datasets[0].n_actions), table)

    def network(self, key: PRNGKeyArray) -> DialNetwork:
        """Draw a network whose two further inputs are the condition."""
        static, (n_features, n_actions) = self.static, self.sizes
        shape = (static.hidden, n_actions, static.activation, static.view)
        return DialNetwork.initialise(key, n_features, *shape)

    def draw(
        self, hyperparameters: HyperparameterArrays, state: TrainState, carry: Any
    ) -> tuple[Conditioned, Any]:
        """Draw demonstrations, and the rows that show their condition."""
        batch, key = super().draw(hyperparameters, state, carry)
        key, for_drop = jax.random.split(key)
        draws = jax.random.uniform(for_drop, batch.action.shape)
        is_shown = (draws >= hyperparameters.dropped).astype(jnp.float32)
        optimal = score(hyperparameters.weights, batch.target) >= 0.0
        return Conditioned(batch, RewardPair(is_shown, is_shown * optimal)), key

    def loss(
        self,
        network: Any,
        target_network: Any,  # noqa: ARG002
        batch: Any,
        hyperparameters: HyperparameterArrays,  # noqa: ARG002
    ) -> tuple[Float[Array, ""], Terms]:
        """Negative log-likelihood of the demonstrated actions under the conditions."""
        logits = jax.vmap(network)(batch.batch.observation, batch.condition)
        loss = -jnp.mean(log_likelihood(logits, batch.batch.action))
        return loss, {"loss": loss}

    def policy(self, hyperparameters: Any, state: TrainState, kept: Any = None) -> QPolicy:  # noqa: ARG002
        """Return the guided policy; its logits are those of π_w."""
        plain = state.network.at(RewardPair(jnp.zeros(()), jnp.zeros(())))
        optimal = state.network.at(RewardPair(jnp.ones(()), jnp.ones(())))
        record = self.record(hyperparameters)
        return guided(
            QPolicy.of(plain, 1.0, record),
            QPolicy.of(optimal, 1.0, record),
            hyperparameters.guidance,
        )


def guided(plain: QPolicy, optimal: QPolicy, guidance: float) -> QPolicy:
    """Return one network with the logits (1 - w) plain + w optimal.

    Args:
        plain: Clone without a condition.
        optimal: Clone given o = 1, of the same layers and encoding.
        guidance: w.
    """
    share = 1.0 - guidance
    if len(plain.weights) == 1:
        pairs = [
            (share * a + guidance * b, share * c + guidance * d)
            for a, b, c, d in zip(
                plain.weights, optimal.weights, plain.biases, optimal.biases, strict=True
            )
        ]
    else:
        first = np.concatenate([plain.weights[0], optimal.weights[0]])
        inner = [
            np.asarray(block_diag(a, b), np.float32)
            for a, b in zip(plain.weights[1:-1], optimal.weights[1:-1], strict=True)
        ]
        last = np.concatenate([share * plain.weights[-1], guidance * optimal.weights[-1]], axis=1)
        biases = [
            np.concatenate(pair)
            for pair in zip(plain.biases[:-1], optimal.biases[:-1], strict=True)
        ]
        biases.append(share * plain.biases[-1] + guidance * optimal.biases[-1])
        pairs = list(zip([first, *inner, last], biases, strict=True))
    weights, biases = zip(*pairs, strict=True)
    return dataclasses.replace(plain, weights=tuple(weights), biases=tuple(biases))
