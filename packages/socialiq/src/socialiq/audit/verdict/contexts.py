"""Angle that a policy follows in each context of a declared rule; reported, not decisive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from socialiq.evaluation.context import ContextLosses
from socialiq.social.angle_rule import AngleRule, angle_words
from socialiq.statistics.comparisons import paired_difference


@dataclass(frozen=True)
class CandidateLoss:
    """Decision loss of a context at an angle in degrees, reward per episode.

    Attributes:
        angle: The angle.
        loss: Mean loss.
        compatible: Whether it is not significantly larger than the least one.
    """

    angle: float
    loss: float
    compatible: bool


@dataclass(frozen=True)
class FollowedAngle:
    """A policy in one context of a declared rule.

    Attributes:
        context: The context in words.
        declared: Its declared angle in words.
        decisions: Mean number of decisions in an episode.
        loss: Mean decision loss at the declared angle, reward per episode.
        low: Lower end of its two-sided interval (Student).
        high: Upper end.
        by_angle: Loss at other angles: the policy follows the angle of the least one.
    """

    context: str
    declared: str
    decisions: float
    loss: float
    low: float
    high: float
    by_angle: tuple[CandidateLoss, ...]


def followed_angles(
    rule: AngleRule, losses: ContextLosses, candidates: tuple[float, ...], confidence: float
) -> tuple[FollowedAngle, ...]:
    """Return the angle that a policy follows in each context.

    Args:
        rule: The declared rule.
        losses: Decision losses of the policy.
        candidates: Angles of `by_angle`, in degrees.
        confidence: Confidence of the intervals, and of each comparison of two angles.
    """
    found = []
    for number, context in enumerate(rule.contexts):
        by_angle, declared = losses.by_angle[:, number], losses.declared[:, number]
        least = by_angle[:, int(by_angle.mean(axis=0).argmin())]
        interval = paired_difference(declared, np.zeros_like(declared), confidence)
        rows = [
            CandidateLoss(
                angle,
                float(one.mean()),
                bool(paired_difference(one, least, confidence).low <= 0.0),
            )
            for angle, one in zip(candidates, by_angle.T, strict=True)
        ]
        found.append(
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
    return tuple(found)
