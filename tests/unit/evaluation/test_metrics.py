import numpy as np
import pytest

from socialiq.evaluation.exact import Metrics, mean_of
from socialiq.types import Ending, RewardPair


def metrics(env, social, **changes):
    endings = np.zeros(len(Ending))
    endings[[Ending.ARRIVAL, Ending.COLLISION, Ending.TIMEOUT]] = 0.6, 0.3, 0.1
    made = Metrics.of(RewardPair(env, social), endings, mean_speed=1.5, stopped=0.2, length=7.0)
    return made._replace(**changes)


def test_of_puts_each_number_in_its_place():
    assert metrics(-1.0, 1.0) == Metrics(
        r_env=-1.0,
        r_social=1.0,
        angle=135.0,
        collision=0.3,
        arrival=0.6,
        timeout=0.1,
        mean_speed=1.5,
        stopped=0.2,
        length=7.0,
    )


def test_of_takes_numpy_scalars_to_floats():
    made = metrics(np.float64(2.0), np.float64(0.0))
    assert {type(value) for value in made} == {float}


def test_totals_are_a_pair():
    assert metrics(3.0, 4.0).totals == RewardPair(env=3.0, social=4.0)


@pytest.mark.parametrize(
    ("angle", "value"), [(0.0, 3.0), (90.0, 4.0), (45.0, 7.0 / np.sqrt(2)), (180.0, -3.0)]
)
def test_value_scores_the_totals_at_an_angle(angle, value):
    assert metrics(3.0, 4.0).value(angle) == pytest.approx(value, abs=1e-12)


def test_mean_of_averages_every_number():
    mean = mean_of([metrics(1.0, 0.0, length=4.0), metrics(3.0, 4.0, length=6.0, arrival=0.2)])
    assert (mean.r_env, mean.r_social, mean.length) == (2.0, 2.0, 5.0)
    assert (mean.arrival, mean.collision) == pytest.approx((0.4, 0.3))


def test_mean_of_takes_the_angle_of_the_mean_totals():
    # at 135 and -135 degrees, so the mean of the angles would be 0
    assert mean_of([metrics(-1.0, 1.0), metrics(-1.0, -1.0)]).angle == pytest.approx(180.0)
    # the longer vector weighs more
    assert mean_of([metrics(1.0, 0.0), metrics(0.0, 3.0)]).angle == pytest.approx(
        np.degrees(np.arctan(3.0))
    )


def test_mean_of_one_is_itself():
    assert mean_of([metrics(2.0, -2.0)]) == metrics(2.0, -2.0)
