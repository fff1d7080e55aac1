"""Conservative Q-learning on the relabelled reward λ R(α): offline, from the same demonstrations.

CQL(H) of Kumar et al. 2020 with the soft value of Eq 2.5 in place of the hard maximum, so that it
has the temperature of the learner it stands beside: at `conservatism` = 1 / (2 κ) it is offline
IQ-Learn with the social prior, gradient by gradient (docs/theory.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from socialiq.errors import one_of
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.expert_table import Batch
from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.kernel import Learner, Terms, Trained, check_datasets
from socialiq.learners.ranges import (
    check_above_zero,
    check_counts,
    check_discount,
    check_not_negative,
    check_rate,
    check_seed,
)
from socialiq.learners.state import HyperparameterArrays
from socialiq.nn.q_network import ACTIVATIONS, QNetwork
from socialiq.nn.view import CHOICES
from socialiq.social.angle import check_angle, score
from socialiq.types import Transitions

Scalar = Float[Array, ""]


@dataclass(frozen=True)
class StaticConfig:
    """Static configuration; the defaults are those of IQ-Learn (Table C.1, gridworld)."""

    endings: Endings = field(default_factory=Endings)
    """Value of V(s') after each kind of ending."""
    hidden: tuple[int, ...] = (64, 64)
    activation: str = "relu"
    view: str = "flat"
    batch_size: int = 64
    updates: int = 6000

    def __post_init__(self) -> None:
        """Refuse names and sizes that make no run."""
        one_of("activation", self.activation, tuple(ACTIVATIONS))
        one_of("view", self.view, tuple(CHOICES))
        check_counts(self, ("batch_size", "updates"))


@dataclass(frozen=True)
class Hyperparameters:
    """Numbers of one run, all traced."""

    angle: float = 0.0
    """α of the reward, in degrees."""
    strength: float = 1.0
    """λ: the reward is λ R(α)."""
    conservatism: float = 1.0
    """α_CQL, the weight of τ logsumexp(Q/τ) - Q(s, a) beside half the squared error."""
    temperature: float = 1.0
    """τ."""
    discount: float = 0.99
    """γ."""
    learning_rate: float = 3e-4
    polyak: float = 0.005
    """Share of the network mixed into its target network at each update."""
    seed: int = 0
    dataset: int = 0

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        check_angle(self.angle)
        check_not_negative(self, ("strength", "conservatism", "dataset"))
        check_above_zero(self, ("temperature", "learning_rate"))
        check_discount(self.discount)
        check_rate(self, ("polyak",))
        check_seed(self.seed)


class ConservativeQ(Learner):
    """Conservative Q-learning of demonstrations."""

    StaticConfig: ClassVar[type] = StaticConfig
    Hyperparameters: ClassVar[type] = Hyperparameters
    name: ClassVar[str] = "cql"

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Scalar, Terms]:
        """Half the squared Bellman error, and the conservative term."""
        return conservative_loss(network, target_network, batch, hyperparameters, self.static)


def train(
    static: StaticConfig,
    hyperparameters: Sequence[Hyperparameters],
    datasets: Sequence[Transitions],
    callbacks: Callbacks | None = None,
    chunk: int = 500,
) -> Trained:
    """Train one run for each entry of `hyperparameters`, all in one compiled program.

    Args:
        static: Shared by all runs.
        hyperparameters: One entry for each run.
        datasets: Sets of demonstrations; `Hyperparameters.dataset` picks the set of each run.
        callbacks: Progress, monitor, checkpoint.
        chunk: Updates between two calls of the callbacks.

    Raises:
        UserError: If there is no run, or no such set of demonstrations.
        Stopped: On Ctrl-C.
    """
    check_datasets(hyperparameters, datasets)
    return ConservativeQ.of(static, datasets).train(hyperparameters, callbacks, chunk)


def conservative_loss(
    network: QNetwork,
    target_network: QNetwork,
    batch: Batch,
    hyperparameters: HyperparameterArrays,
    static: StaticConfig,
) -> tuple[Scalar, dict[str, Scalar]]:
    """1/2 E[(Q(s, a) - λ R(α) - γ (1 - d) V(s'))²] + α_CQL E[V(s) - Q(s, a)], and its terms.

    V(s) = τ log sum_a exp(Q(s, a) / τ); V(s') is that of the target network, without gradient.
    Kumar et al. 2020, their Eq 4, with both expectations over the demonstrations.
    """
    q = jax.vmap(network)(batch.observation)
    taken = jnp.take_along_axis(q, batch.action[:, None], axis=1)[:, 0]
    q_next = jax.vmap(target_network)(batch.next_observation)
    follows = losses.continuation(
        losses.soft_value(q_next, hyperparameters.temperature),
        batch.ending,
        static.endings.by_kind(),
        losses.absorbing_value(q.shape[-1], hyperparameters.temperature, hyperparameters.discount),
    )
    reward = hyperparameters.strength * score(hyperparameters.weights, batch.target)
    error = losses.implicit_reward(taken, follows, hyperparameters.discount) - reward
    gap = jnp.mean(losses.soft_value(q, hyperparameters.temperature) - taken)
    terms = {
        "bellman": jnp.mean(jnp.square(error)) / 2,
        "conservative": hyperparameters.conservatism * gap,
    }
    total = terms["bellman"] + terms["conservative"]
    return total, terms | {"max_q": jnp.max(jnp.abs(q)), "loss": total}
