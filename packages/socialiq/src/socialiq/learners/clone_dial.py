"""Clone of several demonstrators as one dial, by maximum likelihood; their angles are given.

At an angle α each demonstrator i has a share w_i(α): 1 about its own angle, falling linearly to 0
at the next one's. With ρ_i the states of demonstrator i and π_i its policy, the minimum is

    β(a | s, α) = Σ_i w_i(α) ρ_i(s) π_i(a | s) / Σ_i w_i(α) ρ_i(s)

the demonstrator itself at its own angle, and between two the policy of a mixture of their episodes.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from socialiq.errors import UserError
from socialiq.learners import config
from socialiq.learners.config import (
    check_above_zero,
    check_not_negative,
    check_rate,
    check_seed,
    check_shares,
)
from socialiq.learners.expert_table import Batch, draw_between
from socialiq.learners.kernel import Learner, Terms
from socialiq.learners.schedules import cosine
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle import check_angle
from socialiq.types import RewardPair


@dataclass(frozen=True)
class StaticConfig(config.StaticConfig):
    """Choices that shape the program. Defaults: the intersection."""

    demonstrators: tuple[float, ...] = (0.0, 45.0, 90.0)
    """Each demonstrator's angle in degrees, rising; as many sets of demonstrations are given."""
    low: float = 0.0
    """Smallest social angle trained for, in degrees."""
    high: float = 90.0
    """Largest social angle trained for, in degrees."""
    margin: float = 5.0
    """Degrees beyond both ends in which angles are also drawn, and on both sides of a
    demonstrator's angle in which its share is 1: a network rounds off a peak."""
    hidden: tuple[int, ...] = (128, 128)
    """Widths of the hidden layers."""
    view: str = "set"
    """Encoding of the vehicles of the intersection; a name of `nn.view.CHOICES`."""
    batch_size: int = 256
    """Demonstrated transitions of an update."""
    updates: int = 5000
    """Gradient steps."""

    def __post_init__(self) -> None:
        """Refuse names, sizes and angles that make no run."""
        super().__post_init__()
        for angle in (self.low, self.high, *self.demonstrators):
            check_angle(angle)
        check_not_negative(self, ("margin",))
        gaps = np.diff(self.demonstrators)
        if not self.demonstrators or (gaps <= 2.0 * self.margin).any() or self.low > self.high:
            raise UserError(
                "name the demonstrators' angles in rising order, further apart than twice the "
                "margin, and the smaller end of the range first"
            )


@dataclass(frozen=True)
class Hyperparameters:
    """Numbers of one run, all traced."""

    learning_rate: float = 1e-3
    """Adam's initial learning rate; it falls as a cosine."""
    final_rate: float = 0.02
    """Learning rate at the end, as a share of the first."""
    polyak: float = 0.01
    """Share of the network mixed at each update into its running average, the policy."""
    seed: int = 0
    """Seed of the network and the sampling."""

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        check_above_zero(self, ("learning_rate",))
        check_rate(self, ("polyak",))
        check_shares(self, ("final_rate",))
        check_seed(self.seed)


def shares(
    angle: Float[Array, " row"], demonstrators: Sequence[float], margin: float
) -> Float[Array, "row demonstrator"]:
    """Return w_i(α) of each demonstrator, which sum to 1.

    Args:
        angle: α in degrees.
        demonstrators: Their angles in degrees, rising.
        margin: Degrees on both sides of a demonstrator's angle in which its share is 1.
    """
    passed = [
        jnp.clip((angle - low - margin) / (high - low - 2.0 * margin), 0.0, 1.0)
        for low, high in itertools.pairwise(demonstrators)
    ]
    steps = jnp.stack([jnp.ones_like(angle), *passed, jnp.zeros_like(angle)], axis=1)
    return steps[:, :-1] - steps[:, 1:]


class Shown(NamedTuple):
    """Demonstrations, each with the direction (cos α, sin α) at which it is shown."""

    rows: Batch
    direction: RewardPair


class CloneDial(Learner):
    """Maximum likelihood of the actions that are demonstrated at each angle."""

    StaticConfig: ClassVar[type] = StaticConfig
    Hyperparameters: ClassVar[type] = Hyperparameters
    name: ClassVar[str] = "clone_dial"

    def network(self, key: Any) -> DialNetwork:
        """Draw a network of logits."""
        one, (n_features, n_actions) = self.static, self.sizes
        shape = (n_features, one.hidden, n_actions, one.activation, one.view)
        return DialNetwork.initialise(key, *shape)

    def draw(
        self,
        hyperparameters: HyperparameterArrays,  # noqa: ARG002
        state: TrainState,  # noqa: ARG002
        carry: Any,
    ) -> tuple[Shown, Any]:
        """Draw angles, at each a demonstrator by its share, and a transition of each."""
        assert self.table is not None
        key, for_angle, for_choice, for_row = jax.random.split(carry, 4)
        one, size = self.static, self.static.batch_size
        ends = {"minval": one.low - one.margin, "maxval": one.high + one.margin}
        angle = jax.random.uniform(for_angle, (size,), **ends)
        passed = jnp.cumsum(shares(angle, one.demonstrators, one.margin), axis=1)[:, :-1]
        chosen = (jax.random.uniform(for_choice, (size, 1)) >= passed).sum(axis=1)
        bounds = self.table.row_bounds
        drawn = [  # of each demonstrator as many, and at each angle that of the chosen one
            draw_between(one_key, size, first, end)
            for one_key, first, end in zip(
                jax.random.split(for_row, len(one.demonstrators)),
                bounds[:-1],
                bounds[1:],
                strict=True,
            )
        ]
        rows = self.table.rows(jnp.stack(drawn)[chosen, jnp.arange(size)])
        radians = jnp.deg2rad(angle)
        return Shown(rows, RewardPair(jnp.cos(radians), jnp.sin(radians))), key

    def loss(
        self,
        network: Any,
        target_network: Any,  # noqa: ARG002
        batch: Any,
        hyperparameters: HyperparameterArrays,  # noqa: ARG002
    ) -> tuple[Array, Terms]:
        """Negative log-likelihood of the demonstrated actions."""
        logits = jax.vmap(network)(batch.rows.observation, batch.direction)
        likely = optax.softmax_cross_entropy_with_integer_labels(logits, batch.rows.action)
        return likely.mean(), {"loss": likely.mean()}

    def learning_rate(self, hyperparameters: HyperparameterArrays, done: Array) -> Array:
        """Return the rate of an update: it falls as a cosine."""
        one = hyperparameters
        return cosine(one.learning_rate, one.final_rate, done, self.static.updates)

    def policy(self, hyperparameters: Any, state: TrainState, kept: Any = None) -> DialPolicy:  # noqa: ARG002
        """Return the running average of the network; its values are log-probabilities."""
        one, record = self.static, self.record(hyperparameters)
        return DialPolicy.of(state.target_network, 1.0, one.low, one.high, record)
