"""Acting of many runs with continuous actions at once, in one batch of environments."""

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
from socialiq.learners.dial.acting import stratified
from socialiq.learners.state import Runs
from socialiq.nn.actor import Actor
from socialiq.nn.dial_policy import angle_columns
from socialiq.social.angle import exact_weights
from socialiq.types import RewardPair


class ActorVectorCollector(VectorCollector):
    """Collector of actors: all actions come from one call, each run's with noise of its own.

    A run's experience is what it would collect alone, but for the rounding of the actor. A dial's
    environments keep an angle for a chunk; together they are stratified.

    Args:
        env: As many environments for each run, with actions in [-1, 1]; as of
            `collect.from_vector_env`.
        rounds: Steps of each environment for a chunk.
        static: Of the runs; `updates_per_round` has to be the `chunk` of `train`.
        hyperparameters: Of each run.

    Raises:
        UserError: If the environments can't be divided among the runs.
    """

    def __init__(
        self,
        env: gymnasium.vector.VectorEnv[Any, Any, Any],
        rounds: int,
        static: Any,
        hyperparameters: Sequence[Any],
    ) -> None:
        super().__init__(env, rounds, hyperparameters)
        self._static = static

    def collected(
        self,
        runs: Runs,
        done: int,
        streams: Sequence[np.random.Generator],
        observation: np.ndarray,
    ) -> Any:
        """Return the columns of a chunk."""
        angles = [self._direction(one, rng) for one, rng in zip(self.numbers, streams, strict=True)]
        direction = RewardPair(*(jnp.stack(side) for side in zip(*angles, strict=True)))
        taken = done * self._static.env_steps_per_update
        act = self._act(runs.state.network.actor, direction, streams, taken)
        rows = list(stepped(self.env, observation, act, self.rounds))
        return columns_by_run(rows, len(self.numbers), continuous=True)

    def _direction(self, numbers: Any, rng: np.random.Generator) -> RewardPair:
        """Return (cos α, sin α) of each environment of a run."""
        if self._static.dial:
            return stratified(self._static, self.each, rng)
        pair = exact_weights(numbers.angle)
        return RewardPair(*(np.full(self.each, one, np.float32) for one in pair))

    def _act(
        self,
        actor: Actor,
        direction: RewardPair,
        streams: Sequence[np.random.Generator],
        taken: int,
    ) -> Any:
        """Return the action selection of a chunk: uniform actions at first, then drawn ones."""
        shape, dial = (self.each, actor.size), self._static.dial

        def act(observation: np.ndarray) -> np.ndarray:
            nonlocal taken
            uniform = taken < self._static.random_steps
            taken += self.each
            if uniform:
                drawn = np.stack([rng.uniform(-1.0, 1.0, shape) for rng in streams])
                return drawn.astype(np.float32).reshape(-1, actor.size)
            noise = np.stack([rng.standard_normal(shape, np.float32) for rng in streams])
            seen = jnp.asarray(observation.reshape(len(streams), self.each, -1), jnp.float32)
            chosen = _drawn(actor, seen, direction, noise, dial)
            return np.asarray(chosen).reshape(-1, actor.size)

        return act


@eqx.filter_jit
def _drawn(
    actors: Actor,
    observation: Float[Array, "run env feature"],
    direction: RewardPair,
    noise: Any,
    dial: bool,
) -> Float[Array, "run env size"]:
    """Return tanh(mean + deviation · noise) of each run's actor."""
    seen = observation
    if dial:
        seen = jnp.concatenate([seen, *angle_columns(direction, ())], axis=-1)

    def of_run(actor: Actor, inputs: Array, draws: Array) -> Array:
        mean, log_std = jax.vmap(actor)(inputs)
        return jnp.tanh(mean + jnp.exp(log_std) * draws)

    return eqx.filter_vmap(of_run)(actors, seen, noise)
