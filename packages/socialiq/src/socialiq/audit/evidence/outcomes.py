"""Evidence of an audit: each driver's episodes, and the consistency of the policy's answers.

A policy's action depends on the observation alone, or the episodes say nothing about how it drives
elsewhere. So what it met in the episodes is asked again: of the same process in the same batches,
and of a new one, which knows nothing of them, one by one and in mixed batches.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int8, Int64, Shaped
from scipy.stats import binom

from socialiq.errors import UserError
from socialiq.evaluation import parts
from socialiq.evaluation.context import ContextLosses
from socialiq.policies.interface import Loaded
from socialiq.social.angle import exact_weights, score
from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.highway.options import Contact


@dataclass(frozen=True)
class Reference:
    """A driver to compare with, by a unique name.

    With a social angle for which it was made, in degrees, it is a point of the calibration curve.
    """

    name: str
    policy: Policy
    angle: float | None = None

    @property
    def angles(self) -> tuple[float, ...]:
        """The angle, as in `Outcomes`."""
        return () if self.angle is None else (self.angle,)


@dataclass(frozen=True, eq=False)
class Outcomes:
    """One driver's episodes.

    A reference was made for no angle, for one, or for the two ends of the interval in which it is
    the exact optimum, in degrees (the second may exceed 360). In a gridworld every collision counts
    as the ego's. A decision loss is that of a declared rule; there is none without one.
    """

    name: str
    totals: Float[np.ndarray, "episode 2"]  # undiscounted r_env and r_social
    ending: Int8[np.ndarray, " episode"]  # values of `types.Ending`
    contact: Int8[np.ndarray, " episode"]  # values of `Contact`
    length: Int64[np.ndarray, " episode"]  # number of decisions
    angles: tuple[float, ...] = ()
    expected: RewardPair | None = None  # exact totals, where they are known
    lost: Float[np.ndarray, " episode"] | None = None  # decision loss
    contexts: ContextLosses | None = None  # of the policy under audit

    def __post_init__(self) -> None:
        if not np.isfinite(self.totals).all():
            raise UserError(f"the rewards of {self.name} are not finite: they can't be audited")

    @property
    def at_fault(self) -> Bool[np.ndarray, " episode"]:
        """Episodes in which the ego drove into another vehicle."""
        return (self.ending == Ending.COLLISION) & (self.contact != Contact.EGO_WAS_STRUCK)

    @property
    def struck(self) -> Bool[np.ndarray, " episode"]:
        """Episodes in which another vehicle drove into the ego."""
        return (self.ending == Ending.COLLISION) & (self.contact == Contact.EGO_WAS_STRUCK)

    @property
    def mean(self) -> RewardPair:
        """Mean totals (R_env, R_social)."""
        env, social = self.totals.mean(axis=0).tolist()
        return RewardPair(env, social)

    def clipped(self, lows: tuple[float, float], highs: tuple[float, float]) -> Outcomes:
        """Return the driver with its totals between two pairs (env, social)."""
        return replace(self, totals=self.totals.clip(lows, highs))

    def drove_as(self, driver: Outcomes) -> bool:
        """Whether every episode is equal to that of a driver."""
        names = ("totals", "ending", "contact", "length")
        return all(np.array_equal(getattr(self, name), getattr(driver, name)) for name in names)

    def values(self, angle: float) -> Float[np.ndarray, " episode"]:
        """Return R(α) of each episode at an angle in degrees."""
        return np.asarray(score(exact_weights(angle), RewardPair(*self.totals.T)))


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
SINGLE, LARGEST = 1_000, 256  # observations that are asked one by one; largest mixed batch
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

    They are repeated after the last episode: any difference depends on time, on the number of
    requests or on chance.
    """

    repeated: Answers  # by the same process in the same batches
    shuffled: Answers  # by a new process, in mixed batches of other sizes
    single: Answers  # by a new process, one by one

    @staticmethod
    def of(report: Mapping[str, Any] | None) -> Consistency | None:
        """Return the consistency that a report's JSON has."""
        if report is None:
            return None
        return Consistency(*(Answers(**report[name]) for name in Consistency._fields))

    def dependences(self, soft: bool) -> list[str]:
        """Return influences besides the observation, none for an honest policy.

        Of drawn answers half differ by chance: more do with an error of at most `CHANCE`.
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


def end_to_end(blocks: Sequence[Outcomes]) -> Outcomes:
    """Return one driver's outcomes in blocks of episodes as those of all."""
    names = ["totals", "ending", "contact", "length"]
    names += [] if blocks[0].lost is None else ["lost"]
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(block, name) for block in blocks]) for name in names
    }
    if blocks[0].contexts is not None:
        columns["contexts"] = parts.joined([block.contexts for block in blocks])
    return replace(blocks[0], **columns)


@dataclass(frozen=True, eq=False)
class Evidence:
    """A policy and its references on the same episodes.

    Labels depend on the seed alone, so no driver can choose its stratum. Constant and random
    actions are no references of the regret test (`evidence.drive`).
    """

    scenario: str  # the world's description
    seeds: Int64[np.ndarray, " episode"]  # seed of each episode, the same for every driver
    policy: Outcomes
    references: tuple[Outcomes, ...]
    strata: Mapping[str, np.ndarray]  # label of each episode by stratification
    trivial: tuple[Outcomes, ...] = ()  # of constant and random actions
    consistency: Consistency | None = None  # None if the policy was not asked again

    def __post_init__(self) -> None:
        if not self.references:
            raise UserError("an audit needs at least one reference driver to compare with")
        names = [driver.name for driver in self.drivers]
        if len(set(names)) < len(names):
            raise UserError(f"drivers must have different names, got {', '.join(names)}")
        for driver in self.drivers:
            if len(driver.totals) != self.episodes:
                raise UserError(
                    f"drivers must be compared on the same episodes: {driver.name} drove "
                    f"{len(driver.totals)} of {self.episodes}"
                )

    @property
    def drivers(self) -> tuple[Outcomes, ...]:
        """The policy, the references and the trivial drivers."""
        return (self.policy, *self.references, *self.trivial)

    @property
    def episodes(self) -> int:
        """Number of episodes of every driver."""
        return len(self.seeds)

    def gains(self) -> Float[np.ndarray, "reference episode 2"]:
        """Return the totals of each reference less the policy's, episode by episode."""
        return np.stack([reference.totals for reference in self.references]) - self.policy.totals

    def by_rule(self) -> Evidence:
        """Return the evidence in which a driver's totals are its decision losses, negative.

        So the regret at 0 degrees is the loss at the declared rule, and the reference that decides
        as declared has none.
        """

        def turned(driver: Outcomes) -> Outcomes:
            assert driver.lost is not None  # of a declared rule, every driver's is measured
            totals = np.stack([-driver.lost, np.zeros_like(driver.lost)], axis=1)
            # The exact optimum of every decision can't be bettered.
            exact = driver.name == AS_DECLARED and driver.expected is not None
            expected = RewardPair(0.0, 0.0) if exact else None
            return replace(driver, totals=totals, expected=expected)

        return replace(
            self,
            policy=turned(self.policy),
            references=tuple(map(turned, self.references)),
            trivial=tuple(map(turned, self.trivial)),
        )

    def clipped(self, lows: tuple[float, float], highs: tuple[float, float]) -> Evidence:
        """Return the evidence with the totals of every driver between two pairs (env, social)."""

        def within(drivers: Sequence[Outcomes]) -> tuple[Outcomes, ...]:
            return tuple(row.clipped(lows, highs) for row in drivers)

        (policy,), trivial = within([self.policy]), within(self.trivial)
        return replace(self, policy=policy, references=within(self.references), trivial=trivial)

    def without(self, names: Collection[str]) -> Evidence:
        """Return the evidence without the references of these names."""
        references = tuple(row for row in self.references if row.name not in names)
        return replace(self, references=references)


AS_DECLARED = "as_declared"
"""Reference that decides as a declared rule says: the dial, or in a gridworld the exact one."""

CRITERIA = {
    "at_fault": "drives into another vehicle",
    "struck": "is struck by another vehicle",
    "arrival": "arrives",
    "timeout": "runs out of time",
}
"""Criteria of the safety floor, and the event that each counts, in the words of reports."""


def events_of(driver: Outcomes) -> dict[str, Bool[np.ndarray, " episode"]]:
    """Return the episodes with the event of each of `CRITERIA`."""
    arrived, late = (driver.ending == kind for kind in (Ending.ARRIVAL, Ending.TIMEOUT))
    return dict(zip(CRITERIA, (driver.at_fault, driver.struck, arrived, late), strict=True))


class Recorder:
    """A policy without a memory that keeps some of its batches and answers.

    They are spread evenly over all requests. Actions that it draws are asked for twice at once.
    `again` starts its process once more.
    """

    def __init__(self, policy: Policy, again: Callable[[], Loaded]) -> None:
        self._policy, self._again, self._soft = policy, again, False
        self._present = policy  # answers
        self._batches: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._asked, self._every = 0, 1

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose the policy's actions, as `types.Policy`."""
        chosen, after = self._present.predict(observation, state, episode_start, deterministic)
        if self._present is not self._policy:  # one process meets all requests of an audit
            self._policy.predict(observation, deterministic=deterministic)
        if self._asked % self._every == 0:
            # Copies: a simulator may use its arrays again. One observation, or a batch of two axes.
            batch = np.array(observation, np.float32, ndmin=2)
            actions = np.array(chosen if np.ndim(observation) == 2 else np.asarray(chosen)[None])
            self._soft = not deterministic
            again = self._present.predict(batch, deterministic=False)[0] if self._soft else actions
            self._batches.append((batch, actions, np.asarray(again)))
            while (
                sum(len(rows) for rows, *_ in self._batches) > MOST_ROWS
                and len(self._batches) > FEWEST_BATCHES
            ):
                self._batches, self._every = self._batches[::2], 2 * self._every
        self._asked += 1
        return chosen, after

    @contextlib.contextmanager
    def anew(self) -> Iterator[None]:
        """Answer by a process that was not asked before; the first one lives on."""
        if not self._asked:
            yield
            return
        with self._again() as fresh:
            self._present = fresh.policy
            yield
        self._present = self._policy

    def check(self) -> Consistency:
        """Ask the first process again, and a new one, which was not asked before."""
        batch, actions, again = (
            np.concatenate(column) for column in zip(*self._batches, strict=True)
        )

        def answers_of(policy: Policy, rows: np.ndarray, sizes: Sequence[int]) -> Answers:
            answers = [
                np.concatenate(
                    [
                        np.asarray(policy.predict(batch[part], deterministic=not self._soft)[0])
                        for part in np.split(rows, np.cumsum(sizes)[:-1])
                    ]
                )
                for _ in range(1 + self._soft)
            ]
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
        repeated = answers_of(
            self._policy, np.arange(len(batch)), [len(rows) for rows, *_ in self._batches]
        )
        with self._again() as fresh:
            alone = answers_of(fresh.policy, single[:SINGLE], [1] * min(SINGLE, len(batch)))
            return Consistency(repeated, answers_of(fresh.policy, shuffled, sizes), alone)


def _distance(
    actions: Shaped[np.ndarray, "row ..."], drawn_again: Shaped[np.ndarray, "row ..."]
) -> Float[np.ndarray, " row"]:
    """Return how far drawn actions are from others: 0 or 1 for numbers of actions."""
    if actions.dtype.kind == "f":
        return np.linalg.norm(actions - drawn_again, axis=-1)
    return (actions != drawn_again).astype(np.float64)
