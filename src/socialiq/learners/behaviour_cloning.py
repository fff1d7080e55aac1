"""Behaviour cloning: the maximum-likelihood classifier of actions, on the same data and network."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jax.tree_util import Partial
from jaxtyping import Array

from socialiq.errors import UserError, one_of
from socialiq.learners import loop
from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.outside import Outside
from socialiq.learners.state import History
from socialiq.nn.q_network import ACTIVATIONS, QNetwork, network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.types import Transitions

_ADAM = optax.scale_by_adam()


@dataclass(frozen=True)
class Structure:
    """What shapes the program."""

    hidden: tuple[int, ...] = (64, 64)
    activation: str = "relu"
    batch_size: int = 64
    updates: int = 6000

    def __post_init__(self) -> None:
        """Refuse names and sizes that make no run."""
        one_of("activation", self.activation, tuple(ACTIVATIONS))
        if self.batch_size < 1 or self.updates < 1:
            raise UserError("batch_size and updates must be at least 1")


@dataclass(frozen=True)
class Numbers:
    """Numbers of one run, all traced."""

    learning_rate: float = 3e-4
    seed: int = 0
    dataset: int = 0

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        if not (math.isfinite(self.learning_rate) and self.learning_rate > 0):
            raise UserError(f"learning_rate must be above 0, got {self.learning_rate}")
        if not 0 <= self.seed < 2**32:
            raise UserError(f"seed must lie in [0, 2^32), got {self.seed}")
        if self.dataset < 0:
            raise UserError(f"dataset must be 0 or more, got {self.dataset}")


class _Traced(NamedTuple):
    learning_rate: Array
    seed: Array
    dataset: Array


class _Learnt(NamedTuple):
    network: QNetwork
    adam: Any


@dataclass(frozen=True)
class Cloned:
    """The outcome: one network for each of `numbers`."""

    structure: Structure
    numbers: tuple[Numbers, ...]
    networks: QNetwork
    history: History

    def policy(self, lane: int) -> QPolicy:
        """The clone of one lane; its soft policy at τ = 1 is the fitted distribution."""
        record = {
            "learner": "behaviour_cloning",
            "structure": asdict(self.structure),
            "numbers": asdict(self.numbers[lane]),
        }
        return QPolicy.of(network_of(self.networks, lane), 1.0, record)


def clone(
    structure: Structure,
    numbers: Sequence[Numbers],
    datasets: Sequence[Transitions],
    outside: Outside | None = None,
    chunk: int = 500,
) -> Cloned:
    """Clone one lane for each of `numbers`, all in one compiled program.

    Args:
        structure: What the lanes share.
        numbers: What they differ in.
        datasets: Sets of demonstrations; `Numbers.dataset` picks each lane's.
        outside: Progress, monitor, checkpoint.
        chunk: Updates between two looks at the outside.

    Raises:
        UserError: If there is no run, or no such set of demonstrations.
        Stopped: On Ctrl-C.
    """
    if not numbers or max(one.dataset for one in numbers) >= len(datasets):
        raise UserError("pass at least one run, and the demonstrations that each run names")
    table = ExpertTable.of(datasets, "instantaneous", 0.0)
    sizes = (datasets[0].observation.shape[1], datasets[0].n_actions)
    traced = _Traced(
        jnp.array([one.learning_rate for one in numbers], jnp.float32),
        jnp.array([one.seed for one in numbers], jnp.uint32),
        jnp.array([one.dataset for one in numbers], jnp.int32),
    )
    lanes, history = loop.run(
        initialise=partial(_initialise, structure, sizes),
        update=Partial(partial(_update, structure), table),
        numbers=traced,
        total=structure.updates,
        chunk=chunk,
        fingerprint=loop.fingerprint(table, structure, *numbers),
        outside=outside or Outside(),
    )
    return Cloned(structure, tuple(numbers), lanes.learnt.network, history)


def negative_log_likelihood(network: QNetwork, observation: Array, action: Array) -> Array:
    """-E[log softmax(network(s))[a]]."""
    logits = jax.vmap(network)(observation)
    return optax.softmax_cross_entropy_with_integer_labels(logits, action).mean()


def _initialise(
    structure: Structure, sizes: tuple[int, int], numbers: _Traced
) -> tuple[_Learnt, Array]:
    key, for_network = jax.random.split(jax.random.key(numbers.seed))
    network = QNetwork.initialise(
        for_network, sizes[0], structure.hidden, sizes[1], structure.activation
    )
    return _Learnt(network, _ADAM.init(eqx.filter(network, eqx.is_array))), key


def _update(
    structure: Structure, table: ExpertTable, numbers: _Traced, learnt: _Learnt, key: Array
) -> tuple[_Learnt, Array, dict[str, Array]]:
    key, for_batch = jax.random.split(key)
    batch = table.sample(for_batch, numbers.dataset, structure.batch_size)
    loss, gradient = jax.value_and_grad(negative_log_likelihood)(
        learnt.network, batch.observation, batch.action
    )
    direction, adam = _ADAM.update(gradient, learnt.adam)
    network = jax.tree.map(
        lambda weight, step: weight - numbers.learning_rate * step, learnt.network, direction
    )
    return _Learnt(network, adam), key, {"loss": loss}
