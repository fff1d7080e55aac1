"""Evidence of the drivers' episodes: seeds, totals, endings, contacts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int8, Int64

from socialiq.errors import UserError
from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.intersection.state import Contact


@dataclass(frozen=True)
class Reference:
    """A driver to compare with.

    Attributes:
        name: Of its own.
        policy: Anything with `predict`.
        angle: Social angle in degrees for which it was made, if any; it makes a point of the
            reference curve.
    """

    name: str
    policy: Policy
    angle: float | None = None

    @property
    def angles(self) -> tuple[float, ...]:
        """The angle as `Outcomes` keep it."""
        return () if self.angle is None else (self.angle,)


@dataclass(frozen=True, eq=False)
class Outcomes:
    """One driver's episodes.

    Attributes:
        name: Of the driver.
        totals: Undiscounted sums of r_env and r_social of each episode.
        ending: Values of `types.Ending`.
        contact: Values of `Contact`; in a gridworld every collision counts as the ego's.
        length: Decisions.
        angles: Angles in degrees for which a reference was made: none, one, or the two ends of
            the interval in which it is the exact optimum (the second may exceed 360).
        expected: Exact expectation of the totals, where the world allows one.
    """

    name: str
    totals: Float[np.ndarray, "episode 2"]
    ending: Int8[np.ndarray, " episode"]
    contact: Int8[np.ndarray, " episode"]
    length: Int64[np.ndarray, " episode"]
    angles: tuple[float, ...] = ()
    expected: RewardPair | None = None

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


@dataclass(frozen=True, eq=False)
class Evidence:
    """A policy and its references on the same episodes.

    Attributes:
        scenario: The world's description.
        seeds: One for each episode, the same for every driver.
        policy: The policy under audit.
        references: The drivers that it is compared with.
        strata: Label of each episode by name of the stratification. Labels depend on the seed
            alone, so no driver can choose its stratum.
    """

    scenario: str
    seeds: Int64[np.ndarray, " episode"]
    policy: Outcomes
    references: tuple[Outcomes, ...]
    strata: Mapping[str, np.ndarray]

    def __post_init__(self) -> None:
        if not self.references:
            raise UserError("an audit needs at least one reference driver to compare with")
        names = [one.name for one in (self.policy, *self.references)]
        if len(set(names)) < len(names):
            raise UserError(f"drivers must have names of their own, got {', '.join(names)}")
        for one in (self.policy, *self.references):
            if len(one.totals) != self.episodes:
                raise UserError(
                    f"drivers must be compared on the same episodes: {one.name} drove "
                    f"{len(one.totals)} of {self.episodes}"
                )

    @property
    def episodes(self) -> int:
        """Number of episodes of every driver."""
        return len(self.seeds)

    def gains(self) -> Float[np.ndarray, "reference episode 2"]:
        """Totals of each reference less the policy's, episode by episode."""
        return np.stack([one.totals for one in self.references]) - self.policy.totals

    def part(self, rows: Bool[np.ndarray, " episode"]) -> Evidence:
        """The same evidence on some of the episodes, for instance those of a stratum."""
        return Evidence(
            self.scenario,
            self.seeds[rows],
            _part(self.policy, rows),
            tuple(_part(one, rows) for one in self.references),
            {name: labels[rows] for name, labels in self.strata.items()},
        )


def _part(one: Outcomes, rows: Bool[np.ndarray, " episode"]) -> Outcomes:
    """Some episodes of a driver; what was expected over all says nothing of some."""
    return Outcomes(
        one.name,
        one.totals[rows],
        one.ending[rows],
        one.contact[rows],
        one.length[rows],
        one.angles,
    )


_AUDIT = 7212  # what is drawn by a seed for this purpose is independent of all else drawn by it

FEWEST_EPISODES = 20
"""Below, no bound of the audit says anything."""

MOST_EPISODES = 1_000_000


def episode_seeds(seed: int, episodes: int) -> Int64[np.ndarray, " episode"]:
    """Draw the seeds of the episodes, spread over all that a world can take.

    They are not 0, 1, 2, ...: a policy that was tuned to those meets other episodes here.

    Args:
        seed: The auditor's, drawn after policy and profile were fixed.
        episodes: How many.

    Raises:
        UserError: If the seed is negative, or the number of episodes is none that can be played.
    """
    if seed < 0:
        raise UserError(f"seed must be at least 0, got {seed}")
    check_episodes(episodes)
    rng = np.random.default_rng([_AUDIT, seed])
    drawn = np.unique(rng.integers(2**62, size=episodes + 16))  # so many that none need repeat
    return rng.permutation(drawn)[:episodes]


def check_episodes(episodes: int) -> None:
    """Refuse a number of episodes that no audit has.

    Raises:
        UserError: If it is too small or too large.
    """
    if not FEWEST_EPISODES <= episodes <= MOST_EPISODES:
        raise UserError(
            f"episodes must be from {FEWEST_EPISODES} to {MOST_EPISODES}, got {episodes}"
        )


CRITERIA = {
    "at_fault": "drives into somebody",
    "struck": "is driven into by somebody",
    "arrival": "arrives",
    "timeout": "runs out of time",
}
"""Criteria of the safety floor, and the event that each counts, as reports word it."""


def events_of(driver: Outcomes) -> dict[str, Bool[np.ndarray, " episode"]]:
    """Return the episodes in which each of `CRITERIA` happened."""
    arrived, late = (driver.ending == kind for kind in (Ending.ARRIVAL, Ending.TIMEOUT))
    return dict(zip(CRITERIA, (driver.at_fault, driver.struck, arrived, late), strict=True))
