"""Acting with continuous actions: in a compiled world, or in an environment outside JAX."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners import replay
from socialiq.learners.collect import Act, Behaviour, VectorCollector, columns_by_run, stepped
from socialiq.learners.dial.acting import stratified
from socialiq.learners.dial.rows import draw_directions
from socialiq.learners.expert_table import Batch
from socialiq.learners.state import HyperparameterArrays, Runs
from socialiq.nn.actor import Actor
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.nn.dial_policy import angle_columns
from socialiq.social.angle import exact_weights
from socialiq.types import ContinuousSimulator, Ending, RewardPair

STEPS_PER_ANGLE = 100
"""Steps outside JAX that a dial takes at an angle before the next is drawn."""


class Acting(NamedTuple):
    """Place of a learner in a compiled world.

    Attributes:
        episode: State of the world.
        observation: Of that state.
        direction: (cos α, sin α) at which it acts in this episode.
    """

    episode: Any
    observation: Float[Array, " feature"]
    direction: RewardPair


def begin(
    simulator: ContinuousSimulator,
    static: Any,
    hyperparameters: HyperparameterArrays,
    key: PRNGKeyArray,
) -> Acting:
    """Start an episode, of a dial at a drawn angle."""
    for_world, for_angle = jax.random.split(key)
    direction = hyperparameters.weights
    if static.dial:
        direction = jax.tree.map(jnp.squeeze, draw_directions(for_angle, 1, static))
    return Acting(*simulator.reset(for_world), direction)


def act(
    simulator: ContinuousSimulator,
    static: Any,
    hyperparameters: HyperparameterArrays,
    actor: Actor,
    ring: replay.Replay,
    now: Acting,
    key: PRNGKeyArray,
) -> tuple[replay.Replay, Acting]:
    """Take steps in the world with drawn actions, the first of a run uniform, into the replay."""
    for step_key in jax.random.split(key, static.env_steps_per_update):
        for_action, for_random, for_step, for_reset = jax.random.split(step_key, 4)
        inputs = now.observation
        if static.dial:
            inputs = jnp.concatenate([inputs, *angle_columns(now.direction, ())])
        mean, log_std = actor(inputs)
        sampled = jnp.tanh(mean + jnp.exp(log_std) * jax.random.normal(for_action, mean.shape))
        uniform = jax.random.uniform(for_random, mean.shape, minval=-1.0, maxval=1.0)
        action = jnp.where(ring.added < static.random_steps, uniform, sampled)
        follows, step = simulator.advance(for_step, now.episode, action)
        row = Batch(now.observation, action, step.observation, step.ending, step.rewards)
        ring = replay.add(ring, row)
        ended = step.ending != int(Ending.NONE)
        fresh = begin(simulator, static, hyperparameters, for_reset)
        going = Acting(follows, step.observation, now.direction)
        now = jax.tree.map(lambda new, old, ended=ended: jnp.where(ended, new, old), fresh, going)
    return ring, now


def drawing(static: Any, steps_per_update: int) -> Behaviour:
    """Return how runs act outside JAX: uniformly at first, then with drawn actions.

    A dial takes `STEPS_PER_ANGLE` steps at each drawn angle.

    Args:
        static: Of the runs.
        steps_per_update: Steps in the environment for each update.
    """

    def behaviour(network: Any, run: int, done: int, rng: np.random.Generator) -> Act:  # noqa: ARG001
        actor, taken = network.actor, done * steps_per_update
        policy = ActorPolicy.of(actor, {}, rng)
        driver = None if static.dial else policy

        def act(observation: np.ndarray) -> np.ndarray:
            nonlocal taken, driver
            if static.dial and (driver is None or taken % STEPS_PER_ANGLE == 0):
                angle = rng.uniform(static.low, static.high)
                turned = ActorDial(policy, static.low, static.high).at(angle)
                driver = dataclasses.replace(turned, rng=rng)
            taken += len(observation)
            if taken <= static.random_steps:
                return rng.uniform(-1.0, 1.0, (len(observation), actor.size))
            assert driver is not None
            return driver.predict(observation, deterministic=False)[0]

        return act

    return behaviour


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
        angles = [
            self._direction(numbers, rng)
            for numbers, rng in zip(self.numbers, streams, strict=True)
        ]
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
        return RewardPair(*(np.full(self.each, weight, np.float32) for weight in pair))

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
                actions = np.stack([rng.uniform(-1.0, 1.0, shape) for rng in streams])
                return actions.astype(np.float32).reshape(-1, actor.size)
            noise = np.stack([rng.standard_normal(shape, np.float32) for rng in streams])
            inputs = jnp.asarray(observation.reshape(len(streams), self.each, -1), jnp.float32)
            chosen = _drawn(actor, inputs, direction, noise, dial)
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
    inputs = observation
    if dial:
        inputs = jnp.concatenate([inputs, *angle_columns(direction, ())], axis=-1)

    def of_run(actor: Actor, inputs: Array, draws: Array) -> Array:
        mean, log_std = jax.vmap(actor)(inputs)
        return jnp.tanh(mean + jnp.exp(log_std) * draws)

    return eqx.filter_vmap(of_run)(actors, inputs, noise)
