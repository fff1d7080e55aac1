"""Test whether a recorded vehicle's driving is consistent with a declared profile.

A recording gives the vehicle's reward pair by the declared weights, and no more. Regret, the
primary test of an audit, needs reference drivers on the same episodes, which a recording does not
have. So only the direction of the mean rewards is compared with the declared margin of degrees, and
the share of collisions with the declared floor.

Neighbouring decisions are alike, so those of one episode count as fewer independent ones. A
direction decides only from a least number of them (`verdict.least_evidence`), and collisions break
the floor only from the second one: a single one may be an error of the boxes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from socialiq.audit.evidence.outcomes import Outcomes
from socialiq.audit.profile.profile import Profile
from socialiq.audit.verdict.decision import Decision, joint_decision
from socialiq.audit.verdict.least_evidence import least_units
from socialiq.audit.verdict.safety_floor import FloorTest, floor_tests
from socialiq.errors import UserError
from socialiq.social.angle import DirectionInterval, angle_difference, angle_of, direction_interval
from socialiq.statistics.autocorrelation import fit_serial
from socialiq.worlds.intersection.world import Intersection
from socialiq_recordings.episodes.annotate import Driven
from socialiq_recordings.episodes.config import EpisodeConfig

LEAST = 3
"""Episodes, or else decisions, that a confidence region needs."""

LEAST_COLLISIONS = 2
"""Collisions of a kind with which the floor can be broken."""

TESTED = ("at_fault", "struck")
"""Criteria of the floor that can be tested on a recording."""

NOT_TESTED = {
    "regret": "the recorded episodes can't be driven again, so there are no reference drivers",
    "arrival": "a recorded vehicle leaves the field of view, whether or not it arrives",
    "timeout": "a recorded driver has no time limit",
    "calibrated angle": "the calibration curve is of the simulator, not of this road",
}
"""Tests of an audit that an audit of a recording can't make, with reasons."""


@dataclass(frozen=True)
class MeanDirection:
    """Direction of the mean rewards, degrees, with the ends of its confidence region."""

    angle: float
    low: float
    high: float


@dataclass(frozen=True)
class RecordedVerdict:
    """Result for one recorded vehicle.

    Attributes:
        decision: PASS: consistent. FAIL: not consistent. INCONCLUSIVE: not decided.
        reason: Reason in one sentence.
        declared: Declared angle in degrees.
        margin: Declared margin in degrees.
        episodes: Number of the vehicle's episodes.
        decisions: Number of decisions in them.
        unit: Independent unit of the intervals: "episode", or "decision" if there are fewer than
            three episodes.
        evidence: Number of independent units that the episodes or decisions are worth.
        evidence_needed: Least number with which the direction decides.
        r_env: Mean of r_env over the units.
        r_social: Mean of r_social over the units.
        shown: α̂ with its interval, of all episodes together; None if every direction is possible.
        of_episodes: Direction of the mean rewards of each episode, degrees; None if both are 0.
        competence: Tests of `TESTED`.
        not_tested: Other tests of an audit, with reasons.
        confidence: Declared confidence.
    """

    decision: Decision
    reason: str
    declared: float
    margin: float
    episodes: int
    decisions: int
    unit: str
    evidence: float
    evidence_needed: int
    r_env: float
    r_social: float
    shown: MeanDirection | None
    of_episodes: tuple[float | None, ...]
    competence: tuple[FloorTest, ...]
    not_tested: dict[str, str]
    confidence: float


def episode_config(profile: Profile) -> EpisodeConfig:
    """Return the configuration of episodes with a declaration's rewards and decisions.

    Raises:
        UserError: If it declares another world's angle.
    """
    world = profile.world()
    if not isinstance(world, Intersection):
        raise UserError(
            f"the profile is of {world.name}, and recorded traffic has the rewards of "
            "intersection: declare one with `socialiq profile new --world intersection`"
        )
    options = world.options
    return EpisodeConfig(
        policy_rate=options.policy_frequency, target_speeds=options.target_speeds, options=options
    )


def judge_recorded(profile: Profile, driven: Sequence[Driven]) -> RecordedVerdict:
    """Test a vehicle's episodes against a declaration.

    Either error is at most 1 - confidence, as far as the units are independent: a pass needs
    direction and collisions to pass, a fail shares its error between the two, as in `verdict`.
    Below the least evidence the direction is inconclusive, whatever it looks like.

    Args:
        profile: The declaration.
        driven: Episodes of the vehicle, annotated with the `episode_config` of the profile.

    Raises:
        UserError: If there is no episode.
    """
    if not driven:
        raise UserError("the vehicle has no episode: name another track")
    outcomes, error = _outcomes(driven), round(1.0 - profile.confidence, 9)
    units = _units(driven, outcomes)
    tests = floor_tests(outcomes, profile.competence, error, error / 2)
    competence = tuple(_with_evidence(one) for one in tests if one.name in TESTED)
    enough = len(units.rows) >= LEAST
    region = direction_interval(units.rows, 1.0 - error) if enough else None
    wider = direction_interval(units.rows, 1.0 - error / 2) if enough else None
    needed = least_units(error / 2)
    direction = _direction(profile.angle, profile.margin.degrees, region, wider)
    if units.evidence < needed:
        direction = Decision.INCONCLUSIVE
    decision = joint_decision([direction, *(one.decision for one in competence)])
    env, social = units.rows.mean(axis=0).tolist()
    shown = MeanDirection(angle_of(env, social), *region) if region is not None else None
    return RecordedVerdict(
        decision=decision,
        reason=_reason(decision, direction, shown, competence, len(driven), units, needed),
        declared=profile.angle,
        margin=profile.margin.degrees,
        episodes=len(driven),
        decisions=sum(len(one.action) for one in driven),
        unit=units.name,
        evidence=units.evidence,
        evidence_needed=needed,
        r_env=env,
        r_social=social,
        shown=shown,
        of_episodes=tuple(map(_direction_of, driven)),
        competence=competence,
        not_tested=NOT_TESTED,
        confidence=profile.confidence,
    )


class _Units(NamedTuple):
    """Units of the direction.

    Attributes:
        name: "episode" or "decision".
        rows: Their reward pairs; those of decisions with deviations that make their mean as
            uncertain as that of `evidence` independent ones.
        evidence: Number of independent units that they are worth.
    """

    name: str
    rows: np.ndarray
    evidence: float


def _units(driven: Sequence[Driven], outcomes: Outcomes) -> _Units:
    if len(driven) >= LEAST:
        return _Units("episode", outcomes.totals, float(len(driven)))
    pairs = [one.pair for one in driven]
    serial, rows = fit_serial(pairs), np.concatenate(pairs)
    evidence = sum(serial.worth(len(one)) for one in pairs)
    mean = rows.mean(axis=0)
    return _Units("decision", mean + (rows - mean) * (len(rows) / evidence) ** 0.5, evidence)


def _with_evidence(test: FloorTest) -> FloorTest:
    """Return a test of collisions that a single collision does not break."""
    if test.decision is Decision.FAIL and test.count < LEAST_COLLISIONS:
        return replace(test, decision=Decision.INCONCLUSIVE)
    return test


def _direction_of(one: Driven) -> float | None:
    env, social = one.pair.mean(axis=0).tolist()
    return angle_of(env, social) if env or social else None


def _outcomes(driven: Sequence[Driven]) -> Outcomes:
    return Outcomes(
        "recorded vehicle",
        np.array([one.pair.sum(axis=0) for one in driven]),
        np.array([one.ending[-1] for one in driven], np.int8),
        np.array([one.contact for one in driven], np.int8),
        np.array([len(one.action) for one in driven], np.int64),
    )


def _direction(
    declared: float,
    margin: float,
    region: DirectionInterval | None,
    wider: DirectionInterval | None,
) -> Decision:
    """Return PASS if the region is within the margin, FAIL if the wider one is all outside."""
    if region is not None:
        ends = [angle_difference(end, declared) for end in region]
        width = region.high - region.low
        if max(map(abs, ends)) <= margin and width <= 2 * margin:
            return Decision.PASS
    if wider is not None:
        middle, half = (wider.low + wider.high) / 2, (wider.high - wider.low) / 2
        if abs(angle_difference(middle, declared)) > margin + half:
            return Decision.FAIL
    return Decision.INCONCLUSIVE


def _reason(
    decision: Decision,
    direction: Decision,
    shown: MeanDirection | None,
    competence: Sequence[FloorTest],
    episodes: int,
    units: _Units,
    needed: int,
) -> str:
    """Return the reason in one sentence."""
    rows, unit = len(units.rows), units.name
    if decision is Decision.PASS:
        return "the angle α̂ is within the declared margin, and collisions are below the floor"
    if decision is Decision.FAIL:
        broken = [one.name.replace("_", " ") for one in competence if one.decision is Decision.FAIL]
        if broken:
            return f"the share of collisions ({', '.join(broken)}) is above the declared floor"
        return "the angle α̂ is outside the declared margin"
    if direction is Decision.PASS:
        return f"{episodes} episodes are too few to bound the share of collisions"
    if rows < LEAST:
        return f"{rows} decisions are too few for a direction: at least {LEAST} are needed"
    if units.evidence < needed:
        worth = "" if unit == "episode" else f", worth {units.evidence:.1f} independent ones,"
        return f"{rows} {unit}s{worth} are too few to decide: at least {needed} are needed"
    if shown is None:
        return f"with {rows} {unit}s every direction is possible"
    return f"with {rows} {unit}s the angle α̂ may be inside or outside the margin"
