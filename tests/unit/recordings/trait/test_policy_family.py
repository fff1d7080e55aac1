"""Choices by a family of policies: probabilities, and the same inference as from rewards."""

import dataclasses

import numpy as np
import pytest

from socialiq_recordings.trait.models import models_of, sample_of
from socialiq_recordings.trait.traits import (
    evaluate,
    family_trait,
    progress_trait,
    reward_scale,
    rewards_of,
)
from studies.angle_trait.study import tabulate_family, value_scale

GRID = np.array([-1.0, 0.0, 1.0])


def test_probabilities_are_those_of_a_softmax_with_random_choices():
    values = np.array([[[0.0, 1.0], [1.0, 0.0], [0.0, 0.0]]])
    trait = family_trait(np.array([0.0, 90.0]), strengths=(0.0, 2.0))
    found = tabulate_family(values, GRID, trait, 0.1)
    np.testing.assert_allclose(np.exp(found.log_p).sum(axis=1), 1.0)
    np.testing.assert_allclose(np.exp(found.log_p[0, :, 0]), 1 / 3)  # β = 0: at random
    chance = np.exp(2.0) / (np.exp(2.0) + 2)
    assert np.exp(found.log_p[0, 1, 1, 0]) == pytest.approx(0.9 * chance + 0.1 / 3)
    np.testing.assert_allclose(
        found.mean[0, 1, 1], np.exp(found.log_p[0, 2, 1, 1]) - np.exp(found.log_p[0, 0, 1, 1])
    )


def test_populations_are_distributions_on_the_family():
    trait = family_trait(np.linspace(0.0, 90.0, 7))
    np.testing.assert_allclose(trait.population.sum(axis=1), 1.0)
    alike = trait.alike()
    np.testing.assert_array_equal(alike.population.sum(axis=0), 1.0)


def test_one_scale_for_all_values():
    values = np.zeros((4, 3, 2))
    assert value_scale(values) == 1.0
    values[:, 0] = 3.0
    assert value_scale(values) == pytest.approx(np.sqrt(2.0))


def test_a_family_whose_values_are_rewards_infers_as_the_rewards_do(choices):
    """Q_α = cos α r_env + sin α r_social with an even base: the models agree up to ε."""
    table = choices(np.repeat([0.0, 90.0], 6), each=10)
    even = np.full_like(table.log_base, -np.log(table.log_base.shape[1]))
    sample = sample_of(dataclasses.replace(table, log_base=even))
    angle = np.linspace(0.0, 90.0, 7)
    radians = np.radians(angle)
    values = rewards_of(sample.table) @ np.stack([np.cos(radians), np.sin(radians)])
    scale = reward_scale(sample.table)
    family = family_trait(angle, scale=scale)
    weights = np.stack([np.cos(radians), np.sin(radians)], axis=-1)
    rewarded = family._replace(weights=family.shared[:, None, None] * weights)
    every = tabulate_family(values, sample.table.grid, family, 1e-12)
    gain = progress_trait(scale=scale)
    of_gain = evaluate(sample.table, gain)
    of_chosen = every.at(np.arange(len(sample.table)), sample.table.chosen)
    by_values = models_of(sample, family, of_chosen, gain, of_gain, 0, every=every)
    by_rewards = models_of(sample, rewarded, evaluate(sample.table, rewarded), gain, of_gain, 0)
    for name in ("population", "angle", "shuffled angle"):
        np.testing.assert_allclose(
            by_values.predictions[name].log_likelihood,
            by_rewards.predictions[name].log_likelihood,
            atol=1e-6,
        )
    chance = np.exp(by_values.predictions["running residual"].log_likelihood)
    assert ((chance > 0.0) & (chance <= 1.0)).all()
