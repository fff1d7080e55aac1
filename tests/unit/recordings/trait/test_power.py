"""Simulated drivers of known angles at recorded moments."""

import dataclasses

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.recordings.trait.choice_model import evaluate, reward_scale
from socialiq.recordings.trait.models import sample_of
from socialiq.recordings.trait.power import (
    Grids,
    Planted,
    PowerConfig,
    Tabulated,
    before,
    decide,
    known_angle_gain,
    larger_sample,
    needed_rows,
    power_rows,
    strength_of_gain,
)


@pytest.fixture(scope="module")
def sample(choices):
    return sample_of(choices(np.zeros(10), each=8, together=2))


def test_a_larger_sample_repeats_whole_chains_with_new_drivers(sample):
    same, rows = larger_sample(sample, 1, np.random.default_rng(0))
    np.testing.assert_array_equal(np.sort(rows), np.arange(80))
    assert len(same.chain) == 10 and same.chain.max() == 4
    larger, rows = larger_sample(sample, 3, np.random.default_rng(0))
    assert larger.chain.max() + 1 == 15 and len(larger.chain) == 30 and len(larger.table) == 240
    np.testing.assert_array_equal(np.bincount(larger.driver), 8)
    np.testing.assert_array_equal(larger.table.r_env, sample.table.r_env[rows])
    np.testing.assert_array_equal(larger.chain[larger.driver], larger.table.chain)


def test_choices_are_drawn_with_their_probability(choices):
    table = choices([0.0], each=2)
    many = sample_of(
        dataclasses.replace(
            table,
            **{
                name: np.repeat(one, 20_000, axis=0)
                for name, one in table.arrays().items()
                if name != "grid"
            },
        )
    )
    drawn = decide(many, np.zeros((1, 2)), np.random.default_rng(0)).table
    share = np.bincount(drawn.chosen, minlength=7) / len(drawn)
    np.testing.assert_allclose(share, np.exp(table.log_base[0]), atol=0.01)


def test_the_decision_before_is_the_drivers_own():
    driver, time = np.array([0, 1, 0, 1]), np.array([2.0, 0.0, 1.0, 5.0])
    found = before(np.array([10.0, 20.0, 30.0, 40.0]), driver, time)
    assert found.tolist() == [30.0, 0.0, 0.0, 20.0]


def test_the_gain_of_known_angles_by_simulation(sample):
    """The closed form beside drawn choices, predicted with and without the angle."""
    planted = Planted(40.0, 20.0, 3.0)
    rng = np.random.default_rng(0)
    many, _ = larger_sample(sample, 400, rng)
    angle = planted.mean + planted.spread * rng.standard_normal(len(many.chain))
    table = decide(many, planted.weights(angle), rng).table
    rows = many.second

    def means(weights):
        score = table.log_base + weights[:, :1] * table.r_env + weights[:, 1:] * table.r_social
        chance = np.exp(score - score.max(axis=1, keepdims=True))
        return (chance / chance.sum(axis=1, keepdims=True)) @ table.grid

    known = means(planted.weights(angle)[many.driver])
    quantiles = planted.mean + planted.spread * np.linspace(-2.5, 2.5, 41)
    density = np.exp(-0.5 * np.linspace(-2.5, 2.5, 41) ** 2)
    each = np.array([means(np.repeat(planted.weights(q[None]), len(table), 0)) for q in quantiles])
    marginal = np.average(each, axis=0, weights=density)
    error = [np.mean((table.acceleration - one)[rows] ** 2) for one in (known, marginal)]
    assert known_angle_gain(sample, planted) == pytest.approx(
        1 - np.sqrt(error[0] / error[1]), abs=0.01
    )
    assert known_angle_gain(sample, planted._replace(spread=0.0)) == pytest.approx(0.0)


def test_the_strength_of_a_gain_gives_that_gain(sample):
    strength = strength_of_gain(sample, 35.0, 30.0, 0.05)
    assert strength is not None
    assert known_angle_gain(sample, Planted(35.0, 30.0, strength)) == pytest.approx(0.05, abs=2e-3)
    assert strength_of_gain(sample, 1.0, 30.0, 0.9) is None


def test_looking_up_is_evaluating(sample):
    trait = Grids.of(sample).angle
    found = Tabulated.of(sample.table, trait).at(np.arange(80), sample.table.chosen)
    direct = evaluate(sample.table, trait)
    np.testing.assert_allclose(found.log_likelihood, direct.log_likelihood)
    np.testing.assert_allclose(found.mean, direct.mean)


def test_more_drivers_of_wider_angles_are_found_and_equal_ones_are_not(choices):
    sample = sample_of(choices(np.zeros(10), each=10))
    config = PowerConfig(spreads=(0.0, 60.0), strength=3.0, sizes=(1, 5), repeats=3, resamples=200)
    rows = power_rows(sample, config)
    by = {(row["population"], row["size"]): row for row in rows}
    assert by["spread 0", 5]["detected"] <= 1 / 3
    widest = max(row["detected"] for row in rows if row["population"] == "spread 60")
    assert widest >= 2 / 3
    assert by["spread 60", 1]["known_angle_gain"] > 0.1
    needed = {row["population"]: row for row in needed_rows(rows)}
    assert needed["spread 0"]["size_needed"] is None
    assert 1 <= needed["spread 60"]["size_needed"] <= 5
    again = power_rows(sample, dataclasses.replace(config, spreads=(60.0,), sizes=(1,)))
    assert again[0] == by["spread 60", 1]


def test_the_size_needed_is_between_two_sizes():
    row = {"population": "a", "spread": 20.0, "known_angle_gain": 0.1, "drivers": 5, "chains": 2}
    rows = [row | {"size": 1, "detected": 0.2}]
    assert needed_rows(rows)[0]["more_than"] == 1
    rows.append(row | {"size": 16, "detected": 1.0, "drivers": 80, "chains": 32})
    found = needed_rows(rows)[0]
    assert found["size_needed"] == pytest.approx(16**0.75) and found["chains_needed"] == 16


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ({"spreads": (120.0,)}, "spreads"),
        ({"mean": 200.0}, "mean"),
        ({"strength": 0.0}, "strength"),
        ({"gain": 1.0}, "gain"),
        ({"sizes": ()}, "sizes"),
        ({"repeats": 0}, "repeats"),
        ({"resamples": 1}, "resamples"),
    ],
)
def test_bad_options_are_named(wrong, line):
    with pytest.raises(UserError, match=line):
        PowerConfig(**wrong)


def test_equal_rewards_show_nothing(choices):
    table = choices([0.0, 1.0], each=4)
    flat = dataclasses.replace(table, r_env=0 * table.r_env, r_social=0 * table.r_social)
    assert reward_scale(flat) == 1.0
    with pytest.raises(UserError, match="same rewards"):
        power_rows(sample_of(flat), PowerConfig())
