import numpy as np
import pytest
from scipy.stats import t as student

from socialiq_recordings.prediction.models import LEAST, Forecast, Spread


def test_scale_and_share_that_stays_are_found_again() -> None:
    rng = np.random.default_rng(0)
    errors = np.concatenate([student.rvs(3, scale=1.5, size=4000, random_state=rng)] * 2)
    moving = np.arange(8000) < 4000
    acceleration = errors + 1.0
    stay = ~moving & (rng.random(8000) < 0.7)
    acceleration[stay] = rng.normal(0, 0.02, stay.sum())
    errors[stay] = acceleration[stay] - 1.0
    found = Spread.fit(errors, acceleration, moving)
    assert found.scale[1] == pytest.approx(1.5, rel=0.1)
    assert found.freedom[1] == 3.0
    assert found.stays == pytest.approx(0.7, abs=0.04)
    assert found.scale[0] == pytest.approx(1.5, rel=0.15)


def test_densities_integrate_to_one() -> None:
    spread = Spread((3.0, 10.0), (0.5, 1.0), 0.6)
    grid = np.linspace(-200, 200, 400_001)
    two = Forecast(np.log([[0.3, 0.7]]), np.array([[-1.0, 2.0]]))
    assert two.mean == pytest.approx([1.1])
    for moving in (False, True):
        many = Forecast(*(np.broadcast_to(one, (len(grid), 2)) for one in two))
        density = np.exp(spread.log_density(many, grid, np.full(len(grid), moving)))
        assert np.trapezoid(density, grid) == pytest.approx(1.0, abs=1e-3)


def test_a_perfect_model_has_the_least_scale_and_none_is_needed_without_data() -> None:
    zeros = np.zeros(10)
    found = Spread.fit(zeros, zeros + 2.0, np.ones(10, bool))
    assert found.scale == (1.0, LEAST) and found.stays == 0.0
