"""Action selection of runs outside JAX, of each kind of learner, for `learners.collect`."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from socialiq.learners.collect import Behaviour, Collector, Together, from_env
from socialiq.learners.continuous.config import ActorConfig
from socialiq.learners.dial.config import DialConfig, DialHyperparameters
from socialiq.learners.dial.rows import stratified
from socialiq.nn.actor import Actor
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.q_network import ValueNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.view import angle_columns
from socialiq.social.angle import exact_weights
from socialiq.types import Act, RewardPair

STEPS_PER_ANGLE = 100
"""Steps that a dial of continuous actions takes at an angle before the next is drawn."""


def acting_in(
    make: Callable[[], gymnasium.Env[Any, Any]],
    static: Any,
    hyperparameters: Sequence[Any],
    chunk: int = 500,
) -> Collector:
    """Let runs act in a Gymnasium environment.

    Args:
        make: Makes the environment, for each run: with discrete actions, or for a learner of
            continuous ones with actions in [-1, 1].
        static: Config of all runs; `env_steps_per_update` is how much they act. A dial takes a step
            in each of its `environments`.
        hyperparameters: Numbers of each run, among them its `seed`.
        chunk: Updates between two rounds of acting, the `chunk` of `train`.

    Returns:
        The `before_chunk` of `train`.

    Raises:
        UserError: If the environment's actions don't fit the learner.
    """
    seeds = [run.seed for run in hyperparameters]
    if isinstance(static, DialConfig):
        count = static.environments
        sources = [from_env([make() for _ in range(count)], chunk * count) for _ in seeds]
        return Collector(sources, seeds, dials(static, hyperparameters), static.driven_share > 0)
    steps_per_update = static.env_steps_per_update
    steps = chunk * steps_per_update
    continuous = isinstance(static, ActorConfig)
    sources = [from_env(make(), steps, continuous) for _ in hyperparameters]
    if continuous:
        behaviour = drawing(static, steps_per_update)
    else:
        behaviour = soft([run.temperature for run in hyperparameters])
    return Collector(sources, seeds, behaviour)


def soft(temperatures: Sequence[float]) -> Behaviour:
    """Act by softmax(Q/τ), with each run's τ."""

    def behaviour(network: ValueNetwork, run: int, _done: int, rng: np.random.Generator) -> Act:
        policy = QPolicy.of(network, temperatures[run], {}, rng)
        return lambda observation: policy.predict(observation, deterministic=False)[0]

    return behaviour


class Driver:
    """Action selection of a dial: softmax(Q/τ) at the environment's angle, or a random action.

    An environment keeps its angle, `direction`, for a chunk. Together the angles are stratified:
    one in each of as many equal parts of the drawn angles, so every chunk sees all of them. Without
    a network `chosen` is given the values.
    """

    def __init__(
        self,
        static: DialConfig,
        numbers: DialHyperparameters,
        network: DialNetwork | None,
        rng: np.random.Generator,
    ) -> None:
        self._static = static
        self._numbers = numbers
        self._network = network
        self._rng = rng
        self.direction: RewardPair | None = None

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return an action for each environment."""
        direction = self.turned(len(observation))
        return self.chosen(_values(self._network, _on_device(observation), direction))

    def turned(self, count: int) -> RewardPair:
        """Return the directions of the environments, which are drawn once."""
        if self.direction is None:
            self.direction = stratified(self._static, count, self._rng)
        return self.direction

    def chosen(self, values: Any) -> np.ndarray:
        """Return an action for each environment, given the values of all, (env, action)."""
        q = np.asarray(values)
        rng = self._rng
        chosen = (q / self._numbers.temperature + rng.gumbel(size=q.shape)).argmax(axis=1)
        random = rng.integers(q.shape[1], size=len(q))
        return np.where(rng.random(len(q)) < self._numbers.exploration, random, chosen)


def dials(static: DialConfig, hyperparameters: Sequence[DialHyperparameters]) -> Behaviour:
    """Return how dials act: each chunk with a `Driver`.

    Args:
        static: Config of all runs.
        hyperparameters: Numbers of each run.

    Returns:
        The behaviour of single runs, for a `Collector`.
    """

    def behaviour(network: Any, run: int, _done: int, rng: np.random.Generator) -> Act:
        return Driver(static, hyperparameters[run], network, rng)

    return behaviour


def dials_together(static: DialConfig, hyperparameters: Sequence[DialHyperparameters]) -> Together:
    """Return how dials act in one vector environment: as each by `dials`.

    Args:
        static: Config of all runs.
        hyperparameters: Numbers of each run.

    Returns:
        The behaviour of all runs, for a `VectorCollector`; it returns directions too if the replays
        store them (`driven_share`).
    """

    def behaviour(
        networks: Any, _done: int, streams: Sequence[np.random.Generator], per_run: int
    ) -> tuple[Act, RewardPair | None]:
        pairs = zip(hyperparameters, streams, strict=True)
        drivers = [Driver(static, numbers, None, rng) for numbers, rng in pairs]
        direction = _stacked([driver.turned(per_run) for driver in drivers])

        def act(observation: np.ndarray) -> np.ndarray:
            by_run = _on_device(observation.reshape(len(drivers), per_run, -1))
            q = np.asarray(_values_of_runs(networks, by_run, direction))
            chosen = [driver.chosen(values) for driver, values in zip(drivers, q, strict=True)]
            return np.concatenate(chosen)

        return act, direction if static.driven_share else None

    return behaviour


def drawing(static: ActorConfig, steps_per_update: int) -> Behaviour:
    """Return how actors act: uniformly at first, then with drawn actions.

    A dial takes `STEPS_PER_ANGLE` steps at each drawn angle.

    Args:
        static: Config of all runs; its first `random_steps` are uniform.
        steps_per_update: Environment steps of a run for each update.

    Returns:
        The behaviour of single runs, for a `Collector`.
    """

    def behaviour(network: Any, _run: int, done: int, rng: np.random.Generator) -> Act:
        actor = network.actor
        taken = done * steps_per_update
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


def actors_together(static: Any, hyperparameters: Sequence[Any]) -> Together:
    """Return how actors act in one vector environment, with separate noise for each run.

    A dial's environments keep an angle for a chunk; together they are stratified.

    Args:
        static: Config of all runs. Its `updates_per_round` has to be the `chunk` of `train`.
        hyperparameters: Numbers of each run.

    Returns:
        The behaviour of all runs, for a `VectorCollector`; it never returns directions.
    """

    def behaviour(
        networks: Any, done: int, streams: Sequence[np.random.Generator], per_run: int
    ) -> tuple[Act, None]:
        actors = networks.actor
        taken = done * static.env_steps_per_update
        shape = (per_run, actors.size)

        def direction(numbers: Any, rng: np.random.Generator) -> RewardPair:
            if static.dial:
                return stratified(static, per_run, rng)
            pair = exact_weights(numbers.angle)
            return RewardPair(*(np.full(per_run, weight, np.float32) for weight in pair))

        pairs = zip(hyperparameters, streams, strict=True)
        directions = _stacked([direction(numbers, rng) for numbers, rng in pairs])

        def act(observation: np.ndarray) -> np.ndarray:
            nonlocal taken
            uniform = taken < static.random_steps
            taken += per_run
            if uniform:
                actions = np.stack([rng.uniform(-1.0, 1.0, shape) for rng in streams])
                return actions.astype(np.float32).reshape(-1, actors.size)
            noise = np.stack([rng.standard_normal(shape, np.float32) for rng in streams])
            inputs = _on_device(observation.reshape(len(streams), per_run, -1))
            chosen = _drawn(actors, inputs, directions if static.dial else None, noise)
            return np.asarray(chosen).reshape(-1, actors.size)

        return act, None

    return behaviour


def _stacked(directions: Sequence[RewardPair]) -> RewardPair:
    """Return the directions of all runs, (run, env)."""
    return RewardPair(*(jnp.stack(weights) for weights in zip(*directions, strict=True)))


def _on_device(observation: np.ndarray) -> Array:
    return jnp.asarray(observation, jnp.float32)


@eqx.filter_jit
def _values(network: Any, observation: Array, direction: RewardPair) -> Float[Array, "env action"]:
    return jax.vmap(network)(observation, direction)


@eqx.filter_jit
def _values_of_runs(
    networks: Any, observation: Array, direction: RewardPair
) -> Float[Array, "run env action"]:
    def of_run(network: DialNetwork, inputs: Array, turned: RewardPair) -> Array:
        return jax.vmap(network)(inputs, turned)

    return eqx.filter_vmap(of_run)(networks, observation, direction)


@eqx.filter_jit
def _drawn(
    actors: Any, observation: Array, direction: RewardPair | None, noise: Any
) -> Float[Array, "run env size"]:
    """Return tanh(mean + deviation · noise) of each run's actor."""
    inputs = observation
    if direction is not None:
        inputs = jnp.concatenate([inputs, *angle_columns(direction, ())], axis=-1)

    def of_run(actor: Actor, inputs: Array, draws: Array) -> Array:
        mean, log_std = jax.vmap(actor)(inputs)
        return jnp.tanh(mean + jnp.exp(log_std) * draws)

    return eqx.filter_vmap(of_run)(actors, inputs, noise)
