"""Cross-fitted regression by a small network (Chernozhukov et al. 2018).

Each row is predicted by a network that was not trained on its group. As a baseline, a fit to a
row's own noise would otherwise subtract that noise from the row.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Int

from socialiq.errors import UserError
from socialiq.nn.q_network import QNetwork

FOLDS = 5
HIDDEN = (64, 64)
STEPS = 3000
BATCH = 128
LEARNING_RATE = 1e-3  # initial value; it decreases linearly to 0


def cross_fitted(
    observation: Float[np.ndarray, "row feature"],
    target: Float[np.ndarray, "row output"],
    group: Int[np.ndarray, " row"],
    seed: int = 0,
    steps: int = STEPS,
) -> Float[np.ndarray, "row output"]:
    """Return the mean target given the observation, from networks trained on other groups.

    Groups are divided into at most `FOLDS` folds. For each fold a network is fitted by least
    squares to the rows outside the fold, all in one program.

    Args:
        observation: Inputs of each row.
        target: Outputs to predict, of each row.
        group: Number of the group of each row, from 0 without gaps, such as its episode; rows of
            one group share noise.
        seed: Seed of the folds, the batches and the networks.
        steps: Gradient steps of each network.

    Returns:
        The prediction of each row, in the units of the target.

    Raises:
        UserError: If there is one group only.
    """
    n_groups = int(group.max()) + 1
    if n_groups < 2:
        raise UserError("values can't be fitted to one episode: pass two or more")
    rng = np.random.default_rng(seed)
    folds = min(FOLDS, n_groups)
    fold = (rng.permutation(n_groups) % folds)[group]
    mean = target.mean(axis=0)
    spread = np.maximum(target.std(axis=0), 1e-9)
    # Drawn here, because random numbers inside the program dominate its compile time.
    batches = [rng.choice(np.flatnonzero(fold != k), (steps, BATCH)) for k in range(folds)]
    networks = [
        QNetwork.initialise(key, observation.shape[1], HIDDEN, target.shape[1])
        for key in jax.random.split(jax.random.key(seed), folds)
    ]
    predictions = _fit_all(
        jax.tree.map(lambda *leaves: jnp.stack(leaves), *networks),
        jnp.asarray(np.stack(batches), jnp.int32),
        jnp.asarray(observation, jnp.float32),
        jnp.asarray((target - mean) / spread, jnp.float32),
    )
    return np.asarray(predictions, np.float64)[fold, np.arange(len(fold))] * spread + mean


@jax.jit
def _fit_all(
    networks: QNetwork,
    batches: Int[Array, "fold step batch"],
    observation: Float[Array, "row feature"],
    target: Float[Array, "row output"],
) -> Float[Array, "fold row output"]:
    """Fit each fold's network with one step per batch of rows; return its predictions of all."""
    adam = optax.scale_by_adam()
    steps = batches.shape[1]
    rates = LEARNING_RATE * (1.0 - jnp.arange(steps) / steps)

    def loss(fitted: QNetwork, rows: Int[Array, " batch"]) -> Float[Array, ""]:
        return jnp.mean(jnp.square(jax.vmap(fitted)(observation[rows]) - target[rows]))

    def step(state: tuple[QNetwork, Any], now: tuple[Array, Array]) -> tuple[Any, None]:
        fitted, memory = state
        rows, rate = now
        direction, memory = adam.update(jax.grad(loss)(fitted, rows), memory)
        fitted = jax.tree.map(lambda weight, slope: weight - rate * slope, fitted, direction)
        return (fitted, memory), None

    def fit(network: QNetwork, batches: Int[Array, "step batch"]) -> Float[Array, "row output"]:
        start = (network, adam.init(eqx.filter(network, eqx.is_array)))
        (fitted, _), _ = jax.lax.scan(step, start, (batches, rates))
        return jax.vmap(fitted)(observation)

    return jax.vmap(fit)(networks, batches)
