"""Cloning with the outcome as an input, offline (RvS, Emmons et al. 2022; PEDA, Zhu et al. 2023).

One network clones every demonstration given the pair of totals (G_env, G_social) that its episode
came to. At an angle it is asked for the best pair that was demonstrated there. As in RvS the
outcome is constant over an episode; returns that are counted down, as PEDA has them, would need a
policy with memory.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners import settings
from socialiq.learners.baselines.bellman import log_likelihood
from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.kernel import Learner, Terms
from socialiq.learners.settings import check_shares
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import score, weights
from socialiq.types import RewardPair, Transitions


@dataclass(frozen=True)
class Hyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced; `angle` has no effect, the policy takes every angle."""

    quantile: float = 1.0
    """Quantile of R(α) among the demonstrated episodes of the one whose outcome is asked for."""

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        super().__post_init__()
        check_shares(self, ("quantile",))


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
        place = round(self.quantile * (len(scores) - 1))
        wanted = self.totals[np.argsort(scores, kind="stable")[place]]
        mean, scale = scaling(self.totals)
        condition = (wanted - mean) / scale
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

    Hyperparameters: ClassVar[type] = Hyperparameters
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
        one, (n_features, n_actions) = self.static, self.sizes
        shape = (one.hidden, n_actions, one.activation, one.view)
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


def totals_of(data: Transitions) -> Float[np.ndarray, "episode 2"]:
    """Return the undiscounted totals (G_env, G_social) of each episode."""
    returns = data.returns("trajectory", 1.0)
    return np.stack([total[data.episode_starts] for total in returns], axis=1)
