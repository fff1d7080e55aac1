"""How a dial acts in environments outside JAX: every environment at an angle of its own."""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from socialiq.learners.collect import Act, Behaviour
from socialiq.learners.dial.config import Numbers, Structure
from socialiq.nn.dial_network import DialNetwork
from socialiq.social.angle import exact_weights
from socialiq.types import RewardPair


def acting(structure: Structure, numbers: Sequence[Numbers]) -> Behaviour:
    """softmax(Q/τ) at the environment's angle, or now and then a random action.

    An environment keeps its angle for a chunk. Together the environments' angles are stratified:
    one in each of as many equal parts of the dial's range, so every chunk sees all of it.
    """

    def behaviour(network: DialNetwork, lane: int, _done: int, rng: np.random.Generator) -> Act:
        one, directions = numbers[lane], dict[int, RewardPair]()

        def act(observation: np.ndarray) -> np.ndarray:
            count = len(observation)
            if count not in directions:
                directions[count] = stratified(structure, count, rng)
            q = np.asarray(
                _values(network, jnp.asarray(observation, jnp.float32), directions[count])
            )
            chosen = (q / one.temperature + rng.gumbel(size=q.shape)).argmax(axis=1)
            random = rng.integers(q.shape[1], size=count)
            return np.where(rng.random(count) < one.exploration, random, chosen)

        return act

    return behaviour


def stratified(structure: Structure, count: int, rng: np.random.Generator) -> RewardPair:
    """Directions (cos α, sin α), α uniform within each of `count` equal parts of the range."""
    low, high = structure.low - structure.margin, structure.high + structure.margin
    angles = low + (high - low) * (np.arange(count) + rng.random(count)) / count
    pairs = np.array([exact_weights(angle) for angle in angles.tolist()], np.float32)
    return RewardPair(pairs[:, 0], pairs[:, 1])


@eqx.filter_jit
def _values(
    network: DialNetwork, observation: Float[Array, "env feature"], direction: RewardPair
) -> Float[Array, "env action"]:
    return jax.vmap(network)(observation, direction)
