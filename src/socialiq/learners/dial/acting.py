"""Action selection of a dial, in JAX or outside: every environment has an angle of its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from socialiq.learners import replay
from socialiq.learners.collect import Act, Behaviour
from socialiq.learners.dial.config import Hyperparameters, StaticConfig
from socialiq.learners.dial.objective import Networks
from socialiq.learners.dial.rows import draw_directions
from socialiq.learners.expert_table import Batch
from socialiq.learners.state import HyperparameterArrays
from socialiq.nn.dial_network import DialNetwork
from socialiq.social.angle import exact_weights
from socialiq.types import Ending, RewardPair, Simulator


class Acting(NamedTuple):
    """Running episodes, each driven at an angle of its own; arrays lead with the environments."""

    episode: Any
    observation: Array
    direction: RewardPair


def begin(static: StaticConfig, simulator: Simulator, key: Array) -> Acting:
    """Fresh episodes at angles drawn for them."""
    for_world, for_angle = jax.random.split(key)
    keys = jax.random.split(for_world, static.environments)
    episode, observation = jax.vmap(simulator.reset)(keys)
    return Acting(episode, observation, draw_directions(for_angle, static.environments, static))


def act(
    static: StaticConfig,
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
    ring = replay.add_many(
        ring, Batch(now.observation, action, step.observation, step.ending, step.rewards)
    )
    ended = step.ending != int(Ending.NONE)
    going = Acting(follows, step.observation, now.direction)

    def begun(new: Array, old: Array) -> Array:
        return jnp.where(ended.reshape(-1, *[1] * (new.ndim - 1)), new, old)

    return ring, jax.tree.map(begun, begin(static, simulator, for_new), going)


def acting(static: StaticConfig, hyperparameters: Sequence[Hyperparameters]) -> Behaviour:
    """Outside JAX: softmax(Q/τ) at the environment's angle, or now and then a random action.

    An environment keeps its angle for a chunk. Together the environments' angles are stratified:
    one in each of as many equal parts of the dial's range, so every chunk sees all of it.
    """

    def behaviour(networks: Networks, run: int, _done: int, rng: np.random.Generator) -> Act:
        one, directions = hyperparameters[run], dict[int, RewardPair]()

        def decide(observation: np.ndarray) -> np.ndarray:
            count = len(observation)
            if count not in directions:
                directions[count] = stratified(static, count, rng)
            q = np.asarray(
                _values(networks.values, jnp.asarray(observation, jnp.float32), directions[count])
            )
            chosen = (q / one.temperature + rng.gumbel(size=q.shape)).argmax(axis=1)
            random = rng.integers(q.shape[1], size=count)
            return np.where(rng.random(count) < one.exploration, random, chosen)

        return decide

    return behaviour


def stratified(static: StaticConfig, count: int, rng: np.random.Generator) -> RewardPair:
    """Directions (cos α, sin α), α uniform within each of `count` equal parts of the range."""
    low, high = static.low - static.margin, static.high + static.margin
    angles = low + (high - low) * (np.arange(count) + rng.random(count)) / count
    pairs = np.array([exact_weights(angle) for angle in angles.tolist()], np.float32)
    return RewardPair(pairs[:, 0], pairs[:, 1])


@eqx.filter_jit
def _values(
    network: DialNetwork, observation: Float[Array, "env feature"], direction: RewardPair
) -> Float[Array, "env action"]:
    return jax.vmap(network)(observation, direction)
