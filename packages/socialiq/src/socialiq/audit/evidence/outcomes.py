"""Evidence of an audit: seeds, and each driver's totals, endings and contacts."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int8, Int64

from socialiq.audit.evidence.consistency import Consistency
from socialiq.errors import UserError
from socialiq.evaluation.context import ContextLosses
from socialiq.social.angle import exact_weights, score
from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.highway.state import Contact


@dataclass(frozen=True)
class Reference:
    """A driver to compare with.

    Attributes:
        name: Unique name.
        policy: Anything with `predict`.
        angle: Social angle in degrees for which it was made, if any; it is then a point of the
            calibration curve.
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

    Attributes:
        name: Name of the driver.
        totals: Undiscounted sums of r_env and r_social of each episode.
        ending: Values of `types.Ending`.
        contact: Values of `Contact`; in a gridworld every collision counts as the ego's.
        length: Number of decisions.
        angles: Angles in degrees for which a reference was made: none, one, or the two ends of
            the interval in which it is the exact optimum (the second may exceed 360).
        expected: Exact expectation of the totals, where it is known.
        lost: Decision loss of each episode at a declared rule; None without one.
        contexts: The same by context, of the policy under audit.
    """

    name: str
    totals: Float[np.ndarray, "episode 2"]
    ending: Int8[np.ndarray, " episode"]
    contact: Int8[np.ndarray, " episode"]
    length: Int64[np.ndarray, " episode"]
    angles: tuple[float, ...] = ()
    expected: RewardPair | None = None
    lost: Float[np.ndarray, " episode"] | None = None
    contexts: ContextLosses | None = None

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

    def values(self, angle: float) -> Float[np.ndarray, " episode"]:
        """Return R(α) of each episode at an angle in degrees."""
        return np.asarray(score(exact_weights(angle), RewardPair(*self.totals.T)))


@dataclass(frozen=True, eq=False)
class Evidence:
    """A policy and its references on the same episodes.

    Attributes:
        scenario: The world's description.
        seeds: Seed of each episode, the same for every driver.
        policy: Outcomes of the policy under audit.
        references: Outcomes of the drivers that it is compared with.
        strata: Label of each episode by name of the stratification. Labels depend on the seed
            alone, so no driver can choose its stratum.
        trivial: Outcomes of constant and random actions, which are no references of the regret
            test (`evidence.drive`).
        consistency: Answers of the policy to repeated queries; None if it was not asked.
    """

    scenario: str
    seeds: Int64[np.ndarray, " episode"]
    policy: Outcomes
    references: tuple[Outcomes, ...]
    strata: Mapping[str, np.ndarray]
    trivial: tuple[Outcomes, ...] = ()
    consistency: Consistency | None = None

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
            return dataclasses.replace(driver, totals=totals, expected=expected)

        return dataclasses.replace(
            self,
            policy=turned(self.policy),
            references=tuple(map(turned, self.references)),
            trivial=tuple(map(turned, self.trivial)),
        )

    def without(self, names: Collection[str]) -> Evidence:
        """Return the evidence without the references of these names."""
        references = tuple(
            reference for reference in self.references if reference.name not in names
        )
        return dataclasses.replace(self, references=references)


AS_DECLARED = "as_declared"
"""Reference that decides as a declared rule says: the dial, or in a gridworld the exact one."""

_AUDIT = 7212  # makes these draws independent of other draws from the same seed

FEWEST_EPISODES = 20
"""With fewer, no bound of the audit is informative."""

MOST_EPISODES = 1_000_000


def episode_seeds(seed: int, episodes: int) -> Int64[np.ndarray, " episode"]:
    """Draw the seeds of the episodes from the whole range of seeds.

    They are not 0, 1, 2, ..., to which a policy might have been tuned.

    Args:
        seed: The auditor's seed, drawn after policy and profile were fixed.
        episodes: Number of episodes.

    Raises:
        UserError: If the seed is negative, or the number of episodes is out of range.
    """
    if seed < 0:
        raise UserError(f"seed must be at least 0, got {seed}")
    check_episodes(episodes)
    rng = np.random.default_rng([_AUDIT, seed])
    seeds = np.unique(rng.integers(2**62, size=episodes + 16))  # 16 more, in case of repeats
    return rng.permutation(seeds)[:episodes]


def check_episodes(episodes: int) -> None:
    """Check the number of episodes of an audit.

    Raises:
        UserError: If it is out of range.
    """
    if not FEWEST_EPISODES <= episodes <= MOST_EPISODES:
        raise UserError(
            f"episodes must be from {FEWEST_EPISODES} to {MOST_EPISODES}, got {episodes}"
        )


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
