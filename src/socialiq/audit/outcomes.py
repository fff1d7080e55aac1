"""What an audit keeps of the episodes that drivers drove: totals, endings, contacts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int8, Int64

from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair
from socialiq.worlds.intersection.state import Contact


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
        """Episodes in which the ego drove into somebody."""
        return (self.ending == Ending.COLLISION) & (self.contact != Contact.EGO_WAS_STRUCK)

    @property
    def struck(self) -> Bool[np.ndarray, " episode"]:
        """Episodes in which somebody drove into the ego."""
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
        """How many episodes every driver drove."""
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
