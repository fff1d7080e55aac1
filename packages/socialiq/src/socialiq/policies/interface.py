"""Interface of a policy, and policies given by a function of a batch, with checked answers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from gymnasium import Space, spaces
from jaxtyping import Float32, Int64

from socialiq.errors import UserError


@runtime_checkable
class Spaces(Protocol):
    """Protocol of a world that policies act in."""

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        ...

    @property
    def action_space(self) -> Space[Any]:
        """Space of one action."""
        ...


class Interface(NamedTuple):
    """Sizes of a policy's observations and actions.

    Attributes:
        n_features: Length of an observation.
        n_actions: Number of actions; 0 if they are continuous.
        action_size: Length of a continuous action; 0 if they are discrete.
    """

    n_features: int
    n_actions: int
    action_size: int = 0

    @staticmethod
    def of(world: Spaces) -> Interface:
        """Return the interface of a world that has a Gymnasium space of actions.

        Args:
            world: Its actions are `Discrete`, or a `Box` within [-1, 1].
        """
        space = world.action_space
        if isinstance(space, spaces.Box):
            return Interface(world.n_features, 0, int(space.shape[0]))
        assert isinstance(space, spaces.Discrete)
        return Interface(world.n_features, int(space.n))

    def as_json(self) -> dict[str, int]:
        """Return the sizes by name: of the actions their number or their length, whichever is."""
        if self.action_size:
            return {"n_features": self.n_features, "action_size": self.action_size}
        return {"n_features": self.n_features, "n_actions": self.n_actions}

    @staticmethod
    def of_json(record: Mapping[str, Any]) -> Interface:
        """Return the interface of a record's JSON."""
        sizes = (record.get(name, 0) for name in ("n_actions", "action_size"))
        return Interface(record["n_features"], *sizes)

    @property
    def answer(self) -> str:
        """One action in words."""
        if self.action_size:
            return f"{_numbers(self.action_size)} in [-1, 1]"
        return f"one of {self.n_actions} actions"

    def checked(self, answer: Any, rows: int, source: str) -> np.ndarray:
        """Return a policy's answer as actions: int64 (rows,), or float32 (rows, action_size).

        Args:
            answer: The answer.
            rows: Number of observations.
            source: The policy's name in messages.

        Raises:
            UserError: If it is anything else, out of range or not finite.
        """
        if self.action_size:
            return checked_vectors(answer, rows, self.action_size, source)
        return checked_actions(answer, rows, self.n_actions, source)

    def check(self, source: str, world: Interface) -> None:
        """Refuse a policy that was made for another world.

        Raises:
            UserError: If either number is not the world's.
        """
        if self == world:
            return
        if self.action_size or world.action_size:
            clock = " (a clock adds a feature)" if self.n_features == world.n_features + 1 else ""
            raise UserError(
                f"{source} takes {self.n_features} features and {self._actions()}, the world has "
                f"{world.n_features} and {world._actions()}{clock}: name the world it was made for"
            )
        raise UserError(
            f"{source} takes {self.n_features} features and {self.n_actions} actions, the "
            f"world has {world.n_features} and {world.n_actions}: name the world it was made "
            "for"
        )

    def _actions(self) -> str:
        if self.action_size:
            return f"actions of {_numbers(self.action_size)}"
        return f"{self.n_actions} discrete actions"


@dataclass(frozen=True)
class BatchPolicy:
    """A policy given by one function of a batch of observations; every answer is checked.

    Attributes:
        source: Its name in messages.
        interface: Its sizes.
        decide: (observations float32 (batch, features), deterministic) -> one action a row.
    """

    source: str
    interface: Interface
    decide: Callable[[np.ndarray, bool], Any]

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose actions for one observation, shape (features,), or a batch (batch, features).

        Args:
            observation: s.
            state: Passed through; the policy has no memory.
            episode_start: Ignored, for the same reason.
            deterministic: Passed on.

        Raises:
            UserError: If an observation is not of the interface or not finite, or the answer is
                not one action for each.
        """
        batch = checked_batch(observation, self.interface.n_features)
        answer = self.decide(batch, deterministic)
        actions = self.interface.checked(answer, len(batch), self.source)
        return (actions if np.ndim(observation) == 2 else actions.squeeze(axis=0)), state


def checked_batch(observation: Any, n_features: int) -> Float32[np.ndarray, "batch feature"]:
    """Return observations as a batch, float32.

    Raises:
        UserError: If they have another length, or are not finite.
    """
    batch = np.atleast_2d(np.asarray(observation, np.float32))
    if batch.ndim != 2 or batch.shape[1] != n_features:
        raise UserError(
            f"observation of shape {batch.shape[1:]}: this policy takes ({n_features},)"
        )
    if not np.isfinite(batch).all():
        raise UserError("observation holds NaN or infinity: check the sensor or the data")
    return batch


def checked_actions(
    answer: Any, rows: int, n_actions: int, source: str
) -> Int64[np.ndarray, " batch"]:
    """Return an answer as action numbers.

    Raises:
        UserError: If it is not one integer from 0 to n_actions - 1 for each row.
    """
    try:
        actions = np.asarray(answer)
    except (ValueError, TypeError) as error:  # rows of several lengths
        raise UserError(f"{source} must answer one action for each observation") from error
    if actions.shape != (rows,) or actions.dtype.kind not in "iu":
        raise UserError(
            f"{source} answered {actions.dtype} of shape {actions.shape}: it must be one integer "
            f"for each of {rows} observations"
        )
    wrong = np.flatnonzero((actions < 0) | (actions >= n_actions))
    if len(wrong):
        raise UserError(
            f"{source} chose action {actions[wrong[0]]}: it must be from 0 to {n_actions - 1}"
        )
    return actions.astype(np.int64)


def _numbers(size: int) -> str:
    return "1 number" if size == 1 else f"{size} numbers"


def checked_vectors(
    answer: Any, rows: int, size: int, source: str
) -> Float32[np.ndarray, "batch size"]:
    """Return an answer as continuous actions.

    Raises:
        UserError: If it is not one vector of this size in [-1, 1] for each row.
    """
    try:
        actions = np.asarray(answer)
    except (ValueError, TypeError) as error:  # rows of several lengths
        raise UserError(f"{source} must answer {_numbers(size)} for each observation") from error
    if actions.shape != (rows, size) or actions.dtype.kind not in "fiu":
        raise UserError(
            f"{source} answered {actions.dtype} of shape {actions.shape}: it must be "
            f"{_numbers(size)} for each of {rows} observations"
        )
    actions = actions.astype(np.float64)
    if not np.isfinite(actions).all():
        raise UserError(f"{source} answered NaN or infinity: name a sound policy")
    if (np.abs(actions) > 1.0).any():
        raise UserError(
            f"{source} chose {actions[np.abs(actions) > 1.0][0]:g}: continuous actions must be in "
            "[-1, 1], the ends being the bounds of the action space"
        )
    return actions.astype(np.float32)
