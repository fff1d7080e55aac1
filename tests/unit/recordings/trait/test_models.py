"""Predictions of second halves, and what the angle gains over its rivals."""

import dataclasses

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq_recordings.trait.models import (
    RIVALS,
    chains_to_find_anything,
    contrasts,
    fit_models,
    predict,
    sample_of,
    scores,
)
from socialiq_recordings.trait.traits import STRENGTHS, Trait, angle_trait, evaluate, reward_scale


def test_one_choice_by_hand(choices):
    """Base 1/2 each, rewards (1, 0) and (0, 2): at weights (1, 0.5) both are equally good."""
    table, none = choices([0.0], each=1, candidates=2), np.zeros(0)
    rewards = {"r_env": np.array([[1.0, 0.0]]), "r_social": np.array([[0.0, 2.0]])}
    weights = np.array([[[1.0, 0.5], [np.log(3.0), 0.0], [0.0, 0.0]]])
    trait = Trait(np.zeros(1), np.zeros(3), weights, none, none, np.zeros((0, 3)))
    even, first = np.log(np.full((1, 2), 0.5)), np.array([table.grid[0]])
    table = dataclasses.replace(table, log_base=even, acceleration=first, **rewards)
    found = evaluate(table, trait)
    chance = np.array([0.5, 0.75, 0.5])
    np.testing.assert_allclose(np.exp(found.log_likelihood[0, 0]), chance)
    np.testing.assert_allclose(found.mean[0, 0], [0.0, -1.0, 0.0], atol=1e-12)


def test_the_prediction_is_the_mixture(choices):
    table, trait = choices([0.0], each=3), angle_trait(120.0, strengths=(1.0,))
    evaluated = evaluate(table, trait)
    posterior = np.array([[[0.5, 0.2, 0.3]]])
    found = predict(evaluated, posterior, np.zeros(3, np.int64))
    by_hand = np.log(np.exp(evaluated.log_likelihood[:, 0]) @ posterior[0, 0])
    np.testing.assert_allclose(found.log_likelihood, by_hand)
    np.testing.assert_allclose(found.mean, evaluated.mean[:, 0] @ posterior[0, 0])


def test_both_rewards_have_one_scale(choices):
    table = choices([0.0, 30.0])
    twice = dataclasses.replace(table, r_env=2 * table.r_env + 5.0, r_social=2 * table.r_social)
    assert reward_scale(twice) == pytest.approx(2 * reward_scale(table))
    flat = dataclasses.replace(table, r_env=0 * table.r_env, r_social=0 * table.r_social)
    assert reward_scale(flat) == 1.0


def test_only_drivers_with_both_halves_count(choices):
    table = choices([0.0, 10.0, 20.0], each=4)
    table = table.rows((table.driver != 1) | (table.half == 0))
    found = sample_of(table)
    assert found.identity.tolist() == [0, 2] and len(found.table) == 8
    assert found.chain.tolist() == [0, 1]
    with pytest.raises(UserError, match="both halves"):
        sample_of(table.rows(table.half == 0))
    with pytest.raises(UserError, match="at least two"):
        fit_models(table.rows(table.driver == 0), seed=0)


@pytest.fixture(scope="module")
def apart(choices):
    angles = np.random.default_rng(3).normal(30.0, 50.0, 70)
    return fit_models(choices(angles, each=24, strength=3.0, seed=4), seed=0, step=15.0)


def test_an_angle_that_differs_between_drivers_predicts(apart):
    rows = {row["angle_over"]: row for row in contrasts(apart, seed=0, resamples=1000)}
    assert tuple(rows) == RIVALS
    assert all(row["found"] and row["low"] > 0 for row in rows.values())
    assert all(row["p"] <= row["p_holm"] for row in rows.values())
    by_model = {row["model"]: row for row in scores(apart)}
    assert by_model["angle"]["rmse"] < by_model["population"]["rmse"] < by_model["base"]["rmse"]
    difference = by_model["angle"]["log_likelihood"] - by_model["population"]["log_likelihood"]
    assert rows["population"]["gain_nats"] == pytest.approx(difference)


def test_an_angle_that_all_drivers_share_predicts_nothing_more(choices):
    models = fit_models(choices([30.0] * 40, each=16, seed=5), seed=0, step=15.0)
    rows = contrasts(models, seed=0, resamples=500)
    assert not any(row["found"] for row in rows)
    assert abs(rows[0]["gain_nats"]) < 0.02


def test_second_halves_are_not_used_to_infer(choices):
    """Other choices in second halves leave every posterior as it was."""
    table = choices(np.linspace(-30, 90, 12), each=8)
    other = np.where(table.half == 1, -table.acceleration, table.acceleration)
    before, after = (
        fit_models(one, seed=0, step=30.0)
        for one in (table, dataclasses.replace(table, acceleration=other))
    )
    np.testing.assert_array_equal(before.angle.drivers, after.angle.drivers)
    for name in ("angle", "population", "progress gain", "last residual"):
        one, two = before.predictions[name], after.predictions[name]
        np.testing.assert_array_equal(one.mean, two.mean)


def test_a_habit_that_is_no_angle_is_a_residual(choices):
    """Drivers with an acceleration of their own: the residual predicts, the angle less."""
    table = choices([30.0] * 40, each=16, strength=0.5, seed=8)
    habit = np.random.default_rng(9).normal(0.0, 1.0, 40)[table.driver]
    place = np.clip(np.rint((table.acceleration + habit + 2.0) / (4 / 6)), 0, 6)
    acceleration = -2.0 + place * 4 / 6
    off = acceleration - np.exp(table.log_base) @ table.grid
    residual = np.where(table.time > 0, np.roll(off, 1), 0.0)
    table = dataclasses.replace(table, acceleration=acceleration, residual=residual)
    rows = {row["angle_over"]: row for row in contrasts(fit_models(table, 0, 15.0), 0, 500)}
    assert rows["running residual"]["gain_nats"] < 0
    assert not rows["running residual"]["found"]


def test_chains_that_are_too_few_find_nothing(choices):
    needed = chains_to_find_anything()
    angles = np.repeat(np.random.default_rng(3).normal(30.0, 60.0, needed - 1), 6)
    table = choices(angles, each=12, strength=4.0, together=6)
    rows = contrasts(fit_models(table, seed=0, step=15.0), seed=0, resamples=200)
    assert {row["chains"] for row in rows} == {needed - 1}
    assert not any(row["found"] for row in rows)


def test_drivers_alike_between_points_of_the_grid_have_no_spread(choices):
    """β and the mean angle lie between points: there a grid that stays coarse makes up a spread."""
    scale = reward_scale(choices([37.5] * 60, each=30, seed=6))
    strength = np.sqrt(STRENGTHS[12] * STRENGTHS[13]) / scale
    models = fit_models(choices([37.5] * 60, each=30, strength=strength, seed=6), 0, step=15.0)
    population = models.angle.population
    assert population.quantiles("shared", (0.5,))[0] == pytest.approx(strength, rel=0.1)
    assert population.quantiles("spread", (0.5,))[0] < 10.0
    assert abs(contrasts(models, 0, 100)[0]["gain_nats"]) < 1e-3
