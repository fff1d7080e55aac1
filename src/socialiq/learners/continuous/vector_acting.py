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

from socialiq.errors import UserError
from socialiq.learners import replay
from socialiq.learners.collect import columns_by_run, stepped
from socialiq.learners.dial.acting import stratified
from socialiq.learners.state import Runs
from socialiq.nn.actor import Actor
from socialiq.nn.dial_network import angle_columns
from socialiq.social.angle import exact_weights
from socialiq.types import RewardPair


class VectorCollector:
    """Fills the replays of all runs from one vector environment: the `before_chunk` of `train`.

    The environments of a run are next to each other. Each run has random numbers of its own, so its
    experience is what it would collect alone, but for the rounding of the actor. Every chunk begins
    with a reset that is seeded by the run and the updates done. A dial's environments keep an angle
    for a chunk; together they are stratified.

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
        if env.num_envs % len(hyperparameters):
            raise UserError(
                f"{env.num_envs} environments can't be divided among {len(hyperparameters)} runs"
            )
        self._env, self._rounds = env, rounds
        self._static, self._numbers = static, tuple(hyperparameters)
        self._each = env.num_envs // len(hyperparameters)
        self._add = jax.jit(jax.vmap(replay.add_many), donate_argnums=0)

    def __call__(self, runs: Runs, done: int) -> Runs:
        """Let every run act with its present actor, and store what happens."""
        streams = [
            np.random.default_rng(np.random.SeedSequence([one.seed, done])) for one in self._numbers
        ]
        firsts = [int(rng.integers(2**31)) for rng in streams]
        seeds: Any = [first + row for first in firsts for row in range(self._each)]
        angles = [
            self._direction(one, rng) for one, rng in zip(self._numbers, streams, strict=True)
        ]
        direction = RewardPair(*(jnp.stack(side) for side in zip(*angles, strict=True)))
        observation, _ = self._env.reset(seed=seeds)
        taken = done * self._static.env_steps_per_update
        act = self._act(runs.state.network.actor, direction, streams, taken)
        rows = list(stepped(self._env, observation, act, self._rounds))
        made = columns_by_run(rows, len(self._numbers), continuous=True)
        ring = self._add(runs.carry.replay, made)
        return runs._replace(carry=runs.carry._replace(replay=ring))

    def _direction(self, numbers: Any, rng: np.random.Generator) -> RewardPair:
        """Return (cos α, sin α) of each environment of a run."""
        if self._static.dial:
            return stratified(self._static, self._each, rng)
        pair = exact_weights(numbers.angle)
        return RewardPair(*(np.full(self._each, one, np.float32) for one in pair))

    def _act(
        self,
        actor: Actor,
        direction: RewardPair,
        streams: Sequence[np.random.Generator],
        taken: int,
    ) -> Any:
        """Return the action selection of a chunk: uniform actions at first, then drawn ones."""
        shape, dial = (self._each, actor.size), self._static.dial

        def act(observation: np.ndarray) -> np.ndarray:
            nonlocal taken
            uniform = taken < self._static.random_steps
            taken += self._each
            if uniform:
                drawn = np.stack([rng.uniform(-1.0, 1.0, shape) for rng in streams])
                return drawn.astype(np.float32).reshape(-1, actor.size)
            noise = np.stack([rng.standard_normal(shape, np.float32) for rng in streams])
            seen = jnp.asarray(observation.reshape(len(streams), self._each, -1), jnp.float32)
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
