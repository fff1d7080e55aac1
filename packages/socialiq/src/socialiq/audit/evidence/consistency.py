"""Consistency of a policy's answers: the same observations, asked again in other ways.

A policy's action depends on the observation alone, or the episodes of an audit say nothing about
how it drives elsewhere. What the policy met in the episodes is asked again: of the same process in
the same batches, and of a new one, which knows nothing of them, one by one and in mixed batches.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float32, Shaped

from socialiq.types import Policy

ALLOWED = 0.001
"""Largest share of differing answers in other batches. The last bits of a network's output depend
on the size of the batch, which changes about one action in a million; a policy of exact ties may
exceed the share, and has to break them by rule."""

NEAR = 1e-4
"""Largest difference of two equal continuous actions, in halves of the range of each number. Sums
of float32 in another order change an action by about a millionth."""

MOST_ROWS = 16_384
"""Observations that are kept, if they are in enough batches."""

FEWEST_BATCHES = 4

SINGLE = 1_000
"""Observations that are asked one by one."""

LARGEST = 256
"""Largest mixed batch."""

_ORDER = 8104  # makes these draws independent of other draws


class Answers(NamedTuple):
    """Answers to repeated queries.

    Attributes:
        queries: Number of observations that were asked again.
        differing: Number of them with another action than in the episodes; continuous actions
            are others where a number differs by more than `NEAR`.
    """

    queries: int
    differing: int

    def plus(self, other: Answers) -> Answers:
        """Return the sums."""
        return Answers(self.queries + other.queries, self.differing + other.differing)


class Consistency(NamedTuple):
    """Answers to the observations of the episodes, asked again.

    Attributes:
        repeated: By the same process in the same batches, after the last episode. Any difference
            depends on time, on the number of requests or on chance.
        shuffled: By a new process, in mixed batches of other sizes.
        single: By a new process, one by one.
    """

    repeated: Answers
    shuffled: Answers
    single: Answers

    @staticmethod
    def of(report: Mapping[str, Any] | None) -> Consistency | None:
        """Return the consistency that a report's JSON has."""
        if report is None:
            return None
        return Consistency(*(Answers(**report[name]) for name in Consistency._fields))

    @property
    def dependences(self) -> list[str]:
        """Influences on the answers besides the observation; none for an honest policy."""
        dependences = ["the time or the number of requests"] if self.repeated.differing else []
        elsewhere = [self.shuffled, self.single]
        if any(answers.differing > math.floor(ALLOWED * answers.queries) for answers in elsewhere):
            dependences.append("the batch, the order or the process")
        return dependences


def joined(checks: Sequence[Consistency | None]) -> Consistency | None:
    """Return the sums over parts of a collection; None if any of them was not checked."""
    complete = [check for check in checks if check is not None]
    if not complete or len(complete) < len(checks):
        return None
    columns = zip(*complete, strict=True)
    return Consistency(*(Answers(*map(sum, zip(*column, strict=True))) for column in columns))


class Recorder:
    """A policy that keeps some batches of observations with its answers, evenly over all requests.

    Args:
        policy: A deterministic policy without a memory.
    """

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._kept: list[tuple[np.ndarray, np.ndarray]] = []
        self._asked, self._every = 0, 1

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose the policy's actions, as `types.Policy`."""
        chosen, after = self._policy.predict(observation, state, episode_start, deterministic)
        if self._asked % self._every == 0:
            # Copies: a simulator may use its arrays again.
            batch = np.array(observation, np.float32, ndmin=2)
            self._kept.append((batch, _rows_of(chosen, np.ndim(observation))))
            while self._rows > MOST_ROWS and len(self._kept) > FEWEST_BATCHES:
                self._kept, self._every = self._kept[::2], 2 * self._every
        self._asked += 1
        return chosen, after

    @property
    def _rows(self) -> int:
        return sum(len(batch) for batch, _ in self._kept)

    def check(self, fresh: Policy) -> Consistency:
        """Ask what was kept again.

        Args:
            fresh: The same policy in a new process, which was not asked before.
        """
        repeated = Answers(0, 0)
        for batch, actions in self._kept:
            repeated = repeated.plus(_asked(self._policy, batch, actions))
        batch = np.concatenate([observations for observations, _ in self._kept])
        actions = np.concatenate([answers for _, answers in self._kept])
        rng = np.random.default_rng(_ORDER)
        order = rng.permutation(len(batch))
        single = Answers(0, 0)
        for row in order[:SINGLE]:
            single = single.plus(_asked(fresh, batch[row : row + 1], actions[row : row + 1]))
        shuffled, order = Answers(0, 0), rng.permutation(len(batch))
        while len(order):
            size = int(rng.integers(2, LARGEST, endpoint=True))
            rows, order = order[:size], order[size:]
            shuffled = shuffled.plus(_asked(fresh, batch[rows], actions[rows]))
        return Consistency(repeated, shuffled, single)


def _rows_of(chosen: np.ndarray, axes: int) -> Shaped[np.ndarray, "row ..."]:
    """Return a copy of the answer to one observation, or a batch (of two axes), as rows."""
    rows = np.array(chosen)
    return rows if axes == 2 else rows[None]


def _asked(
    policy: Policy,
    batch: Float32[np.ndarray, "row feature"],
    actions: Shaped[np.ndarray, "row ..."],
) -> Answers:
    again, _ = policy.predict(batch, deterministic=True)
    far = np.abs(np.asarray(again) - actions) > (NEAR if actions.dtype.kind == "f" else 0)
    return Answers(len(batch), int(far.reshape(len(batch), -1).any(axis=1).sum()))
