"""Tests of many audits at once, drawn from a pool of episodes that every driver has driven."""

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int64
from scipy.stats import binom

from socialiq.audit.evidence.outcomes import Outcomes, events_of
from socialiq.audit.profile.profile import Profile
from socialiq.audit.profile.template import possible_loss
from socialiq.audit.verdict.direction import TOLERANCE, Driver, driver_of, drivers_of, ends_of
from socialiq.evaluation.measures import Episodes
from socialiq.statistics import betting, intervals
from socialiq.types import Row
from socialiq.worlds.registry import make
from socialiq_lab import audit_drivers as drivers
from socialiq_lab.audit_arena import default_declaration

ERROR = 0.05
COMPARED = 4
"""References that an audit compares, of those with the largest rewards in the pool: the bounds of
the others are lower. In a gridworld it is the exact optimum alone."""
TESTS = ("regret", "direction", "floor", "character")
Shares = Bool[np.ndarray, "share episode"]


def most_events(limit: float, episodes: int) -> int:
    """Return the largest number of events that shows a share to be within a limit.

    Args:
        limit: Largest share that is allowed; with 1 or more any number of events is within it.
        episodes: Number of episodes in which the events are counted.

    Returns:
        Number of events at the error `ERROR`, -1 if no number shows it.
    """
    return episodes if limit >= 1.0 else int(binom.ppf(ERROR, episodes, limit)) - 1


class Measured(NamedTuple):
    """A driver on the pool, as the tests of a declaration measure it."""

    losses: Float[np.ndarray, "reference episode"]  # in units of the largest loss
    sides: Float[np.ndarray, "end episode"]  # likewise, negative where it is within the width
    floor: Shares  # events of which each share has a limit
    beyond: Shares


class Audits(NamedTuple):
    """A default declaration, and its reference drivers on the pool."""

    profile: Profile
    references: tuple[Outcomes, ...]  # with clipped rewards
    line: list[Driver]
    limit: Callable[[float], Any]  # largest loss of an episode at an angle in degrees

    @staticmethod
    def of(world: str, declared: float, pool: Mapping[str, drivers.Driven]) -> "Audits":
        """Take the references of a default audit from the pool.

        Args:
            world: Name of the world.
            declared: Declared angle in degrees.
            pool: Drivers on the pool by name; those marked `reference` are compared.
        """
        profile = default_declaration(world, declared)
        built = make(world)
        rows = [row.outcomes for row in pool.values() if row.reference]
        clip = profile.clip
        references = tuple(row if clip is None else row.clipped(clip) for row in rows)
        limit = functools.partial(possible_loss, built)
        largest = limit if clip is None else clip.largest_loss
        return Audits(profile, references, drivers_of(references), largest)

    def measured(self, driver: Outcomes) -> Measured:
        """Measure a driver in every episode of the pool."""
        angle = self.profile.angle
        margin = self.profile.margin
        own = driver_of(self.line, angle)
        clip = self.profile.clip
        driver = driver if clip is None else driver.clipped(clip)
        assert margin.width is not None and own is not None
        best = [own.outcomes]
        if own.outcomes.expected is None:
            others = [row for row in self.references if row.name != driver.name]
            best = sorted(others, key=lambda row: -row.values(angle).mean())[:COMPARED]
        losses = np.array([row.values(angle) - driver.values(angle) for row in best])
        ends = [end for end in ends_of(self.line, angle, margin.width) if end is not None]
        tested = [row for row in (driver_of(self.line, end) for end in ends) if row is not None]
        rewards = np.array([row.outcomes.values(angle + 90.0) for row in (*tested, own)])
        sides = []
        beyond = []
        for end, row in zip(ends, tested, strict=True):
            sign = 1.0 if end < angle else -1.0
            across = row.across
            difference = row.outcomes.values(across) - driver.values(across)
            sides.append(sign * difference / self.limit(across))
            farthest = (-sign * rewards).max(axis=0) + TOLERANCE * margin.regret
            beyond.append(-sign * driver.values(angle + 90.0) > farthest)
        events = events_of(driver)
        kinds = [events["at_fault"], events["struck"], ~events["arrival"], events["timeout"]]
        return Measured(losses / self.limit(angle), *map(np.array, (sides, kinds, beyond)))

    @property
    def limits(self) -> dict[str, Any]:
        """Levels of the means and limits of the shares, by test."""
        floor = self.profile.competence
        margin = self.profile.margin
        limits = floor.max_at_fault, floor.max_struck, 1.0 - floor.min_arrival, floor.max_timeout
        level = margin.regret / self.limit(self.profile.angle)
        return dict(zip(TESTS, (level, 0.0, limits, [margin.beyond]), strict=True))

    def holds(self, driver: Outcomes, tests: Sequence[str] = TESTS) -> bool:
        """Whether a driver's true values, those of the pool, are within the limits of tests.

        Args:
            driver: Outcomes of the driver in all episodes of the pool.
            tests: Names of the tests, from `TESTS`.
        """
        measured: dict[str, np.ndarray] = dict(zip(TESTS, self.measured(driver), strict=True))
        means = {name: measured[name].mean(axis=1) for name in tests}
        if "direction" in means and not (means["direction"] < 0.0).all():
            return False  # a driver on an end is not within
        return all((mean <= np.array(self.limits[name])).all() for name, mean in means.items())

    def shares(self, driver: Outcomes, episodes: int, audits: int, seed: int) -> Row:
        """Return the shares of audits that pass, and that keep each test.

        Args:
            driver: Outcomes of the driver in all episodes of the pool.
            episodes: Number of episodes of an audit.
            audits: Number of audits.
            seed: Seed of the first audit (`tested`).

        Returns:
            Share `passed` with the ends `low` and `high` of its 99 % interval, and a share for each
            of `TESTS`.
        """
        tested = self.tested(driver, episodes, audits, seed)
        passed = int(np.logical_and.reduce(list(tested.values())).sum())
        share = intervals.wilson(passed, audits, 0.99)
        row: Row = {"passed": share.value, "low": share.low, "high": share.high}
        return row | {name: float(by_audit.mean()) for name, by_audit in tested.items()}

    def tested(
        self, driver: Outcomes, episodes: int, audits: int, seed: int
    ) -> dict[str, Bool[np.ndarray, " audit"]]:
        """Return which audits keep each test.

        Args:
            driver: Outcomes of the driver in all episodes of the pool.
            episodes: Number of episodes of an audit.
            audits: Number of audits.
            seed: Seed of the first audit; audit k is drawn from the pool by seed + k.

        Returns:
            By test, whether each audit keeps it, (audit,).
        """
        measured = self.measured(driver)
        rows = resampled(len(driver.episodes.length), episodes, audits, seed)

        def below(values: np.ndarray, level: float) -> Bool[np.ndarray, " audit"]:
            series = values[:, rows].reshape(-1, episodes).clip(-1.0, 1.0)
            significant = betting.significantly_below(series, np.array([level]), 1.0, ERROR)
            return np.asarray(significant[:, 0].reshape(-1, audits).all(axis=0))

        def within(happened: Shares, limits: Sequence[float]) -> Bool[np.ndarray, " audit"]:
            largest = np.array([most_events(limit, episodes) for limit in limits])
            counts = np.array([events[rows].sum(axis=1) for events in happened])
            return np.asarray((counts <= largest[:, None]).all(axis=0))

        tests = (below, below, within, within)
        return {
            name: test(values, self.limits[name])
            for name, test, values in zip(TESTS, tests, measured, strict=True)
        }


@functools.lru_cache(maxsize=2)
def resampled(
    pool: int, episodes: int, audits: int, seed: int
) -> Int64[np.ndarray, "audit episode"]:
    """Draw the episodes of audits from a pool, with replacement.

    Args:
        pool: Number of episodes of the pool.
        episodes: Number of episodes of an audit.
        audits: Number of audits.
        seed: Seed of the first audit; audit k is drawn by seed + k.

    Returns:
        Numbers of the pool's episodes, (audit, episode).
    """
    rngs = (np.random.default_rng(seed + number) for number in range(audits))
    return np.array([rng.integers(pool, size=episodes) for rng in rngs])


def outcomes(
    name: str,
    totals: np.ndarray,
    ending: np.ndarray,
    contact: np.ndarray,
    angles: tuple[float, ...] = (),
) -> Outcomes:
    """Return outcomes of episodes of one decision each.

    Args:
        name: Name of the driver.
        totals: Totals of both rewards, (episode, 2).
        ending: Values of `Ending`, (episode,).
        contact: Values of `Contact`, (episode,).
        angles: Angle in degrees that a reference was made for; empty for a policy.
    """
    length = np.ones(len(totals), np.int64)
    env, social = totals.T
    episodes = Episodes(r_env=env, r_social=social, ending=ending, contact=contact, length=length)
    return Outcomes(name, episodes, angles)


def shares(number: int, **counts: int) -> Row:
    """Return shares of a number of audits, each with its 99 % interval."""
    row: Row = {}
    for name, count in counts.items():
        share = intervals.wilson(count, number, 0.99)
        row |= {name: share.value, f"{name}_low": share.low, f"{name}_high": share.high}
    return row
