"""Evidence of an audit: each driver's episodes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int64

from socialiq.audit.evidence.consistency import Consistency
from socialiq.audit.profile.fields import QUANTITIES
from socialiq.audit.profile.profile import Clip
from socialiq.errors import UserError
from socialiq.evaluation.context import ContextLosses
from socialiq.evaluation.measures import Episodes, joined
from socialiq.social.angle import exact_weights, score
from socialiq.types import Policy, RewardPair

COLUMNS = ("r_env", "r_social", "ending", "contact", "length")
"""Columns of the episodes of each driver."""

LOSS = "loss"
"""Further column of each driver where a rule of the angle is declared: its decision loss."""


@dataclass(frozen=True)
class Reference:
    """A driver to compare with, by a unique name.

    With a social angle for which it was made, in degrees, it is a point of the calibration curve.
    """

    name: str
    policy: Policy
    angle: float | None = None
    schema: str = ""  # of its observations, as `World.schema`; "" for that of the world

    @property
    def angles(self) -> tuple[float, ...]:
        """The angle, as in `Outcomes`."""
        return () if self.angle is None else (self.angle,)


@dataclass(frozen=True, eq=False)
class Outcomes:
    """One driver's episodes.

    A reference was made for no angle, for one, or for the two ends of the interval in which it is
    the exact optimum, in degrees (the second may exceed 360). In a gridworld every collision counts
    as the ego's. The episodes have `COLUMNS`, the decision loss (`LOSS`) where a rule is declared,
    and the effects that have bounds (`Profile.effects`).
    """

    name: str
    episodes: Episodes  # r_env and r_social are undiscounted
    angles: tuple[float, ...] = ()
    expected: RewardPair | None = None  # exact totals, where they are known
    contexts: ContextLosses | None = None  # of the policy under audit

    def __post_init__(self) -> None:
        if not np.isfinite(self.totals).all():
            raise UserError(f"the rewards of {self.name} are not finite: they can't be audited")

    @property
    def totals(self) -> Float[np.ndarray, "episode 2"]:
        """Sums of r_env and r_social of each episode."""
        return np.stack(self.episodes.totals, axis=1)

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the columns that are not in `COLUMNS`."""
        return tuple(name for name in self.episodes if name not in COLUMNS)

    def with_columns(self, **columns: np.ndarray) -> Outcomes:
        """Return the driver whose episodes have these columns, new or replaced."""
        return replace(self, episodes=Episodes(self.episodes, **columns))

    @property
    def mean(self) -> RewardPair:
        """Mean totals (R_env, R_social)."""
        env, social = self.totals.mean(axis=0).tolist()
        return RewardPair(env, social)

    def clipped(self, clip: Clip) -> Outcomes:
        """Return the driver with its totals clipped."""
        env, social = self.totals.clip(*clip.ends).T
        return self.with_columns(r_env=env, r_social=social)

    def drove_as(self, driver: Outcomes) -> bool:
        """Whether every episode is equal to that of a driver."""
        return all(np.array_equal(self.episodes[name], driver.episodes[name]) for name in COLUMNS)

    def values(self, angle: float) -> Float[np.ndarray, " episode"]:
        """Return R(α) of each episode at an angle in degrees."""
        return np.asarray(score(exact_weights(angle), self.episodes.totals))


def end_to_end(blocks: Sequence[Outcomes]) -> Outcomes:
    """Return one driver's outcomes in blocks of episodes as those of all."""
    contexts = None
    losses = [block.contexts for block in blocks if block.contexts is not None]
    if losses:
        contexts = ContextLosses(*map(np.concatenate, zip(*losses, strict=True)))
    episodes = joined([block.episodes for block in blocks])
    return replace(blocks[0], episodes=episodes, contexts=contexts)


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
            if len(driver.episodes.ending) != self.episodes:
                raise UserError(
                    f"drivers must be compared on the same episodes: {driver.name} drove "
                    f"{len(driver.episodes.ending)} of {self.episodes}"
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
            lost = driver.episodes[LOSS]
            lossy = driver.with_columns(r_env=-lost, r_social=np.zeros_like(lost))
            # The exact optimum of every decision can't be bettered.
            exact = driver.name == AS_DECLARED and driver.expected is not None
            expected = RewardPair(0.0, 0.0) if exact else None
            return replace(lossy, expected=expected)

        return self._with_each(turned)

    def clipped(self, clip: Clip | None) -> Evidence:
        """Return the evidence with the totals of every driver clipped, if limits are declared."""
        return self if clip is None else self._with_each(lambda driver: driver.clipped(clip))

    def _with_each(self, changed: Callable[[Outcomes], Outcomes]) -> Evidence:
        policy, *others = map(changed, self.drivers)
        count = len(self.references)
        references = tuple(others[:count])
        trivial = tuple(others[count:])
        return replace(self, policy=policy, references=references, trivial=trivial)

    def without(self, names: Collection[str]) -> Evidence:
        """Return the evidence without the references of these names."""
        references = tuple(row for row in self.references if row.name not in names)
        return replace(self, references=references)


AS_DECLARED = "as_declared"
"""Reference that decides as a declared rule says: the dial, or in a gridworld the exact one."""

CRITERIA = {
    "at_fault": "drives into another",
    "struck": "is struck by another",
    "arrival": "arrives",
    "timeout": "runs out of time",
}
"""Criteria of the safety floor, and the event that each counts, in the words of reports."""


def criterion(name: str) -> str:
    """Return what a driver does by the name of a criterion, or of an effect that has a bound."""
    return CRITERIA.get(name) or QUANTITIES[name].words


def events_of(driver: Outcomes) -> dict[str, Bool[np.ndarray, " episode"]]:
    """Return the episodes with the event of each of `CRITERIA`."""
    return {name: driver.episodes[name] for name in CRITERIA}
