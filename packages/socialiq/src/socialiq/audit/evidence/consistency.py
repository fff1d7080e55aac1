"""Consistency of the answers of a policy that is code: new processes, and questions asked again.

A policy's action must depend on the observation alone. Else the episodes don't show how it drives
elsewhere. So each block of episodes has a new process. What it met in them is asked again: of one
process in the same batches, and of another one by one and in mixed batches. Each process starts
after the one before has ended, so no process can tell another what it has met.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Shaped
from scipy.stats import binom

from socialiq.types import Json, Policy

ALLOWED = 0.001
"""Largest share of differing answers in other batches. The last bits of a network's output depend
on the size of the batch, which changes about one action in a million; a policy of exact ties may
exceed the share, and has to break them by rule."""

CHANCE = 1e-6  # chance that an honest policy that draws is found to depend on something else

NEAR = 1e-4
"""Largest difference of two equal continuous actions, in halves of the range of each number. Sums
of float32 in another order change an action by about a millionth."""

MOST_ROWS = 16_384  # observations that are kept, if they are in enough batches
FEWEST_BATCHES = 4
SINGLE = 1_000  # observations that are asked one by one
LARGEST = 256  # observations of the largest mixed batch
_ORDER = 8104  # makes these draws independent of other draws


class Answers(NamedTuple):
    """Number of observations that were asked again, and of those with another action than before.

    Of drawn actions: number of those whose draws tell something, and of those in which draws differ
    more between two pairs than within them.
    Continuous actions are others where a number differs by more than `NEAR`.
    """

    queries: int
    differing: int


class Consistency(NamedTuple):
    """Answers to the observations of the episodes, asked again.

    They are repeated by a process that was asked as often as the policy in all episodes: any
    difference depends on time, on the number of requests, on the process or on chance.
    """

    repeated: Answers  # by one process in the same batches
    shuffled: Answers  # by a new process, in mixed batches of other sizes
    single: Answers  # by the same new process, one by one

    @staticmethod
    def of(report: Json | None) -> Consistency | None:
        """Return the consistency that a report's JSON has."""
        if report is None:
            return None
        return Consistency(*(Answers(**report[name]) for name in Consistency._fields))

    def dependences(self, soft: bool) -> list[str]:
        """Return influences other than the observation, none for an honest policy.

        Half of drawn answers differ by chance: more do with an error of at most `CHANCE`.
        """

        def differ(answers: Answers, allowed: float) -> bool:
            if soft:
                return bool(binom.sf(answers.differing - 1, answers.queries, 0.5) < CHANCE)
            return answers.differing > math.floor(allowed * answers.queries)

        dependences = ["the time or the number of requests"] if differ(self.repeated, 0.0) else []
        if any(differ(answers, ALLOWED) for answers in (self.shuffled, self.single)):
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
    """A policy without a memory that keeps some of its batches and answers.

    They are spread evenly over all requests. Actions that it draws are asked for twice at once.
    `restart` ends its process and starts a new one.
    """

    def __init__(self, policy: Policy, restart: Callable[[], None]) -> None:
        self._policy = policy
        self.restart = restart
        self._soft = False
        self._batches: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._asked = 0
        self._every = 1

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose the policy's actions, and keep some batches with their answers.

        Args:
            observation: Shape (features,) or (batch, features).
            state: As for `types.Policy`.
            episode_start: As for `types.Policy`.
            deterministic: Whether to take the best action. If not, a batch that is kept is asked
                twice.

        Returns:
            The actions and the state, as the policy returned them.
        """
        chosen, after = self._policy.predict(observation, state, episode_start, deterministic)
        if self._asked % self._every == 0:
            # Copies: a simulator may use its arrays again. One observation, or a batch of two axes.
            batch = np.array(observation, np.float32, ndmin=2)
            actions = np.array(chosen if np.ndim(observation) == 2 else np.asarray(chosen)[None])
            self._soft = not deterministic
            again = self._policy.predict(batch, deterministic=False)[0] if self._soft else actions
            self._batches.append((batch, actions, np.asarray(again)))
            while (
                sum(len(rows) for rows, *_ in self._batches) > MOST_ROWS
                and len(self._batches) > FEWEST_BATCHES
            ):
                self._batches = self._batches[::2]
                self._every = 2 * self._every
        self._asked += 1
        return chosen, after

    def check(self) -> Consistency:
        """Ask a new process as often as the policy was asked, and again; then another one."""
        batch, actions, again = (
            np.concatenate(column) for column in zip(*self._batches, strict=True)
        )

        def actions_of(rows: np.ndarray, sizes: Sequence[int]) -> np.ndarray:
            parts = np.split(rows, np.cumsum(sizes)[:-1])
            greedy = not self._soft
            chosen = [self._policy.predict(batch[part], deterministic=greedy)[0] for part in parts]
            return np.concatenate(chosen)

        def answers_of(rows: np.ndarray, sizes: Sequence[int]) -> Answers:
            answers = [actions_of(rows, sizes) for _ in range(1 + self._soft)]
            if not self._soft:
                far = np.abs(answers[0] - actions[rows]).reshape(len(rows), -1).max(axis=1)
                return Answers(len(rows), int((far > (NEAR if far.dtype.kind == "f" else 0)).sum()))
            # The energy distance of two pairs of draws: on average 0 if they are of one
            # distribution, when it is as often positive as negative, else positive.
            pairs = (actions[rows], again[rows], *answers)
            apart = _distance(pairs[0], pairs[2]) + _distance(pairs[1], pairs[3])
            apart -= _distance(*pairs[:2]) + _distance(*pairs[2:])
            return Answers(int((apart != 0).sum()), int((apart > 0).sum()))

        rng = np.random.default_rng(_ORDER)
        single, shuffled = (rng.permutation(len(batch)) for _ in range(2))
        sizes: list[int] = []
        while sum(sizes) < len(batch):
            sizes.append(min(int(rng.integers(2, LARGEST + 1)), len(batch) - sum(sizes)))
        same = np.arange(len(batch)), [len(rows) for rows, *_ in self._batches]
        self.restart()
        for _ in range(self._every):  # one process meets all requests of an audit
            actions_of(*same)
        repeated = answers_of(*same)
        self.restart()
        alone = answers_of(single[:SINGLE], [1] * min(SINGLE, len(batch)))
        return Consistency(repeated, answers_of(shuffled, sizes), alone)


def _distance(
    actions: Shaped[np.ndarray, "row ..."], drawn_again: Shaped[np.ndarray, "row ..."]
) -> Float[np.ndarray, " row"]:
    """Return how far drawn actions are from others: 0 or 1 for numbers of actions."""
    if actions.dtype.kind == "f":
        return np.linalg.norm(actions - drawn_again, axis=-1)
    return (actions != drawn_again).astype(np.float64)
