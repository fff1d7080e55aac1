"""Finite-horizon optimisation and evaluation, undiscounted (thesis 5.1, 5.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from socialiq.errors import UserError
from socialiq.mdp.solve import best_action, check_temperature, soft_value
from socialiq.mdp.tabular import StateActionArray, TabularMDP, check_policy, check_reward
from socialiq.types import Ending, RewardPair


@dataclass(frozen=True, eq=False)
class HorizonPolicy:
    """Time-dependent optimal policy."""

    actions: Int[np.ndarray, "time state"]  # action at each time and state
    # largest expected sum of rewards from each time and state to the episode's end
    values: Float[np.ndarray, "time state"]
    value: float  # largest expected sum from the initial distribution at time 0

    def probabilities(self, n_actions: int) -> Float[np.ndarray, "time state action"]:
        """Return the policy as one-hot action probabilities, for `horizon_evaluation`."""
        return np.eye(n_actions)[self.actions]


@dataclass(frozen=True, eq=False)
class HorizonEvaluation:
    """Expected results of a policy in one episode."""

    totals: RewardPair  # expected undiscounted sums of r_env and r_social (thesis 5.4)
    length: float  # expected number of steps
    # probability of each `Ending`; TIMEOUT is that of reaching the horizon
    endings: Float[np.ndarray, " kinds"]
    # expected number of times that an action is taken in a state, summed over time. The sum of its
    # products with a signal of (state, action) is the signal's expected sum
    visits: StateActionArray


def horizon_optimum(
    mdp: TabularMDP,
    reward: StateActionArray,
    horizon: int,
    allowed: Bool[np.ndarray, "*time state action"] | None = None,
) -> HorizonPolicy:
    """Maximise the expected undiscounted sum of a reward, by backward induction.

    The reward is usually R(α) of Eq 4.3. Of tied actions (`solve.greedy_policy`) the first is
    taken. `allowed` restricts the actions by state or by time and state; a state that allows none
    allows all, an optimistic assumption.

    Raises:
        UserError: If the reward or the horizon is invalid.
    """
    check_reward(mdp, reward)
    _check_horizon(horizon)
    shape = (horizon, mdp.n_states, mdp.n_actions)
    if allowed is not None and allowed.shape not in (shape, shape[1:]):
        raise UserError(f"allowed has shape {allowed.shape}: give {shape[1:]}, or {shape} by time")
    barred = allowed is not None and ~allowed & allowed.any(axis=-1, keepdims=True)
    barred = np.broadcast_to(barred, shape)
    actions = np.zeros((horizon, mdp.n_states), np.int64)
    values = np.zeros((horizon, mdp.n_states))
    after = np.zeros(mdp.n_states)
    for time in reversed(range(horizon)):
        q = np.where(barred[time], -np.inf, reward + mdp.expected_next(after))
        actions[time] = best_action(q)
        # The maximum and not the tied action's value, so that tolerances don't add up over time.
        after = values[time] = q.max(axis=1)
    return HorizonPolicy(actions, values, float(mdp.initial @ after))


@dataclass(frozen=True, eq=False)
class SoftHorizonPolicy:
    """Time-dependent optimal policy with an entropy bonus."""

    # probability of each action at each time and state
    probabilities: Float[np.ndarray, "time state action"]
    value: float  # expected sum of rewards and entropy bonus from the initial distribution


def soft_horizon_optimum(
    mdp: TabularMDP, reward: StateActionArray, horizon: int, temperature: float
) -> SoftHorizonPolicy:
    """Maximise the expected undiscounted sum of a reward and τ times the policy's entropy (Eq 2.5).

    Raises:
        UserError: If the reward, the horizon or the temperature is invalid.
    """
    check_reward(mdp, reward)
    check_temperature(temperature)
    _check_horizon(horizon)
    probabilities = np.empty((horizon, mdp.n_states, mdp.n_actions))
    after = np.zeros(mdp.n_states)
    for time in reversed(range(horizon)):
        q = reward + mdp.expected_next(after)
        after = soft_value(q, temperature)
        probabilities[time] = np.exp((q - after[:, None]) / temperature)
    return SoftHorizonPolicy(probabilities, float(mdp.initial @ after))


def horizon_evaluation(
    mdp: TabularMDP, policy: Float[np.ndarray, "*time state action"], horizon: int
) -> HorizonEvaluation:
    """Evaluate a policy exactly, by forward propagation of the distribution of states.

    A time-dependent policy has `horizon` times, the largest number of steps of an episode.

    Raises:
        UserError: If the policy or the horizon is invalid.
    """
    _check_horizon(horizon)
    check_policy(mdp, policy)
    if policy.ndim == 3 and len(policy) != horizon:
        raise UserError(f"the policy has {len(policy)} times: give one per step of {horizon}")
    if policy.ndim > 3:
        raise UserError("a policy is (state, action) or (time, state, action), no more axes")
    visits = np.zeros((mdp.n_states, mdp.n_actions))
    running = mdp.initial
    for time in range(horizon):
        mass = running[:, None] * (policy[time] if policy.ndim == 3 else policy)
        visits += mass
        running = mdp.arrivals(mass)
    endings = np.einsum("sa,sak->k", visits, mdp.ending_probability)
    # So far the two entries hold the continuing steps and 0, as no outcome is a timeout.
    endings[Ending.NONE] = 0.0
    endings[Ending.TIMEOUT] = running.sum()
    totals = RewardPair(*(float((visits * reward).sum()) for reward in mdp.rewards))
    return HorizonEvaluation(totals, float(visits.sum()), endings, visits)


def _check_horizon(horizon: int) -> None:
    if horizon < 1:
        raise UserError(f"horizon {horizon} is not a number of steps: give 1 or more")
