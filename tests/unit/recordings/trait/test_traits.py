"""Grids of traits."""

import numpy as np
import pytest

from socialiq_recordings.trait.traits import angle_trait, progress_trait


@pytest.mark.parametrize("spread", [5.0, 20.0, 60.0, 90.0])
def test_the_wrapped_normal_has_the_closed_resultant(spread):
    """Mardia and Jupp 2000, 3.5.63: the mean resultant length is exp(-σ² / 2)."""
    trait = angle_trait(5.0)
    [share] = trait.population[(trait.mean == 40.0) & (trait.spread == spread)]
    resultant = (share * np.exp(1j * np.radians(trait.value - 40.0))).sum()
    assert resultant.real == pytest.approx(np.exp(-(np.radians(spread) ** 2) / 2), abs=1e-7)
    assert resultant.imag == pytest.approx(0.0, abs=1e-12)


def test_without_spread_all_is_at_the_mean():
    for trait in (angle_trait(15.0), progress_trait()):
        alike = trait.population[trait.spread == 0.0]
        np.testing.assert_array_equal(alike, np.eye(len(trait.value)))
    angle = angle_trait(15.0).value
    assert len(angle) == 24 and angle[-1] == 180.0


def test_an_uneven_grid_has_the_mean_of_the_normal():
    trait = progress_trait((*np.linspace(0.0, 2.0, 100), *np.linspace(2.1, 8.0, 60)))
    mean = trait.mean[np.abs(trait.mean - 0.5).argmin()]
    [share] = trait.population[(trait.mean == mean) & (trait.spread == 1.0)]
    assert share @ trait.value == pytest.approx(mean, abs=1e-3)


def test_weights_of_the_angle_are_a_circle_and_those_of_progress_lines():
    angle, gain = angle_trait(15.0, strengths=(0.0, 1.0), scale=0.5), progress_trait((0.0, 1.0))
    np.testing.assert_allclose(np.hypot(*angle.weights[1].T), 2.0)
    at_45 = np.flatnonzero(angle.value == 45.0)[0]
    np.testing.assert_allclose(angle.weights[1, at_45], [2**0.5, 2**0.5])
    np.testing.assert_allclose(gain.weights[2], [[-1.0, 1.0], [0.0, 1.0], [1.0, 1.0]])


def test_drivers_alike_have_no_spread():
    trait = angle_trait(15.0)
    alike = trait.alike()
    assert not alike.spread.any() and len(alike.mean) == 24
    np.testing.assert_array_equal(alike.population, np.eye(24))
    np.testing.assert_allclose(trait.population.sum(axis=1), 1.0)


def test_a_narrowed_grid_has_as_many_points_between_the_neighbours_of_what_is_left():
    trait = angle_trait(15.0, strengths=(0.0, 1.0, 2.0, 4.0))
    near = np.abs(trait.value - 45.0) <= 30.0
    finer = trait.narrowed(trait.shared == 4.0, near, trait.spread <= 30.0)
    assert finer is not None
    np.testing.assert_allclose(finer.shared, np.linspace(2.0, 4.0, 4))
    np.testing.assert_allclose(finer.value, np.linspace(0.0, 90.0, 24))
    np.testing.assert_allclose(np.unique(finer.spread), np.linspace(0.0, 45.0, 7))
    np.testing.assert_allclose(finer.population.sum(axis=1), 1.0)
    np.testing.assert_allclose(np.hypot(*finer.weights[0].T), 2.0)


def test_a_grid_of_which_everything_is_left_or_that_is_fixed_is_not_narrowed():
    trait = angle_trait(15.0)
    every = [np.ones(len(one), bool) for one in (trait.shared, trait.value, trait.spread)]
    assert trait.narrowed(*every) is None
    assert trait._replace(rule=None).narrowed(*(~one for one in every)) is None
