"""Conservative Q-learning on the relabelled reward λ R(α): offline, from the same demonstrations.

CQL(H) of Kumar et al. 2020 with the soft value of Eq 2.5 in place of the hard maximum, so that it
has the temperature of the learner it is compared with: at `conservatism` = 1 / (2 κ) it is offline
IQ-Learn with the social prior, gradient by gradient (docs/theory.md).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from socialiq.learners import settings
from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.kernel import Learner, Terms
from socialiq.learners.state import HyperparameterArrays
from socialiq.social.angle import score

Scalar = Float[Array, ""]


@dataclass(frozen=True, kw_only=True)
class CQLConfig(settings.LearnerConfig):
    """Choices that shape the program. Defaults: those of IQ-Learn (Table C.1, gridworld)."""

    endings: Endings = field(default_factory=Endings)
    """Value of V(s') after each kind of ending."""


@dataclass(frozen=True)
class CQLHyperparameters(settings.LearnerHyperparameters):
    """Numbers of one run, all traced."""

    conservatism: settings.NotNegative = 1.0
    """α_CQL, the weight of τ logsumexp(Q/τ) - Q(s, a) beside half the squared error."""


class ConservativeQ(Learner):
    """Conservative Q-learning of demonstrations."""

    StaticConfig: ClassVar[type] = CQLConfig
    Hyperparameters: ClassVar[type] = CQLHyperparameters
    name: ClassVar[str] = "cql"

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Scalar, Terms]:
        """Return the loss of conservative Q-learning, and its terms.

        1/2 E[(Q(s, a) - λ R(α) - γ (1 - d) V(s'))²] + α_CQL E[V(s) - Q(s, a)], with
        V(s) = τ log sum_a exp(Q(s, a) / τ); V(s') is that of the target network, without gradient.
        Kumar et al. 2020, their Eq 4, with both expectations over the demonstrations.

        Args:
            network: Network of Q.
            target_network: Network of V(s').
            batch: Demonstrations; their target is the reward pair of the step.
            hyperparameters: Numbers of one run.

        Returns:
            The loss, and the terms "bellman", "conservative", "max_q" (recorded only) and "loss".
        """
        numbers = hyperparameters
        temperature = hyperparameters.temperature
        q = jax.vmap(network)(batch.observation)
        taken = jnp.take_along_axis(q, batch.action[:, None], axis=1)[:, 0]
        q_next = jax.vmap(target_network)(batch.next_observation)
        of_run = (q.shape[-1], temperature, numbers, self.static)
        next_value = losses.soft_value(q_next, temperature)
        follows = losses.continued(next_value, batch.ending, *of_run)
        reward = numbers.strength * score(numbers.weights, batch.target)
        error = losses.implicit_reward(taken, follows, numbers.discount) - reward
        gap = jnp.mean(losses.soft_value(q, temperature) - taken)
        terms = {
            "bellman": jnp.mean(jnp.square(error)) / 2,
            "conservative": numbers.conservatism * gap,
        }
        total = terms["bellman"] + terms["conservative"]
        return total, terms | {"max_q": jnp.max(jnp.abs(q)), "loss": total}
