from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from socialiq_recordings.prediction import following, models
from socialiq_recordings.prediction.models import (
    MODELS,
    Fitted,
    Forecast,
    Task,
    residuals,
    rollout,
)
from socialiq_recordings.prediction.situations import Situations

Make = Callable[..., Situations]


def _task(train: Situations) -> Task:
    first = train.half() == 0
    idm = following.literature()
    last = residuals(idm, train)
    return Task(train, last, first, train.rows(first), idm, 0)


def _drivers(situations: Make) -> Situations:
    """Drivers that each keep an error of their own against the IDM."""
    rng = np.random.default_rng(0)
    vehicle = np.repeat(np.arange(20), 10)
    seen = situations(
        200,
        vehicle=vehicle,
        time=np.tile(np.arange(10.0), 20),
        speed=rng.uniform(4, 14, 200),
    )
    made = following.next_second(following.literature(), seen)
    return replace(seen, acceleration=made + rng.normal(0, 1, 20)[vehicle])


def test_the_last_residual_is_that_of_the_moment_before(situations: Make) -> None:
    seen = _drivers(situations)
    found = residuals(following.literature(), seen)
    off = seen.acceleration - following.next_second(following.literature(), seen)
    assert (found[::10] == 0).all()  # a driver's first moment has none
    assert np.delete(found, np.arange(0, 200, 10)) == pytest.approx(
        np.delete(off, np.arange(9, 200, 10))
    )


def test_an_error_that_persists_is_predicted_by_the_last_residual_alone(situations: Make) -> None:
    seen = _drivers(situations)
    task = _task(seen)
    later = np.arange(200) % 10 > 0
    errors = {}
    for name in ("constant speed", "IDM, fitted", "IDM, last residual"):
        made = MODELS[name](task).forecast(seen, task.residual)
        errors[name] = np.abs(made.mean - seen.acceleration)[later].max()
    assert errors["IDM, last residual"] < 1e-9
    assert min(errors["constant speed"], errors["IDM, fitted"]) > 0.5


def test_only_models_that_know_the_driver_say_so(situations: Make) -> None:
    task = _task(_drivers(situations))
    cheap = [one for one in MODELS if not one.startswith("boosting")]
    assert [one for one in cheap if MODELS[one](task).personal] == ["IDM, by driver"]


def test_a_rollout_drives_the_mean_accelerations_and_stands_where_they_end(
    situations: Make,
) -> None:
    seen = situations(2, speed=[10.0, 1.0])
    spread = MODELS["constant speed"](_task(_drivers(situations))).spread
    brakes = Fitted(lambda seen, _: Forecast.at(np.full(len(seen), -2.0)), spread)
    driven = rollout(brakes, following.literature(), seen, np.zeros(2))
    assert driven == pytest.approx([9.0 + 7.0 + 5.0, 0.25])
    assert set(models.TRIVIAL) < set(MODELS)
