"""Interface and record of a policy, and policies given by a function of a batch."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from socialiq.errors import UserError
from socialiq.isolation import NOT_NEEDED, Isolation
from socialiq.nn.q_policy import checked_batch
from socialiq.reading import read_bytes
from socialiq.storage import shipped
from socialiq.types import ROWS, Memoryless, Policy


class Interface(NamedTuple):
    """Sizes of a policy's observations and actions, and the schema of the observations."""

    n_features: int  # length of an observation
    n_actions: int  # number of actions; 0 if they are continuous
    action_size: int = 0  # length of a continuous action; 0 if they are discrete
    schema: str = ""  # name and version, as `World.schema`; "" where a file doesn't name it

    @staticmethod
    def of(world: Any) -> Interface:
        """Return the interface of a world of actions that are `Discrete`, or a `Box` in [-1, 1]."""
        space = world.action_space
        schema = getattr(world, "schema", "")
        if isinstance(space, spaces.Box):
            return Interface(world.n_features, 0, int(space.shape[0]), schema)
        assert isinstance(space, spaces.Discrete)
        return Interface(world.n_features, int(space.n), schema=schema)

    def as_json(self) -> dict[str, Any]:
        """Return the sizes by name, and the schema of observations other than rows."""
        schema: dict[str, Any] = {"schema": self.schema} if self.schema not in ("", ROWS) else {}
        if self.action_size:
            return {"n_features": self.n_features, "action_size": self.action_size} | schema
        return {"n_features": self.n_features, "n_actions": self.n_actions} | schema

    @staticmethod
    def of_json(record: Mapping[str, Any]) -> Interface:
        """Return the interface of a record's JSON."""
        sizes = (record.get(name, 0) for name in ("n_actions", "action_size"))
        return Interface(record["n_features"], *sizes, schema=record.get("schema", ""))

    @property
    def answer(self) -> str:
        """One action in words."""
        if self.action_size:
            return f"{_numbers(self.action_size)} in [-1, 1]"
        return f"one of {self.n_actions} actions"

    def checked(self, answer: Any, rows: int, source: str) -> np.ndarray:
        """Return a policy's answer as actions.

        Args:
            answer: Answer of the policy.
            rows: Number of observations that it answers.
            source: Name of the policy in messages.

        Returns:
            int64 (rows,); for continuous actions float32 (rows, action_size) in [-1, 1].

        Raises:
            UserError: If the answer has another type or shape, or an action is out of range.
        """
        shape = (rows,)
        kinds = "iu"
        words = "one integer"
        if self.action_size:
            shape = rows, self.action_size
            kinds = "fiu"
            words = _numbers(self.action_size)
        try:
            actions = np.asarray(answer)
        except (ValueError, TypeError) as error:  # rows of several lengths
            words = words if self.action_size else "one action"
            raise UserError(f"{source} must answer {words} for each observation") from error
        if actions.shape != shape or actions.dtype.kind not in kinds:
            raise UserError(
                f"{source} answered {actions.dtype} of shape {actions.shape}: it must be {words} "
                f"for each of {rows} observations"
            )
        if not self.action_size:
            wrong = actions[(actions < 0) | (actions >= self.n_actions)]
            if len(wrong):
                raise UserError(
                    f"{source} chose action {wrong[0]}: it must be from 0 to {self.n_actions - 1}"
                )
            return actions.astype(np.int64)
        actions = actions.astype(np.float64)
        if not np.isfinite(actions).all():
            raise UserError(f"{source} answered NaN or infinity: name a sound policy")
        if (np.abs(actions) > 1.0).any():
            raise UserError(
                f"{source} chose {actions[np.abs(actions) > 1.0][0]:g}: continuous actions must be "
                "in [-1, 1], the ends being the bounds of the action space"
            )
        return actions.astype(np.float32)

    def check(self, source: str, world: Interface) -> None:
        """Refuse a policy that was made for another world.

        Args:
            source: Name of the policy in messages.
            world: Interface of the world.

        Raises:
            UserError: If the interfaces differ.
        """
        named = self.schema and world.schema
        if named and self.schema != world.schema:
            mend = "leave observation=route out of the world"
            if self.schema != ROWS:
                mend = f"add observation={self.schema.rpartition('-')[0]} to the world"
            raise UserError(
                f"{source} takes observations of the schema {self.schema}, the world shows "
                f"{world.schema}: {mend}"
            )
        if self[:3] == world[:3]:
            return
        if self.action_size or world.action_size:
            clock = " (a clock adds a feature)" if self.n_features == world.n_features + 1 else ""
            takes, expected = (
                f"actions of {_numbers(sizes.action_size)}"
                if sizes.action_size
                else f"{sizes.n_actions} discrete actions"
                for sizes in (self, world)
            )
        else:
            takes = f"{self.n_actions} actions"
            expected = str(world.n_actions)
            clock = ""
        raise UserError(
            f"{source} takes {self.n_features} features and {takes}, the world has "
            f"{world.n_features} and {expected}{clock}: name the world it was made for"
        )


@dataclass(frozen=True)
class BatchPolicy(Memoryless):
    """A policy given by one function of a batch of observations; every answer is checked."""

    source: str  # its name in messages
    interface: Interface  # its sizes
    # (observations float32 (batch, features), deterministic) -> one action a row
    decide: Callable[[np.ndarray, bool], Any]

    def choose(self, observation: np.ndarray, deterministic: bool, /) -> np.ndarray:
        """Return the checked actions of the function.

        Args:
            observation: One observation, (features,), or a batch, (batch, features).
            deterministic: Passed to the function.

        Returns:
            One action, or one for each row of a batch.

        Raises:
            UserError: If an observation does not fit, or the function does not answer one action
                for each.
        """
        batch = checked_batch(np.atleast_2d(observation), self.interface.n_features)
        answer = self.decide(batch, deterministic)
        actions = self.interface.checked(answer, len(batch), self.source)
        return actions if np.ndim(observation) == 2 else actions.squeeze(axis=0)


@dataclass(frozen=True)
class Record:
    """Facts about a policy, all JSON."""

    kind: str  # "policy", "ensemble", "dial", "table", "sb3", "onnx", "process" or "python"
    source: str  # the specification that it was loaded from, as one printable line
    # SHA-256 of the file's bytes; for a process, of its command and the files named in it
    # (`isolation.hash_files`); for Python in this process, of the module's source
    sha256: str
    covers: str  # description of the hashed content
    interface: Interface  # sizes of its observations and actions
    soft: bool  # whether it gives the distribution of its stochastic actions
    details: Mapping[str, Any] = field(default_factory=dict)  # further facts from its file
    isolation: Isolation = NOT_NEEDED  # isolation of its process

    def as_json(self) -> dict[str, Any]:
        """Return the record as one JSON object."""
        # The file's own facts come first: they can't take the place of the following.
        return {
            **self.details,
            "kind": self.kind,
            "source": self.source,
            "sha256": self.sha256,
            "covers": self.covers,
            **self.interface.as_json(),
            "soft": self.soft,
            "isolation": self.isolation._asdict(),
        }


@dataclass(frozen=True, repr=False)
class Loaded:
    """A policy and its record; a context manager, because a process must be ended."""

    policy: Policy  # decides, as `types.Policy`
    record: Record  # its facts
    # ends the policy's process, if it has one; may be called twice
    close: Callable[[], None] = lambda: None
    # raises `UserError` if the policy's files are no longer those of its hash
    check_unchanged: Callable[[], None] = lambda: None
    # ends the policy's process and starts one from the same files; None without a process
    restart: Callable[[], None] | None = None

    def predict(self, observation: Any, *state: Any, **how: Any) -> tuple[Any, Any]:
        """Return the policy's actions and state, as `types.Policy`.

        Args:
            observation: One observation, or a batch.
            *state: State of a policy with memory.
            **how: Further arguments of the policy, as `deterministic`.
        """
        return self.policy.predict(observation, *state, **how)

    def __repr__(self) -> str:
        """Return kind, name and hash in a line, without weights."""
        record = self.record
        return f"Loaded({record.kind} {record.source}, sha256={record.sha256[:8]})"

    def __enter__(self) -> Loaded:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _numbers(size: int) -> str:
    return "1 number" if size == 1 else f"{size} numbers"


MOST_BYTES = 32 * 1024 * 1024
"""Largest size of a policy's file: eight million float32 weights, far more than needed."""


def read_content(path: Path, most: int = MOST_BYTES) -> bytes:
    """Read a policy's file.

    Args:
        path: The file.
        most: Largest size in bytes.

    Raises:
        UserError: If the file can't be read, or is larger.
    """
    return read_bytes(shipped(path), most)
