"""Action selection of a dial, in JAX or outside: every environment has an angle of its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from socialiq.learners import replay
from socialiq.learners.collect import (
    Act,
    Behaviour,
    Collector,
    Source,
    VectorCollector,
    columns_by_run,
    stepped,
)
from socialiq.learners.dial.config import DialConfig, DialHyperparameters
from socialiq.learners.dial.objective import Networks
from socialiq.learners.dial.rows import (
    AngleRange,
    Driven,
    draw_directions,
    stratified_angles,
)
from socialiq.learners.expert_table import Batch
from socialiq.learners.state import HyperparameterArrays, Runs
from socialiq.nn.dial_network import DialNetwork
from socialiq.social.angle import exact_weights
from socialiq.types import Ending, RewardPair, Simulator


class Acting(NamedTuple):
    """Running episodes, each driven at an angle of its own; arrays lead with the environments."""

    episode: Any
    observation: Array
    direction: RewardPair


def begin(static: DialConfig, simulator: Simulator, key: Array) -> Acting:
    """Fresh episodes at angles drawn for them."""
    for_world, for_angle = jax.random.split(key)
    keys = jax.random.split(for_world, static.environments)
    episode, observation = jax.vmap(simulator.reset)(keys)
    return Acting(episode, observation, draw_directions(for_angle, static.environments, static))


def act(
    static: DialConfig,
    simulator: Simulator,
    hyperparameters: HyperparameterArrays,
    network: DialNetwork,
    ring: replay.Replay,
    now: Acting,
    key: Array,
) -> tuple[replay.Replay, Acting]:
    """One step in every environment of a simulator, stored; an episode that ends begins again."""
    for_action, for_chance, for_random, for_step, for_new = jax.random.split(key, 5)
    count = static.environments
    q = jax.vmap(network)(now.observation, now.direction)
    chosen = jax.random.categorical(for_action, q / hyperparameters.temperature)
    random = jax.random.randint(for_random, (count,), 0, q.shape[-1])
    explores = jax.random.uniform(for_chance, (count,)) < hyperparameters.exploration
    action = jnp.where(explores, random, chosen)
    follows, step = jax.vmap(simulator.advance)(
        jax.random.split(for_step, count), now.episode, action
    )
    rows: Any = Batch(now.observation, action, step.observation, step.ending, step.rewards)
    if static.driven_share:
        rows = Driven.of(rows, now.direction)
    ring = replay.add_many(ring, rows)
    ended = step.ending != int(Ending.NONE)
    going = Acting(follows, step.observation, now.direction)

    def begun(new: Array, old: Array) -> Array:
        return jnp.where(ended.reshape(-1, *[1] * (new.ndim - 1)), new, old)

    return ring, jax.tree.map(begun, begin(static, simulator, for_new), going)


class Driver:
    """Outside JAX: softmax(Q/τ) at the environment's angle, or now and then a random action.

    An environment keeps its angle for a chunk. Together the environments' angles are stratified:
    one in each of as many equal parts of the drawn angles, so every chunk sees all of them.

    Args:
        static: Of the runs.
        numbers: Of the run.
        network: Whose values it follows; None if `chosen` is given them.
        rng: Random numbers of the chunk.

    Attributes:
        direction: Of each environment; None before the first decision.
    """

    def __init__(
        self,
        static: DialConfig,
        numbers: DialHyperparameters,
        network: DialNetwork | None,
        rng: np.random.Generator,
    ) -> None:
        self._static, self._numbers, self._network, self._rng = static, numbers, network, rng
        self.direction: RewardPair | None = None

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return an action for each environment."""
        assert self._network is not None  # else the values come from outside
        direction = self.turned(len(observation))
        q = _values(self._network, jnp.asarray(observation, jnp.float32), direction)
        return self.chosen(np.asarray(q))

    def turned(self, count: int) -> RewardPair:
        """Return the directions of the environments, which are drawn once."""
        if self.direction is None:
            self.direction = stratified(self._static, count, self._rng)
        return self.direction

    def chosen(self, q: np.ndarray) -> np.ndarray:
        """Return an action for each environment, given the values of all, (env, action)."""
        rng, count = self._rng, len(q)
        chosen = (q / self._numbers.temperature + rng.gumbel(size=q.shape)).argmax(axis=1)
        random = rng.integers(q.shape[1], size=count)
        return np.where(rng.random(count) < self._numbers.exploration, random, chosen)


def acting(static: DialConfig, hyperparameters: Sequence[DialHyperparameters]) -> Behaviour:
    """Return how runs act outside JAX: each chunk with a `Driver`."""

    def behaviour(networks: Networks, run: int, _done: int, rng: np.random.Generator) -> Act:
        return Driver(static, hyperparameters[run], networks.values, rng)

    return behaviour


class DialCollector(Collector):
    """Collector of a dial: it also stores the directions if rows are learned from at theirs.

    Args:
        sources: One for each run.
        static: Of the runs.
        hyperparameters: Of each run.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        static: DialConfig,
        hyperparameters: Sequence[DialHyperparameters],
    ) -> None:
        seeds = [run.seed for run in hyperparameters]
        super().__init__(sources, seeds, acting(static, hyperparameters))
        self._static = static

    def collected(self, run: int, act: Any, rng: np.random.Generator) -> Any:
        """Return the transitions of a chunk, with their directions where these are used.

        A source lists the steps of all environments, step by step.
        """
        batch = super().collected(run, act, rng)
        if not self._static.driven_share:
            return batch
        size, direction = len(batch.action), act.direction
        rounds = -(-size // len(direction.env))
        columns = (jnp.asarray(np.tile(weight, rounds)[:size]) for weight in direction)
        return Driven.of(batch, RewardPair(*columns))


def stratified(static: AngleRange, count: int, rng: np.random.Generator) -> RewardPair:
    """Directions (cos α, sin α): α as drawn within each of `count` equal parts of the angles."""
    angles = stratified_angles(static, count, rng)
    pairs = np.array([exact_weights(angle) for angle in angles.tolist()], np.float32)
    return RewardPair(pairs[:, 0], pairs[:, 1])


@eqx.filter_jit
def _values(
    network: DialNetwork, observation: Float[Array, "env feature"], direction: RewardPair
) -> Float[Array, "env action"]:
    return jax.vmap(network)(observation, direction)


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
        static: DialConfig,
        hyperparameters: Sequence[DialHyperparameters],
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
        direction = RewardPair(*(jnp.stack(weights) for weights in zip(*directions, strict=True)))
        networks = runs.state.network.values

        def act(observation: np.ndarray) -> np.ndarray:
            by_run = observation.reshape(len(drivers), self.each, -1)
            q = np.asarray(_values_of_runs(networks, jnp.asarray(by_run, jnp.float32), direction))
            chosen = [driver.chosen(values) for driver, values in zip(drivers, q, strict=True)]
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
def _values_of_runs(
    networks: DialNetwork, observation: Float[Array, "run env feature"], direction: RewardPair
) -> Float[Array, "run env action"]:
    def of_run(network: DialNetwork, seen: Array, turned: RewardPair) -> Array:
        return jax.vmap(network)(seen, turned)

    return eqx.filter_vmap(of_run)(networks, observation, direction)
