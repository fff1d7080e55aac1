"""Angles of a behaviour: compatible by regret, and followed in each context of a declared rule."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from socialiq.audit.verdict.regret import Regrets
from socialiq.evaluation.context import ContextLosses
from socialiq.social.angle import Arc, complement
from socialiq.social.angle_rule import AngleRule, angle_words
from socialiq.statistics.comparisons import paired_difference

_FINE = 0.1  # degrees of the search for the smallest regret


@dataclass(frozen=True)
class CompatibleAngles:
    """Angles at which the estimated regret is within the margin, none if it is large everywhere."""

    arcs: tuple[Arc, ...]
    least_angle: float  # angle of the smallest regret (the first one), degrees
    least: float  # the regret there, reward per episode
    margin: float


def compatible_angles(regrets: Regrets, margin: float) -> CompatibleAngles:
    """Return the angles compatible with the behaviour.

    Towards reference k the regret is r_k cos(α - φ_k), with (r_k, φ_k) its mean gain in polar
    coordinates, so each reference excludes the open arc φ_k ± arccos(margin / r_k).
    """
    env, social = regrets.moments.mean.T
    length = np.hypot(env, social)
    large = length > margin
    centres = np.degrees(np.arctan2(social[large], env[large]))
    halves = np.degrees(np.arccos(margin / length[large]))
    fine = np.deg2rad(np.arange(0.0, 360.0, _FINE))
    by_angle = np.max(env[:, None] * np.cos(fine) + social[:, None] * np.sin(fine), axis=0)
    return CompatibleAngles(
        arcs=complement(centres.tolist(), halves.tolist()),
        least_angle=round(int(by_angle.argmin()) * _FINE, 6),
        least=float(by_angle.min()),
        margin=margin,
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
        rows = list[CandidateLoss]()
        for angle, loss in zip(candidates, by_angle.T, strict=True):
            compatible = bool(paired_difference(loss, least, confidence).low <= 0.0)
            rows.append(CandidateLoss(angle, float(loss.mean()), compatible))
        words, count = angle_words(rule.angles[number]), float(losses.decisions[:, number].mean())
        declared_loss = (interval.mean, interval.low, interval.high)
        followed.append(FollowedAngle(context, words, count, *declared_loss, tuple(rows)))
    return tuple(followed)
