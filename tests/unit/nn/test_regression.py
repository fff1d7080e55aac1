import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.nn.regression import cross_fitted

STEPS = 500


@pytest.fixture(name="data", scope="module")
def smooth_function_with_noise_of_its_group():
    rng = np.random.default_rng(0)
    group = np.repeat(np.arange(150), 8)
    observation = rng.uniform(-1, 1, (len(group), 2))
    mean = np.stack([observation[:, 0] ** 2, 100 - 20 * observation[:, 1]], axis=1)
    noise = rng.normal(size=(150, 2))[group] * [0.2, 4.0]
    return observation, mean, mean + noise, group


@pytest.fixture(name="told", scope="module")
def fitted(data):
    observation, _, target, group = data
    return cross_fitted(observation, target, group, steps=STEPS)


def test_the_mean_is_found_and_not_the_noise(data, told):
    """The error to the mean is well below the noise, of two outputs of very different size."""
    _, mean, target, _ = data
    for output, noise in enumerate((0.2, 4.0)):
        error = np.sqrt(np.mean((told - mean)[:, output] ** 2))
        assert error < 0.5 * noise
        # What is left of the noise is nearly all of it: no row's own noise was subtracted.
        rest = (target - told)[:, output]
        own = (target - mean)[:, output]
        assert np.corrcoef(rest, own)[0, 1] > 0.9
        assert rest.std() > 0.9 * noise


def test_a_row_is_told_by_networks_that_have_not_seen_its_group(data, told):
    """Another target in one group changes predictions of the others, not its own."""
    observation, _, target, group = data
    changed = target.copy()
    changed[group == 3] += [5.0, 100.0]
    moved = cross_fitted(observation, changed, group, steps=STEPS) - told
    # Mean and spread of all targets scale the fit, so it moves by rounding there as well.
    assert np.abs(moved[group == 3, 0]).max() < 0.05 < np.abs(moved[group != 3, 0]).max()


def test_the_same_seed_tells_the_same(data, told):
    observation, _, target, group = data
    np.testing.assert_array_equal(cross_fitted(observation, target, group, steps=STEPS), told)


def test_a_constant_is_told_as_it_is():
    observation, group = np.random.default_rng(0).normal(size=(6, 3)), np.repeat([0, 1], 3)
    told = cross_fitted(observation, np.full((6, 1), 7.0), group, steps=5)
    np.testing.assert_allclose(told, 7.0, atol=1e-6)


def test_one_group_is_refused():
    with pytest.raises(UserError, match="pass two or more"):
        cross_fitted(np.ones((3, 1)), np.ones((3, 1)), np.zeros(3, int))
