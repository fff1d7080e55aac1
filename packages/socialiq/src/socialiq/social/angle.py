"""Social angle: weights, the score R(α), the empirical angle of behaviour, and arcs of angles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64

from socialiq.errors import UserError
from socialiq.physics import wrapped
from socialiq.statistics.bootstrap import resample_rows
from socialiq.statistics.hotelling import hotelling_region
from socialiq.types import ByClass, RewardPair


def check_angle(angle: float) -> float:
    """Return a social angle in degrees if it lies in [0, 360), the range of thesis 4.2.

    Raises:
        UserError: If it is not finite or outside this range.
    """
    if not math.isfinite(angle) or not 0.0 <= angle < 360.0:
        raise UserError(f"angle {angle:g} is outside [0, 360) degrees: 0 egoistic, 90 altruistic")
    return float(angle)


def weights(angle: float) -> RewardPair:
    """Return the weights (cos α, sin α) of an angle in degrees (Eq 4.3).

    cos 90° is the float64 6.1e-17, not 0. The thesis' altruistic expert of the 5x5 world depends
    on that residue (docs/worlds/crossing5.md), so it is kept; `exact_weights` gives exact zeros.
    """
    radians = np.deg2rad(angle)
    return RewardPair(env=float(np.cos(radians)), social=float(np.sin(radians)))


def exact_weights(angle: float) -> RewardPair:
    """Return (cos α, sin α) with exact zeros and ones at multiples of 90 degrees."""
    env, social = weights(angle)
    if angle % 90 == 0:
        return RewardPair(env=float(round(env)), social=float(round(social)))
    return RewardPair(env=env, social=social)


def check_class_angle(angle: float) -> float:
    """Return a class angle in degrees if it lies in [0, 90]: no class may be harmed on purpose.

    Raises:
        UserError: If it is not finite or outside this range.
    """
    if not 0.0 <= angle <= 90.0:
        raise UserError(
            f"class angle {angle:g} is outside [0, 90] degrees: 0 vehicles, 90 road users who can "
            "be hurt"
        )
    return float(angle)


def class_weights(class_angle: float) -> ByClass:
    """Return the weights (cos b, sin b) of the classes in r_social, b in degrees.

    They are exact zeros and ones at 0 and 90 degrees.
    """
    return ByClass(*exact_weights(check_class_angle(class_angle)))


def direction_of(angle: float, class_angle: float | None = None) -> RewardPair:
    """Return the exact weights of r_env and r_social at an angle.

    Args:
        angle: Angle a in degrees.
        class_angle: Class angle b in degrees, in [0, 90]; None for an r_social without classes.

    Returns:
        (cos a, sin a); with a class angle (cos a, sin a cos b, sin a sin b), the weights of r_env
        and each class.

    Raises:
        UserError: If the class angle is out of range.
    """
    env, social = exact_weights(angle)
    if class_angle is None:
        return RewardPair(env, social)
    return RewardPair(env, ByClass(*(social * weight for weight in class_weights(class_angle))))


def angle_of(env: float, social: float) -> float:
    """Return the empirical angle α̂ = atan2(R_social, R_env) of behaviour (thesis 5.4).

    Args:
        env: Mean R_env over episodes.
        social: Mean R_social over episodes: α̂ is an angle of means, not a mean of angles.

    Returns:
        Degrees in (-180, 180].
    """
    degrees = math.degrees(math.atan2(social, env))
    # atan2 gives -180 for a social return of -0.0, or for a return below rounding.
    return 180.0 if degrees == -180.0 else degrees


def pooled_angle(env: Any, social: Any) -> tuple[float, float, float]:
    """Return the angle of the mean of several policies, and the range of their angles about it.

    Args:
        env: Mean R_env of each policy.
        social: Mean R_social of each policy.

    Returns:
        The angle, and the least and the largest of the policies', in degrees and without a step of
        360 between them.
    """
    angle = angle_of(sum(env) / len(env), sum(social) / len(social))
    off = [angle_difference(angle_of(*pair), angle) for pair in zip(env, social, strict=True)]
    return angle, angle + min(off), angle + max(off)


def angle_difference(a: Any, b: Any) -> Any:
    """Return the signed difference a - b of angles.

    Args:
        a: Angle or array of angles, in degrees.
        b: Angle or array of angles that fits `a`, in degrees.

    Returns:
        Degrees in [-180, 180).
    """
    difference = wrapped(a - b, 180.0)
    # The remainder of a very small negative number rounds up to 360.
    return difference - 360.0 * (difference == 180.0)


def score(weights: RewardPair, rewards: RewardPair) -> Any:
    """Return R(α) = cos α · r_env + sin α · r_social (Eq 4.3).

    Args:
        weights: (cos α, sin α), scalars or traced arrays; with parts by class where r_social has
            them.
        rewards: Rewards or returns of any shape.

    Returns:
        R(α), in the shape of the rewards.
    """
    env, *others = weights.parts
    r_env, *r_others = rewards.parts
    total = env * r_env
    for weight, reward in zip(others, r_others, strict=True):
        total = total + weight * reward
    return total


class AngleEstimate(NamedTuple):
    """Empirical angle and its percentile interval, in degrees.

    `low` and `high` are `angle` plus wrapped deviations, so they may leave (-180, 180].
    """

    angle: float
    low: float
    high: float
    env: float
    social: float


def estimate_angle(
    env: Float[np.ndarray, " episodes"],
    social: Float[np.ndarray, " episodes"],
    seed: int,
    confidence: float = 0.95,
    resamples: int = 2000,
) -> AngleEstimate:
    """Estimate α̂ from episode totals, with a seeded percentile bootstrap over episodes.

    Each resample draws whole episodes, so the pair of an episode's sums stays together; its mean
    vector gives an angle, whose deviation from α̂ is wrapped before the percentiles are taken.

    Args:
        env: Sum of r_env of each episode.
        social: Sum of r_social of each episode.
        seed: Seed of the bootstrap.
        confidence: Confidence of the interval.
        resamples: Number of resamples.

    Raises:
        UserError: If there are no episodes or a total is not finite.
    """
    if np.shape(env) != np.shape(social):
        raise UserError("an angle needs both totals of each episode: give as many of each")
    totals = np.stack([env, social], axis=1).astype(np.float64)
    if len(totals) == 0 or not np.isfinite(totals).all():
        raise UserError("an angle needs at least one episode, and finite reward totals")
    mean_env, mean_social = totals.mean(axis=0)
    angle = angle_of(mean_env, mean_social)
    ends = interval_around(angle, resampled_means(totals, seed, resamples), confidence)
    return AngleEstimate(angle, *ends, float(mean_env), float(mean_social))


def resampled_means(
    totals: Float64[np.ndarray, "episode 2"], seed: int, resamples: int
) -> Float64[np.ndarray, "resample 2"]:
    """Return the mean totals of bootstrap resamples of episodes.

    Args:
        totals: Sums of (r_env, r_social) of each episode.
        seed: Seed of the bootstrap.
        resamples: Number of resamples.
    """
    blocks = resample_rows(len(totals), resamples, seed)
    return np.concatenate([totals[rows].mean(axis=1) for rows in blocks])


def interval_around(
    angle: float, means: Float64[np.ndarray, "resample 2"], confidence: float
) -> tuple[float, float]:
    """Return the percentile interval of the directions of means, around an angle.

    Args:
        angle: The angle, in degrees.
        means: Mean (R_env, R_social) of each resample.
        confidence: Confidence of the interval.

    Returns:
        The ends in degrees: the angle plus wrapped deviations, so they may leave (-180, 180].
    """
    off = angle_difference(np.degrees(np.arctan2(means[:, 1], means[:, 0])), angle)
    low, high = angle + np.quantile(off, [(1 - confidence) / 2, (1 + confidence) / 2])
    return float(low), float(high)


_AROUND = 3600  # points of the ellipse whose directions are taken


def direction_interval(
    pairs: Float64[np.ndarray, "row 2"], confidence: float
) -> tuple[float, float] | None:
    """Return the directions in which Hotelling's T² region of the mean is seen from the origin.

    The region covers the whole vector, so the directions are covered at least as often as it is.

    Args:
        pairs: At least three independent rows.
        confidence: Confidence of the region.

    Returns:
        The ends in degrees, unwrapped around the direction of the mean. None if the origin is
        inside: then no direction is excluded.
    """
    region = hotelling_region(pairs, confidence)
    if region.holds_origin:
        return None
    turn = np.linspace(0.0, 2 * np.pi, _AROUND, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    edge = region.mean + (circle * region.halves) @ region.axes.T
    angle = angle_of(*region.mean.tolist())
    off = angle_difference(np.degrees(np.arctan2(edge[:, 1], edge[:, 0])), angle)
    return angle + float(off.min()), angle + float(off.max())


@dataclass(frozen=True)
class Arc:
    """Arc from `low` in [0, 360) counter-clockwise to `high`, at most 360 further; degrees."""

    low: float
    high: float

    def holds(self, angle: float) -> bool:
        """Whether an angle is on the arc, including its ends."""
        return (angle - self.low) % 360.0 <= self.high - self.low


def complement(centres: Sequence[float], halves: Sequence[float]) -> tuple[Arc, ...]:
    """Return the complement on the circle of open arcs.

    Args:
        centres: Centre of each arc, in degrees.
        halves: Half-width of each arc, in degrees; an arc of none or less is left out.

    Returns:
        Closed arcs in the order of their low ends; the whole circle is an arc from 0 to 360.
    """
    spans = sorted(
        ((centre - half) % 360.0, 2.0 * half)
        for centre, half in zip(centres, halves, strict=True)
        if half > 0.0
    )
    if not spans:
        return (Arc(0.0, 360.0),)
    free = []
    reached = max(low + width for low, width in spans) - 360.0  # end of the arcs that wrap round
    for low, width in spans:
        if low >= reached:
            free.append((reached, low))
        reached = max(reached, low + width)
    arcs = [Arc(low % 360.0, low % 360.0 + high - low) for low, high in free]
    return tuple(sorted(arcs, key=lambda arc: arc.low))


def arcs_of_grid(inside: Bool[np.ndarray, " angle"], step: float) -> tuple[Arc, ...]:
    """Return the arcs of neighbouring angles that are inside a set.

    Args:
        inside: Whether each of the angles 0, step, 2 step, ... of the whole circle is inside.
        step: Step of the grid, in degrees.

    Returns:
        Arcs in the order of their low ends; the whole circle is an arc from 0 to 360.
    """
    if inside.all():
        return (Arc(0.0, 360.0),)
    turned = np.roll(inside, -1)
    ends = np.flatnonzero(inside & ~turned)
    starts = np.flatnonzero(~inside & turned) + 1
    arcs = []
    for start in (starts % len(inside)).tolist():
        length = int(((ends - start) % len(inside)).min())
        arcs.append(Arc(start * step, (start + length) * step))
    return tuple(sorted(arcs, key=lambda arc: arc.low))
