"""Classifier-free guidance as policy improvement, offline (CFGRL, Frans et al. 2025).

One network clones the demonstrations twice: without a condition, π̂(a|s), and given that the
action was no worse than the demonstrators' mean, π̂(a|s, o = 1), o = 1 where the advantage A(s, a)
of R(α) is 0 or more. The policy is their product with the guidance weight w,

    π_w(a|s) ∝ π̂(a|s) (π̂(a|s, o = 1) / π̂(a|s))^w ∝ π̂(a|s) p(o = 1|s, a)^w,

which is better the larger w is, as long as both clones are right.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray
from scipy.linalg import block_diag

from socialiq.learners import settings
from socialiq.learners.baselines.bellman import log_likelihood
from socialiq.learners.expert_table import Batch, ExpertTable
from socialiq.learners.kernel import Learner, Terms
from socialiq.learners.settings import check_not_negative, check_shares
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import score
from socialiq.types import RewardPair, Transitions


@dataclass(frozen=True)
class StaticConfig(settings.LearnerConfig):
    """Choices that shape the program."""

    advantage: Literal["advantage", "advantage_fitted"] = "advantage"
    """V of the advantage: by states that are seen again, or by a fitted network."""


@dataclass(frozen=True)
class Hyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced."""

    guidance: float = 3.0
    """w: 0 is the plain clone, 1 the clone of actions with o = 1."""
    dropped: float = 0.2
    """Share of rows that are learned without their condition."""

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        super().__post_init__()
        check_not_negative(self, ("guidance",))
        check_shares(self, ("dropped",))


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

    StaticConfig: ClassVar[type] = StaticConfig
    Hyperparameters: ClassVar[type] = Hyperparameters
    name: ClassVar[str] = "guidance"
    has_target: ClassVar[bool] = False

    @classmethod
    def of(cls, static: Any, datasets: Sequence[Transitions]) -> GuidedCloning:
        """Make the learner of sets of demonstrations, with their advantages."""
        table = ExpertTable.of(datasets, static.advantage, 0.99)
        return cls(static, (int(datasets[0].observation.shape[1]), datasets[0].n_actions), table)

    def network(self, key: PRNGKeyArray) -> DialNetwork:
        """Draw a network whose two further inputs are the condition."""
        one, (n_features, n_actions) = self.static, self.sizes
        shape = (one.hidden, n_actions, one.activation, one.view)
        return DialNetwork.initialise(key, n_features, *shape)

    def draw(
        self, hyperparameters: HyperparameterArrays, state: TrainState, carry: Any
    ) -> tuple[Conditioned, Any]:
        """Draw demonstrations, and the rows that show their condition."""
        batch, key = super().draw(hyperparameters, state, carry)
        key, for_drop = jax.random.split(key)
        draws = jax.random.uniform(for_drop, batch.action.shape)
        shown = (draws >= hyperparameters.dropped).astype(jnp.float32)
        optimal = score(hyperparameters.weights, batch.target) >= 0.0
        return Conditioned(batch, RewardPair(shown, shown * optimal)), key

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
