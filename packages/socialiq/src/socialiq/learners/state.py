"""State of training runs: networks and optimiser, hyperparameters as arrays, recorded history."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Int

from socialiq.errors import UserError
from socialiq.social.angle import exact_weights
from socialiq.types import RewardPair

_ADAM = optax.scale_by_adam()  # the learning rate of each run is traced, and applied beside it


class TrainState(NamedTuple):
    """State that an optimiser step changes.

    Attributes:
        network: The trained network, or networks.
        target_network: Running average of `network`; None for a learner without one.
        optimiser: State of Adam.
        average: Average of the weights over the updates; None for a learner without one.
    """

    network: Any
    target_network: Any
    optimiser: Any
    average: Any = None

    @staticmethod
    def of(network: Any, has_target: bool = True, has_average: bool = False) -> TrainState:
        """Begin with a network and a fresh optimiser.

        Args:
            network: The network, or networks.
            has_target: Whether the state has a target network, here the same network.
            has_average: Whether the state has an average of the weights, here the same network.

        Returns:
            The state before the first update.
        """
        optimiser = _ADAM.init(eqx.filter(network, eqx.is_array))
        target_network = network if has_target else None
        return TrainState(network, target_network, optimiser, network if has_average else None)

    def step(
        self,
        gradient: Any,
        learning_rate: Any,
        polyak: Float[Array, ""] | float,
    ) -> TrainState:
        """Take one Adam step; move the target network towards the new network.

        Args:
            gradient: Gradient of the loss, with the structure of the network.
            learning_rate: A scalar, or one for each part of the network: a prefix of its tree.
            polyak: Share of the new network that is mixed into the target network.

        Returns:
            The state after the step; its average is unchanged.
        """
        direction, optimiser = _ADAM.update(gradient, self.optimiser)
        change = jax.tree.map(lambda rate, steps: _scaled(-rate, steps), learning_rate, direction)
        network = optax.apply_updates(self.network, change)
        if self.target_network is None:
            return self._replace(network=network, optimiser=optimiser)
        # `optax.incremental_update` computes p new + (1 - p) old, which rounds otherwise than
        # old + p (new - old): 300 updates later weights differ by up to 5e-3, and after the 6,000
        # of the gridworld study the soft policy's angle by 1 degree. Results have to stay equal.
        gap = jax.tree.map(lambda new, old: new - old, network, self.target_network)
        target_network = optax.apply_updates(self.target_network, _scaled(polyak, gap))
        return self._replace(network=network, target_network=target_network, optimiser=optimiser)

    def averaged(self, share: float) -> TrainState:
        """Mix the network into the average, by `share` or 1/updates, whichever is greater."""
        mixed = jnp.maximum(share, 1.0 / self.optimiser.count)
        gap = jax.tree.map(lambda new, old: new - old, self.network, self.average)
        return self._replace(average=optax.apply_updates(self.average, _scaled(mixed, gap)))

    def deployed(self) -> TrainState:
        """Return the state that a policy is made of: with the average as its network."""
        return self if self.average is None else self._replace(network=self.average)


def _scaled(factor: Any, tree: Any) -> Any:
    return jax.tree.map(lambda leaf: factor * leaf, tree)


class HyperparameterArrays(eqx.Module):
    """Hyperparameters as arrays, read by their names; stacked, with a leading axis of runs.

    An angle is kept as `weights`, the pair (cos α, sin α).
    """

    values: dict[str, Any]

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["values"][name]
        except KeyError:
            raise AttributeError(f"no hyperparameter '{name}'") from None

    def __getitem__(self, run: int) -> HyperparameterArrays:
        """Return the hyperparameters of one run of a stack."""
        return jax.tree.map(lambda column: column[run], self)

    def replace(self, **changes: Any) -> HyperparameterArrays:
        """Return a copy with other values."""
        return HyperparameterArrays({**self.values, **changes})


_DTYPES = {"seed": jnp.uint32, "dataset": jnp.int32}


def stack(hyperparameters: Sequence[Any]) -> HyperparameterArrays:
    """Stack the hyperparameters of runs, dataclasses of numbers, into arrays.

    Raises:
        UserError: If a field is not a number.
    """
    values: dict[str, Any] = {}
    for column_field in dataclasses.fields(hyperparameters[0]):
        column = [getattr(run, column_field.name) for run in hyperparameters]
        if not all(isinstance(value, int | float) for value in column):
            raise UserError(
                f"hyperparameter '{column_field.name}' must be a number: put it elsewhere"
            )
        if column_field.name == "angle":
            env, social = zip(*(exact_weights(angle) for angle in column), strict=True)
            pair = RewardPair(jnp.array(env, jnp.float32), jnp.array(social, jnp.float32))
            values["weights"] = pair
        else:
            values[column_field.name] = jnp.array(
                column, _DTYPES.get(column_field.name, jnp.float32)
            )
    return HyperparameterArrays(values)


class Runs(NamedTuple):
    """The state of all runs; every array has a leading axis of runs.

    Attributes:
        state: What training changes and a non-finite loss must not touch.
        carry: Random key, replay, episode: whatever else an update carries along.
        updates: Number of updates done.
        failed_at: Update at which the run broke, -1 while it is sound.
        failed_term: Index of the first term that was not finite (in the order of their names).
    """

    state: Any
    carry: Any
    updates: Int[Array, " run"]
    failed_at: Int[Array, " run"]
    failed_term: Int[Array, " run"]


@dataclass
class History:
    """Records of the end of each chunk; arrays are (chunks, runs)."""

    updates: list[int] = field(default_factory=list)
    values: dict[str, list[np.ndarray]] = field(default_factory=dict)

    def add(self, updates: int, values: dict[str, np.ndarray]) -> None:
        """Record one chunk.

        Args:
            updates: Number of updates done at the end of the chunk.
            values: Quantities by name, each (runs,).
        """
        self.updates.append(updates)
        for name in sorted(values):  # the order in which a checkpoint gives them back
            self.values.setdefault(name, []).append(np.asarray(values[name], np.float64))

    def array(self, name: str) -> np.ndarray:
        """Return one recorded quantity, (chunks, runs)."""
        return np.stack(self.values[name])


def linear(first: Any, last: Any, done: Array, updates: int) -> Array:
    """Return the rate of an update, which changes linearly.

    Args:
        first: Rate from which it changes.
        last: Rate of the last update.
        done: Number of updates done.
        updates: Number of updates of a run.

    Returns:
        The rate of the update after `done` updates.
    """
    return first + (done + 1) / updates * (last - first)


def cosine(first: Any, final_share: Any, done: Array, updates: int) -> Array:
    """Return the rate of an update, which falls as a cosine.

    Args:
        first: Rate of the first update.
        final_share: Rate at the end, as a share of the first.
        done: Number of updates done.
        updates: Number of updates of a run.

    Returns:
        The rate of the update after `done` updates.
    """
    fallen = 0.5 * (1.0 + jnp.cos(jnp.pi * done / updates))
    return first * (final_share + (1.0 - final_share) * fallen)
