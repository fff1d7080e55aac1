"""LS-IQ (Al-Hafez et al. 2023): IQ-Learn with χ² on the mixture as least squares.

With the penalty c/2 (E_E[r̂²] + E_π[r̂²]) IQ-Learn's objective is, but for a constant,

    c/2 E_E[(r̂ - 1/c)²] + c/2 E_π[(r̂ + 1/c)²],

so demonstrated transitions have the reward 1/c and the learner's own -1/c. LS-IQ then gives Q of a
demonstrated action its largest value 1/(c (1 - γ)) as a fixed target, bounds the values that
follow, and lets an episode's end be a state for ever, whose reward is the mean over those that end
there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from socialiq.learners.baselines.bellman import of_taken
from socialiq.learners.expert_table import Batch, ExpertTable
from socialiq.learners.iq_learn import config, losses
from socialiq.learners.iq_learn.train import IQLearn
from socialiq.learners.kernel import Terms
from socialiq.learners.settings import check_above_zero
from socialiq.learners.state import HyperparameterArrays
from socialiq.types import Ending, Simulator, Transitions


@dataclass(frozen=True)
class StaticConfig(config.IQLearnConfig):
    """Choices that shape the program; those of acting are IQ-Learn's."""

    fixed_target: bool = True
    """Whether Q of demonstrated actions has a fixed target, or r̂ has the target 1/c."""


@dataclass(frozen=True)
class Hyperparameters(config.IQLearnHyperparameters):
    """Numbers of one run, all traced."""

    regularisation: float = 0.5
    """c: rewards lie between -1/c and 1/c."""

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        super().__post_init__()
        check_above_zero(self, ("regularisation",))


class LSIQ(IQLearn):
    """Least-squares inverse Q-learning; acts with softmax(Q/τ)."""

    StaticConfig: ClassVar[type] = StaticConfig
    Hyperparameters: ClassVar[type] = Hyperparameters
    name: ClassVar[str] = "ls_iq"

    @classmethod
    def of(
        cls, static: Any, datasets: Sequence[Transitions], simulator: Simulator | None = None
    ) -> LSIQ:
        """Make the learner of sets of demonstrations and the world to act in."""
        table = ExpertTable.of(datasets, "instantaneous", 1.0)
        sizes = (int(datasets[0].observation.shape[1]), datasets[0].n_actions)
        return cls(static, sizes, table, simulator=simulator)

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Half the squared distances of demonstrations and of own transitions to their targets."""
        largest = 1.0 / hyperparameters.regularisation
        absorbing = absorbing_reward(batch.expert.ending, batch.replay.ending, largest)
        terms = {}
        for name, rows, reward in (
            ("expert", batch.expert, largest),
            ("own", batch.replay, -largest),
        ):
            target = reward + hyperparameters.discount * bounded_value(
                target_network, rows, hyperparameters, largest, absorbing
            )
            if name == "expert" and self.static.fixed_target:
                target = jnp.full_like(target, largest / (1.0 - hyperparameters.discount))
            q = of_taken(jax.vmap(network)(rows.observation), rows.action)
            terms[name] = jnp.mean(jnp.square(q - jax.lax.stop_gradient(target))) / 2
        total = terms["expert"] + terms["own"]
        return total, terms | {"loss": total}


def absorbing_reward(
    expert: Array, own: Array, largest: Float[Array, ""] | float
) -> Float[Array, ""]:
    """Return the least-squares reward of the state after the end: 1/c and -1/c by their shares.

    Args:
        expert: Endings of demonstrations, values of `types.Ending`.
        own: Endings of the learner's own transitions.
        largest: 1/c.
    """
    ended = [jnp.sum(one != int(Ending.NONE)) for one in (expert, own)]
    return largest * (ended[0] - ended[1]) / jnp.maximum(ended[0] + ended[1], 1)


def bounded_value(
    network: Any,
    rows: Batch,
    hyperparameters: HyperparameterArrays,
    largest: Float[Array, ""],
    absorbing: Float[Array, ""],
) -> Float[Array, " batch"]:
    """Return V(s') within ±1/(c (1 - γ)); after the end that of the absorbing state."""
    bound = largest / (1.0 - hyperparameters.discount)
    value = losses.soft_value(jax.vmap(network)(rows.next_observation), hyperparameters.temperature)
    value = jnp.clip(value, -bound, bound)
    ended = rows.ending != int(Ending.NONE)
    return jnp.where(ended, absorbing / (1.0 - hyperparameters.discount), value)
