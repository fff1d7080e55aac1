"""Bounds of means: of the safety floor's events and of what a policy causes, and their check."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from socialiq.audit.evidence import drive
from socialiq.audit.evidence.collect import drive_references
from socialiq.audit.evidence.outcomes import CRITERIA, Outcomes, criterion
from socialiq.audit.profile.fields import CAUSED, CLIP, LAST_DIRECTION
from socialiq.audit.profile.profile import Bound, Profile, is_recorded, measured_in
from socialiq.audit.request import Trust, resolve_references, shipped_dial
from socialiq.audit.seeds import episode_seeds
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.direction import driver_of, drivers_of
from socialiq.statistics import betting, intervals
from socialiq.worlds.catalogue import KNOWN, base


@dataclass(frozen=True)
class BoundTest:
    """The mean of a quantity of an episode against its limit, significantly kept or broken.

    Bounds are those of Clopper and Pearson if it is an event, else by betting on the declared range
    of an episode. If the mean must be small, the lower bound is at the fail error and the upper one
    at the pass error; if it must be large, they are swapped.
    """

    name: str  # one of `CRITERIA`, or of `fields.QUANTITIES`
    decision: Decision
    side: str  # "at most" or "at least"
    limit: float
    count: int  # episodes with the event; of other quantities, beyond the declared range
    episodes: int
    share: float  # mean of the quantity: of an event its share
    low: float
    high: float
    pass_error: float  # one-sided error of a wrong pass
    fail_error: float  # one-sided error of a wrong fail
    needed: int | None  # episodes that would decide, if the mean is true and not the limit

    def limit_told(self, world: str) -> str:
        """Return the limit with its side, as "at most 5 %", by the units of a world."""
        return f"{self.side} {self._amount(self.limit, world)}"

    def bound_told(self, world: str) -> str:
        """Return what the driver does at most, or at least, by the bound that a pass rests on."""
        bound = self.low if self.side == "at least" else self.high
        return self.told(bound, world, f"{self.side} ")

    def told(self, value: float, world: str, size: str = "", of: str = "episodes") -> str:
        """Return what a driver does with a mean of this size, in words.

        Args:
            value: The mean.
            world: Name of the world, which decides the unit.
            size: Words before the amount, as "at least ".
            of: Words after "of", which name all episodes; used for shares only.
        """
        amount = size + self._amount(value, world)
        if amount.endswith("%"):
            return f"{criterion(self.name)} in {amount} of {of}"
        return f"{criterion(self.name)} {amount} an episode"

    def clause(self, _where: str, world: str) -> str:
        """Return how the driver breaks the limit, or what of it is not decided.

        Args:
            world: Name of the world, which decides the unit.
        """
        if self.decision is Decision.FAIL:
            limit = self.limit_told(world)
            if self.side == "at least":
                return f"it {self.told(self.high, world, 'at most ')} ({limit} needed)"
            return f"it {self.told(self.low, world, 'at least ')} ({limit} allowed)"
        if self.name not in CRITERIA:
            return self.told(self.limit, world, f"{self.side} ")
        return f"{criterion(self.name)} {'often enough' if self.name == 'arrival' else 'too often'}"

    def _amount(self, value: float, world: str) -> str:
        """Return three significant digits and the unit, or a percentage for a share."""
        unit = measured_in(world).get(self.name, "")
        return f"{value:.3g} {unit}" if unit else f"{100 * value:.3g} %"


def bound_tests(
    policy: Outcomes, bounds: Sequence[Bound], pass_error: float = 0.05, fail_error: float = 0.05
) -> tuple[BoundTest, ...]:
    """Test every bound; at-fault and struck collisions apart, since the ego causes the first.

    All must pass, so each may have the whole pass error (intersection-union). One that fails is
    enough to fail, so each has its part of the fail error (Bonferroni). Bounds of shares are exact,
    because error rates are guaranteed: Wilson's lower bound of a rare event errs up to three times
    as often as its level (docs/audit.md).

    Args:
        policy: Episodes of the driver.
        bounds: Bounds to test, at least one.
        pass_error: Error of a wrong pass of each test.
        fail_error: Error of a wrong fail of all tests together.

    Returns:
        A test for each bound, in their order.
    """
    tests = []
    fail_error = fail_error / len(bounds)
    for bound in bounds:
        least = bound.side == "at least"
        limit = bound.limit
        errors = (pass_error, fail_error) if least else (fail_error, pass_error)
        values = policy.episodes[bound.quantity]
        inside = values if bound.range is None else values.clip(*bound.range)
        share = float(inside.mean())
        error = pass_error if (share >= limit if least else share <= limit) else fail_error
        if bound.range is None:
            count = int(values.sum())
            # A one-sided bound at an error is an end of the two-sided interval at twice that error.
            low, high = (
                intervals.clopper_pearson(count, len(values), 1.0 - 2.0 * end)[row]
                for row, end in enumerate(errors, 1)
            )
            # Near 0 and 1 a share varies little: the deviation at the limit avoids a small number.
            deviation = max(chance * (1.0 - chance) for chance in (share, limit)) ** 0.5
            needed = intervals.episodes_needed(share - limit, deviation, error)
        else:
            count = int((inside != values).sum())
            low, high, needed = _by_betting(inside, bound, errors, error)
        holds = low >= limit if least else high <= limit
        decision = Decision.of(holds, high < limit if least else low > limit)
        counted = (limit, count, len(values), share, low, high, pass_error, fail_error, needed)
        tests.append(BoundTest(bound.quantity, decision, bound.side, *counted))
    return tuple(tests)


def _by_betting(
    values: Float[np.ndarray, " episode"], bound: Bound, errors: tuple[float, float], error: float
) -> tuple[float, float, int | None]:
    """Return both bounds of a mean, and the episodes that would decide at an error."""
    least, most = bound.range or (0.0, 1.0)
    span = most - least
    at_least = bound.side == "at least"
    over = values - least, bound.limit - least
    under = most - values, most - bound.limit
    ends = []
    for (rows, margin), between, end in zip(
        (under, over), (not at_least, at_least), errors, strict=True
    ):
        means = betting.levels(margin, span, between)
        ends.append(float(betting.bounds_by_betting(rows[None], means, span, end)[0]))
    rows, margin = over if values.mean() <= bound.limit else under
    needed = betting.episodes_by_betting(rows, margin, span, error, intervals.POWER)
    return most - ends[0], least + ends[1], needed


MOST_CUT = 0.01
"""Largest share of a driver's episodes that limits of rewards or effects may change. What lies
beyond them is not tested, and an end inside of usual episodes chooses the result."""


@dataclass(frozen=True)
class Cut:
    """Declared limits of a reward or an effect of an episode, and the episodes that they change."""

    path: str  # of the field
    words: str  # what is counted from where to where
    episodes: tuple[int, ...]  # number of changed episodes of each driver


def cuts_of(profile: Profile, drivers: Sequence[Outcomes]) -> list[Cut]:
    """Return the declared limits of rewards and effects, with the episodes that they change.

    Args:
        profile: The declaration.
        drivers: Drivers before rewards and effects are clipped.
    """
    clip = profile.clip
    cuts = list[Cut]()
    if clip is not None:
        (least, social), (most, largest) = clip.ends
        words = f"R_env of an episode from {least:g} to {most:g} and R_social from {social:g} to "
        changed = [(row.clipped(clip).totals != row.totals).any(axis=1) for row in drivers]
        counts = tuple(int(episodes.sum()) for episodes in changed)
        cuts.append(Cut(CLIP, f"{words}{largest:g}", counts))
    for quantity, ends in {bound.quantity: bound.range for bound in profile.caused}.items():
        if ends is not None:
            unit = measured_in(profile.scenario.world)[quantity]
            words = f"the {quantity} of an episode from {ends[0]:g} to {ends[1]:g} {unit}"
            values = [row.episodes[quantity] for row in drivers]
            counts = tuple(int((row.clip(*ends) != row).sum()) for row in values)
            cuts.append(Cut(f"{CAUSED}.{quantity}_range", words, counts))
    return cuts


def unclipped(bound: Bound, driver: Outcomes) -> Bound:
    """Return a bound whose range holds every episode of a driver."""
    if bound.range is None:
        return bound
    values = driver.episodes[bound.quantity]
    low = min(bound.range[0], float(values.min()))
    high = max(bound.range[1], float(values.max()))
    return replace(bound, range=(low, high))


def faults_of_limits(profile: Profile, policy: Outcomes, best: Outcomes) -> list[str]:
    """Return why declared limits of rewards and effects, not the driving, may have given a pass.

    Args:
        profile: The declaration.
        policy: Episodes of the policy, before rewards and effects are clipped.
        best: Episodes of the best reference at the declared angle, not clipped either.

    Returns:
        A sentence for each limit that changes too many episodes, and for each mean that keeps its
        limit by the cut alone.
    """
    faults = list[str]()
    for cut in cuts_of(profile, [policy, best]):
        of = ("the policy", "the best reference driver")
        for name, count in zip(of, cut.episodes, strict=True):
            if count > MOST_CUT * len(policy.totals):
                faults.append(
                    f"The declaration counts {cut.words}, which changes {count:,} of "
                    f"{len(policy.totals):,} episodes of {name} (at most {100 * MOST_CUT:g} % may "
                    "be changed): what lies beyond is not tested. Declare wider limits."
                )
                break
    clip = profile.clip
    if clip is not None and not profile.losses_decide:
        regret, cut_regret = (
            float(drivers[0].values(profile.angle).mean() - drivers[1].values(profile.angle).mean())
            for drivers in ((best, policy), (best.clipped(clip), policy.clipped(clip)))
        )
        if cut_regret <= profile.margin.regret < regret:
            faults.append(
                f"With every episode counted as it is, the policy earns {regret:.3g} less than the "
                f"best reference driver ({profile.margin.regret:g} less is allowed)."
            )
    for bound in profile.caused:
        values = policy.episodes[bound.quantity]
        mean = float(values.mean())
        cut_mean = mean if bound.range is None else float(values.clip(*bound.range).mean())
        if _keeps(bound, cut_mean) and not _keeps(bound, mean):
            unit = measured_in(profile.scenario.world)[bound.quantity] or "of episodes"
            faults.append(
                f"With every episode counted as it is, the mean {bound.quantity} is {mean:.3g} "
                f"{unit}, and {bound.side} {bound.limit:g} is declared."
            )
    return faults


def _keeps(bound: Bound, mean: float) -> bool:
    """Whether a mean keeps a bound's limit."""
    return mean >= bound.limit if bound.side == "at least" else mean <= bound.limit


CHECKED = 1_000
"""Episodes of the best driver of an angle, on fixed seeds, against which bounds are checked."""


def faults_of_declaration(profile: Profile, episodes: int = CHECKED) -> dict[str, str]:
    """Return why a declaration can't be shown, by field.

    The best driver of the declared angle fails a bound, and every policy of that angle would, or
    the width has no end that could be tested. Where no such driver is known, bounds aren't checked
    (`unkept`).

    Args:
        profile: The declaration.
        episodes: Number of episodes of the driver.
    """
    faults = _faults_of_bounds(profile, episodes)
    width = profile.margin.width
    if width is not None and width > max(profile.angle, LAST_DIRECTION - profile.angle):
        faults["margin.width"] = (
            f"a width of {width:g} degrees has no end from 0 to {LAST_DIRECTION:g} degrees, so "
            "that every direction is within it: declare a smaller one"
        )
    return faults


def unkept(profile: Profile, episodes: int = CHECKED) -> str:
    """Return why no reference driver of the world would pass, in a line; "" if one may.

    It is of worlds that have no dial or optimum; an honest policy may be better than all.

    Args:
        profile: The declaration.
        episodes: Number of episodes of each driver.
    """
    name = profile.scenario.world
    if (base(name) not in KNOWN and not is_recorded(name)) or profile.losses_decide:
        return ""
    world = profile.world()
    if world.is_exact or shipped_dial(world, [0.0]):
        return ""
    course = drive.Course(world, episode_seeds(0, episodes), measured=profile.effects)
    unknown = {"kind": "", "source": "", "sha256": ""}
    with contextlib.ExitStack() as closing:
        others = resolve_references(world, (), unknown, Trust(), closing, ())
        driven = drive_references(course, others.drivers)
    broken = {
        row.name: [
            f"{test.told(test.share, name)} ({test.limit_told(name)} asked for)"
            for test in bound_tests(row, profile.bounds)
            if test.decision is Decision.FAIL
        ]
        for row in driven
    }
    nearest = min(broken, key=lambda driver: len(broken[driver]), default="")
    if not broken or not broken[nearest]:
        return ""
    return (
        f"none of {len(broken)} reference drivers keeps these limits in {episodes:,} episodes; the "
        f"nearest, {nearest}: {'; '.join(broken[nearest])}"
    )


def _faults_of_bounds(profile: Profile, episodes: int) -> dict[str, str]:
    if base(profile.scenario.world) not in KNOWN or profile.losses_decide:
        return {}
    angle = profile.angle
    name = profile.scenario.world
    world = profile.world()
    best = None
    course = drive.Course(world, episode_seeds(0, episodes), measured=profile.effects)
    if world.is_exact:
        optimum = driver_of(drivers_of(drive.exact_optima(course)), angle)
        best = optimum and optimum.outcomes
    elif angle <= 90.0 and (dial := shipped_dial(world, [angle])):
        best = course.drive(dial[0][0])
    if best is None:
        return {}
    faults = {
        cut.path: (
            f"{cut.words} changes {cut.episodes[0]:,} of {episodes:,} episodes of the best driver "
            f"of {angle:g} degrees (at most {100 * MOST_CUT:g} % may be changed): declare wider "
            "limits"
        )
        for cut in cuts_of(profile, [best])
        if cut.episodes[0] > MOST_CUT * episodes
    }
    bounds = [unclipped(bound, best) for bound in profile.bounds]
    return faults | {
        bound.path: (
            f"the best driver of {angle:g} degrees "
            f"{test.told(test.share, name, of=f'{episodes:,} episodes')}, and the "
            f"{'floor' if test.name in CRITERIA else 'bound'} asks for {test.limit_told(name)}: "
            "declare another limit"
        )
        for bound, test in zip(bounds, bound_tests(best, bounds), strict=True)
        if test.decision is Decision.FAIL
    }
