"""Probabilities of the logged actions for each demonstrator, estimated from the episodes.

Episodes of a mode are taken for draws of one policy of the observation. Probabilities that are
estimated from the same episodes give importance weights less variance than the true ones would
(Hanna, Niekum and Stone 2019).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from socialiq.evaluation.off_policy.logged import Logged
from socialiq.learners.behaviour_cloning import BehaviourCloning, Hyperparameters, StaticConfig


def shown_modes(logged: Logged) -> list[int]:
    """Return the modes that have episodes."""
    return np.unique(logged.data.episode_modes).tolist()


def by_counts(logged: Logged) -> Float[np.ndarray, "mode state action"]:
    """Return the share with which each mode took each action in each distinct observation.

    0 where a mode never was.
    """
    data, found = logged.data, []
    shape = (len(logged.observations), data.n_actions)
    for mode in shown_modes(logged):
        own, counts = data.mode == mode, np.zeros(shape)
        np.add.at(counts, (logged.state[own], data.action[own]), 1.0)
        found.append(counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0))
    return np.array(found)


def by_clones(
    logged: Logged, updates: int = 3000, seed: int = 0, view: str = "flat"
) -> Float[np.ndarray, "mode state action"]:
    """Return each action's probability under a clone of each mode, at each distinct observation.

    Args:
        logged: The episodes.
        updates: Updates of each clone, all in one program.
        seed: Seed of the first clone.
        view: Network's view of the observation; a name of `nn.view.CHOICES`.
    """
    modes, data = shown_modes(logged), logged.data
    sets = [data.select(np.flatnonzero(data.episode_modes == mode)) for mode in modes]
    static = StaticConfig(hidden=(64, 64), updates=updates, batch_size=128, view=view)
    runs = [
        Hyperparameters(learning_rate=1e-3, seed=seed + number, dataset=number)
        for number in range(len(sets))
    ]
    trained = BehaviourCloning.train_on(static, runs, sets)
    return np.array(
        [trained.policy(run).probabilities(logged.observations) for run in range(len(sets))]
    )
