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

from socialiq.errors import UserError
from socialiq.learners import replay
from socialiq.learners.collect import columns_by_run, stepped
from socialiq.learners.dial.acting import Driver
from socialiq.learners.dial.config import Hyperparameters, StaticConfig
from socialiq.learners.dial.rows import Driven
from socialiq.learners.state import Runs
from socialiq.nn.dial_network import DialNetwork
from socialiq.types import RewardPair


class VectorCollector:
    """Fills the replays of all runs from one vector environment: the `before_chunk` of `train`.

    The environments of a run are next to each other. Each run has random numbers of its own, drawn
    as a `DialCollector` draws them, so its experience is what it would collect alone, but for the
    rounding of Q.

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
        if env.num_envs % len(hyperparameters):
            raise UserError(
                f"{env.num_envs} environments can't be divided among {len(hyperparameters)} runs"
            )
        self._env, self._rounds = env, rounds
        self._static, self._numbers = static, tuple(hyperparameters)
        self._each = env.num_envs // len(hyperparameters)
        self._add = jax.jit(jax.vmap(replay.add_many), donate_argnums=0)

    def __call__(self, runs: Runs, done: int) -> Runs:
        """Let every run act with its present network, and store what happens."""
        drivers, seeds = self._begin(done)
        directions = [driver.turned(self._each) for driver in drivers]
        direction = RewardPair(*(jnp.stack(one) for one in zip(*directions, strict=True)))
        networks = runs.state.network.values

        def act(observation: np.ndarray) -> np.ndarray:
            seen = observation.reshape(len(drivers), self._each, -1)
            q = np.asarray(_values(networks, jnp.asarray(seen, jnp.float32), direction))
            chosen = [driver.chosen(one) for driver, one in zip(drivers, q, strict=True)]
            return np.concatenate(chosen)

        of_rows: Any = seeds  # a list, which the type of the base class does not name
        observation, _ = self._env.reset(seed=of_rows)
        rows = stepped(self._env, observation, act, self._rounds)
        made = self._by_run(list(rows), direction)
        ring = self._add(runs.carry.replay, made)
        return runs._replace(carry=runs.carry._replace(replay=ring))

    def _begin(self, done: int) -> tuple[list[Driver], list[int]]:
        """Return the driver of each run, and the seed of each environment."""
        drivers, seeds = list[Driver](), list[int]()
        for numbers in self._numbers:
            rng = np.random.default_rng(np.random.SeedSequence([numbers.seed, done]))
            first = int(rng.integers(2**31))
            seeds += range(first, first + self._each)
            drivers.append(Driver(self._static, numbers, None, rng))
        return drivers, seeds

    def _by_run(self, rows: Sequence[tuple[np.ndarray, ...]], direction: RewardPair) -> Any:
        """Return the columns of a chunk, (run, step), of each run in the order of the steps."""
        batch = columns_by_run(rows, len(self._numbers))
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
