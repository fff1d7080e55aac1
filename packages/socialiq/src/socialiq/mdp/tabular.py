"""Finite MDP as arrays: every chance outcome of every state and action, with its ending."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csc_array, csr_array

from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair

StateActionArray = Float[np.ndarray, "state action"]
StateArray = Float[np.ndarray, " state"]

# Probabilities are often decimals such as .3 + .7, or products of them.
_SUM_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class TabularMDP:
    """Finite MDP with the pair of rewards of thesis 4.1, float64.

    An outcome with an ending other than `Ending.NONE` ends the episode. Its successor has no
    effect on values. Time is not part of the MDP, so `Ending.TIMEOUT` does not occur;
    `mdp.horizon` adds a time limit.

    Raises:
        UserError: If shapes disagree, a number is not finite, an index is out of range, or
            probabilities are negative or do not sum to 1.
    """

    # index of the next state of each chance outcome
    successor: Int[np.ndarray, "state action outcome"]
    # probability of each outcome; sums to 1 for a state and action
    probability: Float[np.ndarray, "state action outcome"]
    # `Ending` of each outcome, NONE where the episode continues
    ending: Int[np.ndarray, "state action outcome"]
    rewards: RewardPair  # expected r_env and r_social, each of shape (state, action)
    initial: StateArray  # distribution of the first state

    def __post_init__(self) -> None:
        shape = np.shape(self.successor)
        if len(shape) != 3 or 0 in shape:
            raise UserError(
                f"successor has shape {shape}: give (state, action, outcome), none empty"
            )
        if not np.issubdtype(self.successor.dtype, np.integer):
            raise UserError(f"successor holds {self.successor.dtype}: give indices of states")
        for name, array in (("probability", self.probability), ("ending", self.ending)):
            if np.shape(array) != shape:
                raise UserError(f"{name} has shape {np.shape(array)}: give it successor's, {shape}")
        if np.shape(self.initial) != shape[:1]:
            raise UserError(
                f"initial has shape {np.shape(self.initial)}: give one chance per {shape[:1]}"
            )
        _check_distribution("outcome probabilities", self.probability)
        _check_distribution("initial distribution", self.initial)
        for name, reward in zip(("r_env", "r_social"), self.rewards, strict=True):
            check_reward(self, reward, name)
        if self.successor.min() < 0 or self.successor.max() >= self.n_states:
            raise UserError(f"a successor is outside the {self.n_states} states of the MDP")
        allowed = [ending for ending in Ending if ending is not Ending.TIMEOUT]
        if not np.isin(self.ending, allowed).all():
            raise UserError(
                f"endings must be among {', '.join(ending.name for ending in allowed)}: "
                "a time limit is the horizon's, not the MDP's"
            )

    @property
    def n_states(self) -> int:
        """Number of states."""
        return self.successor.shape[0]

    @property
    def n_actions(self) -> int:
        """Number of actions, the same in every state."""
        return self.successor.shape[1]

    @cached_property
    def flow(self) -> csr_array:
        """P(s', episode continues | s, a), sparse (state * action, state), action fastest."""
        shape = (self.n_states * self.n_actions, self.n_states)
        rows = np.repeat(np.arange(shape[0]), self.successor.shape[2])
        # Impossible outcomes are omitted, so that the pattern is the graph of possible transitions.
        possible = ((self.ending == Ending.NONE) & (self.probability > 0.0)).ravel()
        entries = self.probability.ravel()[possible]
        return csr_array((entries, (rows[possible], self.successor.ravel()[possible])), shape=shape)

    @cached_property
    def _flow_back(self) -> csc_array:
        return self.flow.T  # a matrix is transposed slower than it is multiplied

    @cached_property
    def ending_probability(self) -> Float[np.ndarray, "state action kind"]:
        """P(ending | s, a), indexed by `Ending`; at NONE the probability of continuing."""
        chances = [np.where(self.ending == kind, self.probability, 0.0).sum(2) for kind in Ending]
        return np.stack(chances, axis=2)

    def expected_next(self, values: StateArray) -> StateActionArray:
        """Return E[V(s') | s, a] with V(s') = 0 where the episode ends (Eq 2.5-2.7)."""
        return (self.flow @ values).reshape(self.n_states, self.n_actions)

    def arrivals(self, mass: StateActionArray) -> StateArray:
        """Return the mass that reaches each state and continues, one step after `mass`.

        The adjoint of `expected_next`: <mass, expected_next(v)> = <arrivals(mass), v>.
        """
        return self._flow_back @ mass.ravel()

    def under(self, policy: StateActionArray) -> csr_array:
        """Return P(s' and the episode continues | s) of a stationary policy: sparse (state, state).

        Raises:
            UserError: If `policy` is not a table of action probabilities of this MDP.
        """
        check_policy(self, policy)
        columns = np.arange(policy.size)
        starts = np.arange(0, policy.size + 1, self.n_actions)
        return csr_array((policy.ravel(), columns, starts)) @ self.flow

    def reachable(self) -> Bool[np.ndarray, " state"]:
        """Return the states that some policy can visit, including the possible first states.

        Successors of outcomes that end the episode do not count: no action follows them.
        """
        sources, targets = self.flow.nonzero()
        edges = (np.ones(len(targets)), (targets, sources // self.n_actions))
        return closure(csr_array(edges, shape=(self.n_states,) * 2), self.initial > 0.0)

    def reachable_part(self) -> tuple[TabularMDP, Int[np.ndarray, " part"]]:
        """Return the MDP restricted to its reachable states, and their indices in this MDP.

        Successors of outcomes that end the episode, or are impossible, are arbitrary.
        """
        states = np.flatnonzero(self.reachable())
        index = np.zeros(self.n_states, np.int64)
        index[states] = np.arange(len(states))
        restricted = TabularMDP(
            successor=index[self.successor[states]],
            probability=self.probability[states],
            ending=self.ending[states],
            rewards=RewardPair(*(reward[states] for reward in self.rewards)),
            initial=self.initial[states],
        )
        return restricted, states


def closure(edges: csr_array, start: Bool[np.ndarray, " state"]) -> Bool[np.ndarray, " state"]:
    """Return every state connected to `start` by a chain of edges, including `start`.

    The edges are sparse (state, state), not negative; a positive one at (i, j) adds i once j is in.

    Args:
        edges: Sparse (state, state), not negative. A positive one at (i, j) adds i once j is in.
        start: The states to begin with.
    """
    reached = frontier = start
    while frontier.any():
        frontier = (edges @ frontier.astype(np.float64) > 0.0) & ~reached
        reached = reached | frontier
    return reached


def check_reward(mdp: TabularMDP, reward: np.ndarray, name: str = "reward") -> None:
    """Refuse a reward that is not a finite float64 per state and action.

    Args:
        mdp: The MDP.
        reward: The reward, (state, action).
        name: Name of the reward in messages.

    Raises:
        UserError: If it has another shape or type, or a number is not finite.
    """
    shape = (mdp.n_states, mdp.n_actions)
    if np.shape(reward) != shape:
        raise UserError(f"{name} has shape {np.shape(reward)}: give one number per {shape}")
    if reward.dtype != np.float64 or not np.isfinite(reward).all():
        raise UserError(f"{name} must be finite float64 numbers")


def check_policy(mdp: TabularMDP, policy: np.ndarray) -> None:
    """Refuse a policy that is no distribution over actions.

    Args:
        mdp: The MDP.
        policy: Action probabilities, (state, action) or (time, state, action).

    Raises:
        UserError: If it has another shape or type, or a number is negative, or sums are not 1.
    """
    shape = (mdp.n_states, mdp.n_actions)
    if np.shape(policy)[-2:] != shape:
        raise UserError(f"policy has shape {np.shape(policy)}: its last two must be {shape}")
    _check_distribution("action probabilities", policy)


def check_discount(discount: float) -> None:
    """Refuse a discount outside [0, 1]."""
    if not 0.0 <= discount <= 1.0:
        raise UserError(f"discount {discount:g} is outside [0, 1]")


def _check_distribution(what: str, chances: np.ndarray) -> None:
    """Raise an error unless `chances` are distributions along the last axis."""
    if chances.dtype != np.float64 or not np.isfinite(chances).all() or chances.min() < 0.0:
        raise UserError(f"{what} must be finite float64 numbers, none negative")
    error = np.abs(chances.sum(axis=-1) - 1.0).max()
    if error > _SUM_TOLERANCE:
        raise UserError(f"{what} must sum to 1: the worst sum is {error:.3g} away")
