"""Several dials as the model of drivers, on their common scale, with decisions by their effect.

Which of the dials is the model is integrated out with the strength β. Actions that select the same
target speed are one candidate: which of them a dial names is arbitrary, and no recording shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.types import Row
from socialiq_recordings.trait.choice_model import Tabulated, evaluate, reward_scale
from socialiq_recordings.trait.models import Models, models_of, sample_of
from socialiq_recordings.trait.policy_family import (
    by_effect,
    family_trait,
    tabulate_family,
    value_scale,
)
from socialiq_recordings.trait.traits import progress_trait
from studies.angle_trait.common_scale import Realised, mean_of
from studies.angle_trait.config import RANDOM
from studies.angle_trait.driving import Decided, base_of, choices_of, first_episodes

STRENGTHS = (0.4, 0.8, 1.6, 3.2, 6.4, 12.8)
"""Grid of β, per typical difference of value."""

_LEAST = 1e-12  # probability of what the base predictor leaves out


class Member(NamedTuple):
    """A dial of a family, and what it realises."""

    dial: DialPolicy
    realised: Realised

    def policies(self, common: Float[np.ndarray, " value"], reference: Realised) -> list[QPolicy]:
        """Return the dial's policies at angles of the common scale.

        Args:
            common: Angles of the common scale, degrees.
            reference: The common scale (`mean_of`).
        """
        own = self.realised.angle_of(reference.social_at(common))
        return [self.dial.at(one) for one in own.tolist()]


def common_angle(
    member: Member, angle: Float[np.ndarray, " driver"], reference: Realised
) -> Float[np.ndarray, " driver"]:
    """Return angles of a dial on the common scale, degrees.

    Args:
        member: The dial.
        angle: Its angles, degrees.
        reference: The common scale.
    """
    return reference.angle_of(member.realised.social_at(angle))


def common_grid(reference: Realised, step: float) -> Float[np.ndarray, " value"]:
    """Return angles of the common scale at equal distances of about a step, degrees."""
    low, high = float(reference.angle[0]), float(reference.angle[-1])
    return np.linspace(low, high, max(2, round((high - low) / step) + 1))


def values_of(
    policies: Sequence[QPolicy], decided: Decided, effect: bool = True
) -> Float[np.ndarray, "decision action policy"]:
    """Return the values of each policy, by effect or by action."""
    n_features = policies[0].n_features
    seen = decided.seen[:, :n_features]
    values = np.stack([one.q_values(seen) for one in policies], axis=2).astype(np.float64)
    return by_effect(values, decided.same) if effect else values


def merged(decided: Decided) -> Decided:
    """Return decisions whose actions are the first ones of the same effect."""
    rows, base = np.arange(len(decided.action)), np.zeros(decided.log_base.shape)
    for place, same in enumerate(decided.same.T):
        base[rows, same] += np.exp(decided.log_base[:, place])
    action = decided.same[rows, decided.action]
    log_base = np.log(np.maximum(base, _LEAST))
    log_base -= np.log(np.exp(log_base).sum(axis=1, keepdims=True))
    return decided._replace(log_base=log_base, action=action)


def fit_dials(
    decided: Decided, episodes: int, used: int, family: Sequence[Member], seed: int, step: float
) -> Models:
    """Infer angles on the common scale of a family of dials, with the dial integrated out.

    Their policies mixed are the base predictor of the rivals.

    Args:
        decided: All decisions.
        episodes: Episodes of a driver in `decided`.
        used: Episodes of a driver to use: half of them to infer.
        family: The dials.
        seed: Of the shuffling.
        step: Of the angles integrated over, degrees.
    """
    reference = mean_of([one.realised for one in family])
    common = common_grid(reference, step)
    part = first_episodes(decided, episodes, used)
    policies = [one.policies(common, reference) for one in family]
    base = base_of([one for of_dial in policies for one in of_dial], part.seen)
    part = merged(part._replace(log_base=base))
    sample = sample_of(choices_of(part, episodes, used))
    tables, shared = [], []
    for of_dial in policies:
        values = values_of(of_dial, part)
        trait = family_trait(common, strengths=STRENGTHS, scale=value_scale(values))
        tables.append(tabulate_family(values, sample.table.grid, trait, RANDOM))
        shared.append(trait.shared)
    every = Tabulated(
        np.concatenate([one.log_p for one in tables], axis=2),
        np.concatenate([one.mean for one in tables], axis=1),
    )
    trait = family_trait(common)
    strength = np.concatenate(shared)
    trait = trait._replace(shared=strength, weights=np.zeros((len(strength), len(common), 2)))
    of_chosen = every.at(np.arange(len(sample.table)), sample.table.chosen)
    gain = progress_trait(scale=reward_scale(sample.table))
    of_gain = evaluate(sample.table, gain)
    return models_of(sample, trait, of_chosen, gain, of_gain, seed, every=every)


def likeliest(
    decided: Decided, episodes: int, model: DialPolicy, angle: Float[np.ndarray, " value"]
) -> list[Row]:
    """Return the angle of a model dial that is the most likely for each driver, β shared.

    With many episodes it is the projection of the driver on the model: the angle whose policy has
    the least Kullback-Leibler divergence from what the driver does.

    Args:
        decided: All decisions.
        episodes: Episodes of a driver.
        model: The dial that is the model.
        angle: Its angles to choose from, degrees.

    Returns:
        By driver: the angle with decisions by effect, and by action.
    """
    driver, found = decided.row // episodes, []
    policies = [model.at(one) for one in angle.tolist()]
    for effect in (True, False):
        part = merged(decided) if effect else decided
        values = values_of(policies, part, effect)
        trait = family_trait(angle, strengths=STRENGTHS, scale=value_scale(values))
        every = tabulate_family(values, np.arange(values.shape[1]) - 1.0, trait, RANDOM)
        log_p = every.log_p[np.arange(len(driver)), part.action]
        total = np.array([log_p[driver == one].sum(axis=0) for one in np.unique(driver)])
        best = total.max(axis=2).sum(axis=0).argmax()
        found.append(angle[total[:, best].argmax(axis=1)])
    return [
        {"likeliest": float(one), "by_action": float(other)}
        for one, other in zip(*found, strict=True)
    ]
