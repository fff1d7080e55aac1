"""Acting of many runs at once: one batch of environments, one call of all networks for a step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from socialiq.learners.collect import VectorCollector, columns_by_run, stepped
from socialiq.learners.dial.acting import Driver
from socialiq.learners.dial.config import Hyperparameters, StaticConfig
from socialiq.learners.dial.rows import Driven
from socialiq.learners.state import Runs
from socialiq.nn.dial_network import DialNetwork
from socialiq.types import RewardPair


class DialVectorCollector(VectorCollector):
    """Collector of dials: each run acts by `Driver`, all values come from one call.

    A run's random numbers are drawn as a `DialCollector` draws them, so its experience is what it
    would collect alone, but for the rounding of Q.

    Args:
        env: As many environments for each run; as of `collect.from_vector_env`.
        rounds: Steps of each environment for a chunk.
        static: Of the runs.
        hyperparameters: Of each run.

    Raises:
        UserError: If the environments can't be divided among the runs.
    """

    def __init__(
        self,
        env: gymnasium.vector.VectorEnv[Any, Any, Any],
        rounds: int,
        static: StaticConfig,
        hyperparameters: Sequence[Hyperparameters],
    ) -> None:
        super().__init__(env, rounds, hyperparameters)
        self._static = static

    def collected(
        self,
        runs: Runs,
        done: int,  # noqa: ARG002
        streams: Sequence[np.random.Generator],
        observation: np.ndarray,
    ) -> Any:
        """Return the columns of a chunk, with the angle of each row if the replays have it."""
        drivers = [
            Driver(self._static, numbers, None, rng)
            for numbers, rng in zip(self.numbers, streams, strict=True)
        ]
        directions = [driver.turned(self.each) for driver in drivers]
        direction = RewardPair(*(jnp.stack(one) for one in zip(*directions, strict=True)))
        networks = runs.state.network.values

        def act(observation: np.ndarray) -> np.ndarray:
            seen = observation.reshape(len(drivers), self.each, -1)
            q = np.asarray(_values(networks, jnp.asarray(seen, jnp.float32), direction))
            chosen = [driver.chosen(one) for driver, one in zip(drivers, q, strict=True)]
            return np.concatenate(chosen)

        rows = list(stepped(self.env, observation, act, self.rounds))
        return self._by_run(rows, direction)

    def _by_run(self, rows: Sequence[tuple[np.ndarray, ...]], direction: RewardPair) -> Any:
        """Return the columns of a chunk, (run, step), of each run in the order of the steps."""
        batch = columns_by_run(rows, len(self.numbers))
        if not self._static.driven_share:
            return batch
        return Driven.of(batch, jax.tree.map(lambda one: jnp.tile(one, (1, len(rows))), direction))


@eqx.filter_jit
def _values(
    networks: DialNetwork, observation: Float[Array, "run env feature"], direction: RewardPair
) -> Float[Array, "run env action"]:
    def of_run(network: DialNetwork, seen: Array, turned: RewardPair) -> Array:
        return jax.vmap(network)(seen, turned)

    return eqx.filter_vmap(of_run)(networks, observation, direction)
