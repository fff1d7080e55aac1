"""Angles of a behaviour: compatible with it, calibrated (two one-sided tests), followed by context.

α̂ = atan2(R_social, R_env) of the best policy for an angle is not that angle (docs/theory.md). The
calibrated angle of a policy is the angle at which reference drivers of known angles have its α̂.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int64

from socialiq.audit.evidence.outcomes import Evidence, Outcomes
from socialiq.audit.verdict.regret import Decision, Regrets
from socialiq.evaluation.context import ContextLosses
from socialiq.social.angle import Arc, angle_difference, arcs_of_grid, complement
from socialiq.social.angle_rule import AngleRule, angle_words
from socialiq.statistics.bootstrap import resampled_means
from socialiq.statistics.comparisons import paired_difference

_DECIMALS = 6  # of an angle: neighbouring intervals share their ends up to rounding

_LEVEL = 1e-9  # degrees; smaller differences of α̂ are rounding errors


class Points(NamedTuple):
    """Points of the curve, by rising angle in degrees, with the number of each one's reference."""

    angle: Float[np.ndarray, " point"]
    driver: Int64[np.ndarray, " point"]


class Preimage(NamedTuple):
    """Angles at which the curve has a given α̂: the hull of all of them, by resample.

    If no point of the curve has it, they are the nearest point.
    """

    low: Float[np.ndarray, " resample"]  # degrees
    high: Float[np.ndarray, " resample"]
    beyond: np.ndarray  # whether no point of the curve has this α̂


def points_of(references: tuple[Outcomes, ...], declared: float) -> Points:
    """Return the curve over the quadrant of the declared angle, in degrees.

    Other quadrants have the same α̂ for other trade-offs. A reference that is optimal over an
    interval gives its two ends, between which the curve is flat; one without an angle gives none.
    """
    first = 90.0 * max(0, math.ceil(declared / 90.0) - 1)  # 90 is the end of the first
    rows: list[tuple[float, float, int]] = []
    for number, reference in enumerate(references):
        for turn in (-360.0, 0.0, 360.0) if reference.angles else ():
            low, high = (
                round(end + turn, _DECIMALS) for end in (reference.angles[0], reference.angles[-1])
            )
            clipped = {max(low, first), min(high, first + 90.0)}
            if max(low, first) <= min(high, first + 90.0):
                rows += [(angle, (low + high) / 2, number) for angle in sorted(clipped)]
    rows.sort()
    return Points(
        np.array([angle for angle, _, _ in rows], np.float64),
        np.array([number for _, _, number in rows], np.int64),
    )


def preimage(
    angle: Float[np.ndarray, " point"],
    alpha: Float[np.ndarray, "resample point"],
    sought: Float[np.ndarray, " resample"],
) -> Preimage:
    """Invert the curve, taken as straight lines between its points, of which there are two or more.

    Where it is flat at the given height, the result is the whole flat piece; where it turns back,
    the hull of all solutions. α̂ of the points, and those to invert, are unwrapped along the curve.
    """
    low, high = np.full(len(sought), np.inf), np.full(len(sought), -np.inf)
    for left in range(len(angle) - 1):
        y, z = alpha[:, left], alpha[:, left + 1]
        inside = (np.minimum(y, z) - _LEVEL <= sought) & (sought <= np.maximum(y, z) + _LEVEL)
        flat = np.abs(z - y) <= _LEVEL
        way = np.divide(sought - y, z - y, out=np.zeros_like(y), where=~flat).clip(0.0, 1.0)
        at = angle[left] + way * (angle[left + 1] - angle[left])
        low = np.minimum(low, np.where(inside, np.where(flat, angle[left], at), np.inf))
        high = np.maximum(high, np.where(inside, np.where(flat, angle[left + 1], at), -np.inf))
    beyond = np.isinf(low)
    nearest = np.abs(alpha - sought[:, None]).argmin(axis=1)
    low = np.where(beyond, angle[nearest], low)
    return Preimage(low, np.where(beyond, angle[nearest], high), beyond)


_STEP = 1.0  # degrees of the band's grid
_FINE = 0.1  # degrees of the search for the smallest regret


@dataclass(frozen=True)
class CompatibleAngles:
    """Angles at which the policy's regret is within the margin, none if it is large everywhere.

    To the degree, it would surely pass at some angles, and possibly not fail at others. Any angle
    whose true regret exceeds the margin is among the first with a chance of at most the pass error;
    any whose true regret is within it is not among the second with one of at most the fail error.
    """

    arcs: tuple[Arc, ...]  # angles by the estimates
    surely: tuple[Arc, ...]
    possibly: tuple[Arc, ...]
    least_angle: float  # angle of the smallest regret (the first one), degrees
    least: float  # the regret there, reward per episode
    margin: float


def compatible_angles(
    regrets: Regrets, margin: float, pass_error: float = 0.05, fail_error: float = 0.05
) -> CompatibleAngles:
    """Return the angles compatible with the behaviour, and their band at these errors.

    The band is by the bootstrap even where a largest loss is declared: the declaration bounds the
    loss at the declared angle only, and the band doesn't decide. Towards reference k the regret is
    r_k cos(α - φ_k), with (r_k, φ_k) its mean gain in polar coordinates, so each reference excludes
    the open arc φ_k ± arccos(margin / r_k).
    """
    env, social = regrets.moments.mean.T
    length = np.hypot(env, social)
    large = length > margin
    centres = np.degrees(np.arctan2(social[large], env[large]))
    halves = np.degrees(np.arccos(margin / length[large]))
    grid = np.arange(0.0, 360.0, _STEP).tolist()
    within, beyond = np.array(
        [regrets.band(angle, margin, pass_error, fail_error) for angle in grid]
    ).T
    fine = np.deg2rad(np.arange(0.0, 360.0, _FINE))
    by_angle = np.max(env[:, None] * np.cos(fine) + social[:, None] * np.sin(fine), axis=0)
    return CompatibleAngles(
        arcs=complement(centres.tolist(), halves.tolist()),
        surely=arcs_of_grid(within, _STEP),
        possibly=arcs_of_grid(~beyond, _STEP),
        least_angle=round(int(by_angle.argmin()) * _FINE, 6),
        least=float(by_angle.min()),
        margin=margin,
    )


Status = Literal["calibrated", "no curve", "beyond the curve", "no direction"]


@dataclass(frozen=True)
class CurvePoint:
    """Angle of a reference and its α̂, both in degrees, α̂ unwrapped along the curve."""

    name: str
    angle: float
    shown: float


@dataclass(frozen=True)
class Calibration:
    """Whether the calibrated angle is equivalent to the declared one, in degrees.

    There is none if fewer than two references have an angle, the curve doesn't reach α̂, or α̂ itself
    isn't identified. The decision is PASS if [low, high] is within the declared angle plus or minus
    the margin, FAIL if it is outside, else INCONCLUSIVE; always INCONCLUSIVE unless calibrated. The
    nearest angles are the smallest and largest at which the curve has the estimated α̂: they differ
    where the curve is flat or turns back, and the angle is not identified between them.
    """

    status: Status
    decision: Decision
    declared: float
    margin: float
    nearest: tuple[float, float] | None
    low: float | None  # one-sided lower bound
    high: float | None  # one-sided upper bound
    error: float  # of each bound: Schuirmann's TOST at this level
    monotone: bool  # whether α̂ never falls along the curve
    curve: tuple[CurvePoint, ...]


def calibrate(
    evidence: Evidence,
    declared: float,
    margin: float,
    identified: bool,
    seed: int,
    error: float = 0.05,
    resamples: int = 2000,
) -> Calibration:
    """Invert the curve at the policy's α̂, both resampled together.

    The curve is measured on the policy's own episodes, so its error is part of the interval. Where
    it is flat over 30 degrees the interval is at least as wide: a policy there passes only with a
    margin of that width. Declared angle and margin are in degrees; `identified` says whether α̂ of
    the policy is (`Verdict.identifiability`); each one-sided test has the error.
    """
    points = points_of(evidence.references, declared)
    drivers = [*(evidence.references[number] for number in points.driver), evidence.policy]
    estimates = np.array([driver.mean for driver in drivers], np.float64)
    angles = np.degrees(np.arctan2(estimates[:, 1], estimates[:, 0]))
    alphas = np.unwrap(angles[:-1], period=360.0)
    rows = zip(drivers, points.angle.tolist(), alphas.tolist(), strict=False)
    curve = tuple(CurvePoint(driver.name, angle, alpha) for driver, angle, alpha in rows)
    monotone = bool((np.diff(alphas) >= -1e-9).all())

    status, undecided = "no curve" if identified else "no direction", Decision.INCONCLUSIVE
    unknown = Calibration(
        status, undecided, declared, margin, None, None, None, error, monotone, curve
    )
    if len(set(points.angle.tolist())) < 2 or not identified:
        return unknown
    middle = float(alphas.min() + alphas.max()) / 2
    centre = np.append(alphas, middle + angle_difference(float(angles[-1]), middle))
    means = resampled_means(np.stack([driver.totals for driver in drivers]), seed, resamples)
    resampled = np.degrees(np.arctan2(means[..., 1], means[..., 0]))
    resampled = centre + angle_difference(resampled, angles)
    at = preimage(points.angle, centre[None, :-1], centre[-1:])
    inverse = preimage(points.angle, resampled[:, :-1], resampled[:, -1])
    # An end of the curve may be inside the interval; if all of it is beyond, there is no angle.
    if bool(inverse.beyond.mean() > 1.0 - error):
        return replace(unknown, status="beyond the curve")
    low = float(np.quantile(inverse.low, error))
    high = float(np.quantile(inverse.high, 1.0 - error))
    first = declared + 360.0 * round((points.angle.mean() - declared) / 360.0)
    within = first - margin <= low and high <= first + margin
    outside = low > first + margin or high < first - margin
    return replace(
        unknown,
        status="calibrated",
        decision=Decision.PASS if within else Decision.FAIL if outside else undecided,
        nearest=(float(at.low[0]), float(at.high[0])),
        low=low,
        high=high,
    )


@dataclass(frozen=True)
class CandidateLoss:
    """Mean decision loss of a context at an angle in degrees, reward per episode.

    `compatible` says whether it is not significantly larger than the least one.
    """

    angle: float
    loss: float
    compatible: bool


@dataclass(frozen=True)
class FollowedAngle:
    """A policy in one context of a declared rule."""

    context: str  # the context in words
    declared: str  # its declared angle in words
    decisions: float  # mean number of decisions in an episode
    loss: float  # mean decision loss at the declared angle, reward per episode
    low: float  # lower end of its two-sided interval (Student)
    high: float  # upper end
    by_angle: tuple[CandidateLoss, ...]  # the policy follows the least one


def followed_angles(
    rule: AngleRule, losses: ContextLosses, candidates: tuple[float, ...], confidence: float
) -> tuple[FollowedAngle, ...]:
    """Return the angle that a policy follows in each context, by its losses at the candidates.

    The confidence is that of the intervals, and of each comparison of two angles.
    """
    followed = []
    for number, context in enumerate(rule.contexts):
        by_angle, declared = losses.by_angle[:, number], losses.declared[:, number]
        least = by_angle[:, int(by_angle.mean(axis=0).argmin())]
        interval = paired_difference(declared, np.zeros_like(declared), confidence)
        rows = [
            CandidateLoss(
                angle,
                float(loss.mean()),
                bool(paired_difference(loss, least, confidence).low <= 0.0),
            )
            for angle, loss in zip(candidates, by_angle.T, strict=True)
        ]
        followed.append(
            FollowedAngle(
                context=context,
                declared=angle_words(rule.angles[number]),
                decisions=float(losses.decisions[:, number].mean()),
                loss=interval.mean,
                low=interval.low,
                high=interval.high,
                by_angle=tuple(rows),
            )
        )
    return tuple(followed)
