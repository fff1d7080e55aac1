"""Logged episodes beside the policy to be evaluated, and importance sampling over them.

An episode is weighed by how much more probable its actions are for the policy than for the mixture
of demonstrators that it was drawn from:

    ρ_t = Π_{k <= t} π(a_k|s_k) / Σ_m p_m Π_{k <= t} π_m(a_k|s_k)

with p_m the share of episodes of mode m (the balance heuristic of Veach and Guibas 1995, for
policies Agarwal et al. 2017). The world's own chances cancel. Both estimates are self-normalised:

    whole episodes   Σ_i ρ_T G / Σ_i ρ_T
    step by step     Σ_t Σ_i ρ_t r_t / Σ_i ρ_t       (Precup, Sutton and Singh 2000; Thomas 2015)

Episodes of a mode are taken for draws of one policy of the observation. Probabilities that are
estimated from the same episodes give importance weights less variance than the true ones would
(Hanna, Niekum and Stone 2019).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners.behaviour_cloning import (
    BehaviourCloning,
    CloningConfig,
    CloningHyperparameters,
)

Chances = Callable[[np.ndarray], np.ndarray]
"""Probabilities of a policy's actions, (state, action), for observations (state, feature)."""


@dataclass(frozen=True, eq=False)
class Logged:
    """Whole episodes, their distinct observations numbered.

    Attributes:
        data: The episodes.
        observations: Every distinct observation.
        state: Number of each row's observation.
        next_state: Number of each row's next observation.
        horizon: Steps of the longest episode: the time limit, if one was cut.
    """

    data: Demonstrations
    observations: Float[np.ndarray, "state feature"]
    state: Int[np.ndarray, " transition"]
    next_state: Int[np.ndarray, " transition"]
    horizon: int

    @staticmethod
    def of(data: Demonstrations) -> Logged:
        """Number the observations.

        Raises:
            UserError: If steps of an episode are missing, or there is one episode only.
        """
        data.totals()  # refuses episodes with gaps
        if data.n_episodes < 2:
            raise UserError("one episode has no interval: give two episodes or more")
        rows = np.concatenate([data.observation, data.next_observation])
        distinct, number = np.unique(rows, axis=0, return_inverse=True)
        state, next_state = np.split(number.reshape(-1), 2)
        return Logged(data, distinct, state, next_state, int(data.step.max()) + 1)

    @property
    def tabular(self) -> bool:
        """Whether observations recur often enough for tables: five times in the mean."""
        return 5 * len(np.unique(self.state)) <= len(self.state)

    @property
    def rewards(self) -> Float[np.ndarray, "transition 2"]:
        """Return r_env and r_social as columns."""
        return np.stack(self.data.rewards, axis=1)

    def chances(self, policy: Chances) -> Float[np.ndarray, "state action"]:
        """Return a policy's probabilities at every distinct observation.

        Raises:
            UserError: If the policy is not one of the data's actions.
        """
        chances = np.asarray(policy(self.observations), np.float64)
        if chances.shape != (len(self.observations), self.data.n_actions):
            raise UserError(
                f"the policy has {chances.shape[-1]} actions, the data {self.data.n_actions}: "
                "give data of the world it was trained for"
            )
        return chances

    def by_step(self, values: np.ndarray, fill: float) -> np.ndarray:
        """Return values of rows as (episode, step, ...), filled beyond an episode's end."""
        shape = (self.data.n_episodes, self.horizon, *values.shape[1:])
        filled = np.full(shape, fill, np.float64)
        filled[self.data.episode, self.data.step] = values
        return filled


def shown_modes(logged: Logged) -> list[int]:
    """Return the modes that have episodes."""
    return np.unique(logged.data.episode_modes).tolist()


def by_counts(logged: Logged) -> Float[np.ndarray, "mode state action"]:
    """Return the share with which each mode took each action in each distinct observation.

    0 where a mode never was.
    """
    data, shares = logged.data, []
    shape = (len(logged.observations), data.n_actions)
    for mode in shown_modes(logged):
        rows, counts = data.mode == mode, np.zeros(shape)
        np.add.at(counts, (logged.state[rows], data.action[rows]), 1.0)
        shares.append(counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0))
    return np.array(shares)


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
    static = CloningConfig(hidden=(64, 64), updates=updates, batch_size=128, view=view)
    runs = [
        CloningHyperparameters(learning_rate=1e-3, seed=seed + number, dataset=number)
        for number in range(len(sets))
    ]
    trained = BehaviourCloning.train_on(static, runs, sets)
    return np.array(
        [trained.policy(run).probabilities(logged.observations) for run in range(len(sets))]
    )


def ratios(
    logged: Logged,
    chances: Float[np.ndarray, "state action"],
    behaviour: Float[np.ndarray, "mode state action"],
    shares: Float[np.ndarray, " mode"],
) -> Float[np.ndarray, "episode step"]:
    """Return ρ of each episode up to each step; beyond its end the last one.

    Args:
        logged: The episodes.
        chances: The policy's probabilities at each distinct observation.
        behaviour: Each demonstrator's probabilities at each distinct observation.
        shares: p_m, which sum to 1.
    """
    state, action = logged.state, logged.data.action
    taken = chances[state, action]
    with np.errstate(divide="ignore"):
        target = np.cumsum(np.log(logged.by_step(taken, 1.0)), axis=1)
        driven = np.stack(
            [
                np.cumsum(np.log(logged.by_step(chance, 1.0)), axis=1)
                for chance in behaviour[:, state, action]
            ]
        )
        mixed = np.logaddexp.reduce(driven + np.log(shares)[:, None, None], axis=0)
        # An episode has a probability under its own demonstrator, so `mixed` is finite.
        return np.exp(target - mixed)


def whole_episodes(
    ratio: Float[np.ndarray, "episode step"],
    rewards: Float[np.ndarray, "episode step signal"],
    counts: Float[np.ndarray, "resample episode"],
) -> Float[np.ndarray, "resample signal"]:
    """Return the self-normalised estimate by whole episodes; NaN without any weight.

    Args:
        ratio: ρ by episode and step.
        rewards: Rewards by episode and step, 0 beyond an end.
        counts: How often each episode is in each resample.
    """
    weight = counts * ratio[:, -1]
    with np.errstate(invalid="ignore"):
        return weight @ rewards.sum(axis=1) / weight.sum(axis=1, keepdims=True)


def step_by_step(
    ratio: Float[np.ndarray, "episode step"],
    rewards: Float[np.ndarray, "episode step signal"],
    counts: Float[np.ndarray, "resample episode"],
) -> Float[np.ndarray, "resample signal"]:
    """Return the self-normalised per-decision estimate; NaN without any weight.

    Args:
        ratio: ρ by episode and step.
        rewards: Rewards by episode and step, 0 beyond an end.
        counts: How often each episode is in each resample.
    """
    weighed = np.einsum("re,et,ets->rts", counts, ratio, rewards, optimize=True)
    with np.errstate(invalid="ignore"):
        return (weighed / (counts @ ratio)[:, :, None]).sum(axis=1)


def effective_episodes(ratio: Float[np.ndarray, "episode step"]) -> float:
    """Return (Σ ρ)² / Σ ρ²: how many episodes of the policy itself the weights are worth."""
    weight = ratio[:, -1]
    squares = float(np.square(weight).sum())
    return float(weight.sum()) ** 2 / squares if squares else 0.0
