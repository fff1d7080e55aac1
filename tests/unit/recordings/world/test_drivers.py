import numpy as np
import pytest

from socialiq_recordings import idm
from socialiq_recordings.world.drivers import Followed, Observed, calibrate


def followed(driver: idm.Idm, count: int, seed: int = 0) -> Followed:
    """Moments of one driver of the IDM, exactly."""
    drawn = np.random.default_rng(seed)
    speed = drawn.uniform(2.0, 12.0, count)
    gap, leader = drawn.uniform(4.0, 50.0, count), drawn.uniform(0.0, 12.0, count)
    return Followed(speed, gap, leader, idm.acceleration(speed, gap, leader, *driver))


def observed(moments: Followed, **more) -> Observed:
    nothing = np.zeros(0)
    given = dict.fromkeys(Observed._fields, nothing) | {"followed": moments, "vehicles": 1}
    return Observed(**(given | more))


def test_the_parameters_of_a_driver_are_recovered():
    driver = idm.Idm(15.0, 1.2, 2.5, 1.8, 2.2)
    moments = followed(driver, 400)
    middle = float(np.median(moments.speed))
    found = calibrate(
        observed(
            moments,
            free_speeds=np.full(20, 15.0),
            headways=np.full(20, 1.2 + 2.5 / middle),
            standing_gaps=np.full(20, 2.5),
        )
    ).drivers
    assert found.time_headway.mean == pytest.approx(1.2)
    assert found.max_acceleration.mean == pytest.approx(1.8, rel=0.05)
    assert found.comfort_deceleration.mean == pytest.approx(2.2, rel=0.1)


def test_what_is_not_shown_keeps_the_literature_and_says_so():
    found = calibrate(observed(followed(idm.Idm(), 3)))
    assert not any(row["estimated"] for row in found.evidence)
    assert found.drivers.time_headway.mean == idm.Idm().time_headway


def test_a_fit_worse_than_constant_speed_is_dropped():
    moments = followed(idm.Idm(), 100)._replace(acceleration=np.zeros(100))
    found = calibrate(observed(moments))
    assert found.drivers.max_acceleration.mean == idm.Idm().max_acceleration
    assert not found.evidence[3]["estimated"]
