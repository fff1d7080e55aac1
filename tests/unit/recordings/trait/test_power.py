"""Simulated drivers of known angles at recorded moments."""

import dataclasses

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq_recordings.trait.models import contrasts, models_of, sample_of
from socialiq_recordings.trait.power import STEP, STRENGTHS, PowerConfig, needed_rows, power_rows
from socialiq_recordings.trait.traits import (
    Tabulated,
    angle_trait,
    evaluate,
    progress_trait,
    reward_scale,
)


@pytest.fixture(scope="module")
def sample(choices):
    return sample_of(choices(np.zeros(10), each=8, together=2))


def test_looking_up_is_evaluating(sample):
    trait = angle_trait(STEP, STRENGTHS, reward_scale(sample.table))
    found = Tabulated.of(sample.table, trait).at(np.arange(80), sample.table.chosen)
    direct = evaluate(sample.table, trait)
    np.testing.assert_allclose(found.log_likelihood, direct.log_likelihood, atol=1e-12)
    np.testing.assert_allclose(found.mean, direct.mean, atol=1e-12)


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


def test_drivers_alike_between_points_of_the_grid_have_no_spread(choices):
    """β and the mean angle lie between points: there a fixed grid makes up a spread."""
    table = choices([37.5] * 60, each=60, seed=6)
    strength = np.sqrt(STRENGTHS[6] * STRENGTHS[7]) / reward_scale(table)
    sample = sample_of(choices([37.5] * 60, each=60, strength=strength, seed=6))
    scale = reward_scale(sample.table)
    angle, gain = angle_trait(STEP, STRENGTHS, scale), progress_trait(STRENGTHS, scale)
    of_angle, of_gain = (evaluate(sample.table, one) for one in (angle, gain))
    fixed, narrow = (
        models_of(sample, angle, of_angle, gain, of_gain, 0, 1, again=again)
        for again in (None, lambda trait: evaluate(sample.table, trait))
    )
    population = narrow.angle.population
    assert population.quantiles("shared", (0.5,))[0] == pytest.approx(strength, rel=0.1)
    assert population.quantiles("spread", (0.5,))[0] < 10.0
    gains = [contrasts(one, 0, 100)[0]["gain_nats"] for one in (fixed, narrow)]
    assert gains[0] > gains[1] and abs(gains[1]) < 1e-3
