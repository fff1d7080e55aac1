"""Shared types: reward pairs, endings of episodes, policies, simulators, transitions."""

from __future__ import annotations

import abc
import enum
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from socialiq.errors import UserError, one_of

Row = dict[str, Any]
"""Row of a table: a value by column."""

Json = Mapping[str, Any]
"""Object of JSON or TOML, for a reader that doesn't change it."""

Files = Mapping[str, bytes]
"""Content of files by path."""


class ByClass(NamedTuple):
    """Numbers by class of road user; the parts of r_social are the ego's effects on each class.

    Attributes:
        vehicle: Of drivers.
        vulnerable: Of road users who can be hurt, on foot and on bicycles.
    """

    vehicle: Any
    vulnerable: Any


class RewardPair(NamedTuple):
    """Two rewards of a transition (thesis 4.1), kept separate until they are scored.

    Either scalars or arrays of one common shape.

    Attributes:
        env: r_env, the ego's own progress (Eq 4.1).
        social: r_social, the ego's effect on its neighbours (Eq 4.2); where the weights of classes
            are chosen later, its parts `ByClass`.
    """

    env: Any
    social: Any

    @property
    def parts(self) -> tuple[Any, ...]:
        """Return r_env and r_social, or r_env and the parts of r_social by class."""
        return (self.env, *(self.social if isinstance(self.social, ByClass) else (self.social,)))

    @staticmethod
    def of_step(reward: Any, info: Mapping[str, Any]) -> RewardPair:
        """Return the pair of a Gymnasium step, `info["reward_pair"]`.

        Without it a vector reward, as MO-Gymnasium's, is the pair. A scalar reward is r_env, with
        r_social 0.

        Args:
            reward: Reward of the step, a number or a vector.
            info: Info of the step.

        Raises:
            UserError: If the pair is not two finite numbers.
        """
        if "reward_pair" not in info and np.ndim(reward):
            if np.size(reward) != 2:
                raise UserError(
                    f"a vector reward has length {np.size(reward)}, and an angle weighs two parts: "
                    "choose or add up parts in the function of a RewardPairWrapper"
                )
            return RewardPair.of(reward, "a vector reward")
        return RewardPair.of(info.get("reward_pair", (reward, 0.0)), 'info["reward_pair"]')

    @staticmethod
    def of(numbers: Any, what: str) -> RewardPair:
        """Return a pair of scalars from a sequence of two finite numbers.

        Args:
            numbers: The sequence (r_env, r_social).
            what: Name of the sequence in the error message.

        Raises:
            UserError: If it is not a sequence of two finite numbers.
        """
        try:
            pair = tuple(map(float, numbers))
        except (TypeError, ValueError):
            pair = ()
        if len(pair) != 2 or not all(map(math.isfinite, pair)):
            text = ascii(numbers)[:80]
            raise UserError(f"{what} must be two finite numbers (r_env, r_social), got {text}")
        return RewardPair(*pair)


class Ending(enum.IntEnum):
    """Kind of ending of an episode, by its last transition.

    `TIMEOUT` is a truncation by the world's time limit. The others are terminal
    states. `OTHER` is a terminal state of an environment that reports no kind; in this package's
    worlds the ego has left the road, or driven over a closed line.
    """

    NONE = 0
    ARRIVAL = 1
    COLLISION = 2
    TIMEOUT = 3
    OTHER = 4

    @staticmethod
    def of_step(terminated: bool, truncated: bool, info: Mapping[str, Any]) -> Ending:
        """Return the ending of a Gymnasium step.

        Args:
            terminated: Whether the step reached a terminal state.
            truncated: Whether the time limit ended the episode.
            info: Info of the step. `info["ending"]` names the kind of a terminal state, "other" by
                default.

        Returns:
            The kind of the terminal state, `TIMEOUT` for a truncation alone, else `NONE`.

        Raises:
            UserError: If `info["ending"]` of a terminal state is not the name of one of `TERMINAL`.
        """
        if terminated:
            name = str(info.get("ending", "other")).lower()
            one_of('info["ending"]', name, [Ending(kind).name.lower() for kind in TERMINAL])
            return Ending[name.upper()]
        return Ending.TIMEOUT if truncated else Ending.NONE


TERMINAL = (int(Ending.ARRIVAL), int(Ending.COLLISION), int(Ending.OTHER))
"""Endings in a terminal state."""


@runtime_checkable
class Policy(Protocol):
    """Protocol of a policy: `predict` as in Stable-Baselines3."""

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose actions for one observation or for a batch.

        Args:
            observation: Shape (features,) or (batch, features).
            state: Memory of the policy, as the last call returned it; None at the beginning.
            episode_start: Whether an episode begins with the observation, one value for each row;
                None if no row begins an episode.
            deterministic: Whether to take the best action; else a policy that can draw actions
                draws one.

        Returns:
            The actions, and the memory for the next call.
        """
        ...


class Memoryless(abc.ABC):
    """Base class of policies whose actions depend on the observation alone; it writes `choose`."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002  part of the protocol
        deterministic: bool = True,
    ) -> tuple[Any, Any]:
        """Choose actions, as `Policy`; the policy has no memory.

        Args:
            observation: Shape (features,) or (batch, features).
            state: Returned unchanged.
            episode_start: Ignored.
            deterministic: Whether to take the best action; else one is drawn, where a policy draws.

        Raises:
            UserError: If an observation doesn't fit a policy that checks it.
        """
        return self.choose(observation, deterministic), state

    @abc.abstractmethod
    def choose(self, observation: Any, deterministic: bool, /) -> Any:
        """Return the action for one observation, or the actions for a batch.

        Args:
            observation: Shape (features,) or (batch, features).
            deterministic: Whether to take the best action; else one is drawn, where a policy draws.
        """


class Step(NamedTuple):
    """Result of one step of a simulator, before any reset.

    Attributes:
        observation: Observation of the state reached, shape (features,), float32.
        rewards: The reward pair of the transition.
        ending: Value of `Ending`; 0 while the episode continues.
    """

    observation: Any
    rewards: RewardPair
    ending: Any


class _Stepped(Protocol):
    """Protocol of what both kinds of simulators have: pure functions of JAX arrays."""

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        ...

    @property
    def description(self) -> str:
        """Name and options of the world; worlds with equal descriptions are identical."""
        ...

    def reset(self, key: Any) -> tuple[Any, Any]:
        """Start an episode; return the episode state and the first observation."""
        ...

    def advance(self, key: Any, episode: Any, action: Any) -> tuple[Any, Step]:
        """Take one step.

        Args:
            key: Random key of JAX.
            episode: Episode state, of `reset` or of the last step.
            action: A discrete action, or continuous ones of shape (size,).

        Returns:
            The next episode state, and the result of the step.
        """
        ...


@runtime_checkable
class Simulator(_Stepped, Protocol):
    """Protocol of a world that compiled programs can step."""

    @property
    def n_actions(self) -> int:
        """Number of discrete actions."""
        ...


@runtime_checkable
class ContinuousSimulator(_Stepped, Protocol):
    """Protocol of such a world of continuous actions.

    An action is float32 (size,) within [-1, 1], the ends being the bounds of the world's own
    action space.
    """

    @property
    def action_size(self) -> int:
        """Length of an action."""
        ...


@runtime_checkable
class Transitions(Protocol):
    """Protocol of the columns of a demonstrations table that learners read.

    Rows of an episode are adjacent and in order.
    """

    @property
    def observation(self) -> np.ndarray:
        """(transitions, features), float32."""
        ...

    @property
    def action(self) -> np.ndarray:
        """(transitions,), integers; continuous ones (transitions, size), float32 in [-1, 1]."""
        ...

    @property
    def next_observation(self) -> np.ndarray:
        """(transitions, features), float32."""
        ...

    @property
    def ending(self) -> np.ndarray:
        """(transitions,), values of `Ending`."""
        ...

    @property
    def rewards(self) -> RewardPair:
        """The reward pair, each (transitions,)."""
        ...

    @property
    def episode_starts(self) -> np.ndarray:
        """Row of each episode's first transition."""
        ...

    @property
    def n_actions(self) -> int:
        """Number of discrete actions."""
        ...

    def returns(self, kind: str, discount: float) -> RewardPair:
        """Return the pair of cumulative returns.

        Args:
            kind: Kind of returns, one of `social.returns.TARGET_KINDS`.
            discount: Discount factor of one step.
        """
        ...


ACTION_BOUNDS = "action_bounds"
"""Name, in provenance, of the ends of continuous actions in the units of their origin."""


Act = Callable[[np.ndarray], Any]
"""From observations, (row, feature), to actions, (row,), or continuous ones (row, size)."""


def is_unit_box(space: Any) -> bool:
    """Whether the bounds of a Gymnasium `Box` are -1 and 1, and its actions one float32 vector."""
    bounds = np.abs([space.low, space.high])
    return space.dtype == np.float32 and len(space.shape) == 1 and bool((bounds == 1.0).all())


OBSERVATION = "observation"
"""Name, in provenance, of the schema of observations where that is not `ROWS`."""

ROWS = "rows-1"
"""Schema of observations that are not named otherwise: rows of vehicles, or a gridworld's state."""
