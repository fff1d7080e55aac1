import numpy as np
import pytest

from socialiq.evaluation.classes import ClassGround
from socialiq.mdp.octant import octant_front
from socialiq.mdp.tabular import TabularMDP
from socialiq.social.angle import direction_of
from socialiq.types import Ending, RewardPair
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid


def choices(points):
    """A decision of one step: (r_env, r_vehicle, r_vulnerable) of each action."""
    parts = tuple(np.array(points, np.float64).T[:, None, :])
    one, shape = np.zeros((1, len(points), 1), np.int64), (1, len(points), 1)
    ending = np.full(shape, int(Ending.ARRIVAL))
    mdp = TabularMDP(one, np.ones(shape), ending, RewardPair(*parts[:2]), np.ones(1))
    return mdp, parts


def test_the_front_has_the_best_of_every_direction_and_no_dominated_point():
    best = [(3.0, 0.0, 0.0), (2.0, 2.0, 0.0), (0.0, 0.0, 4.0), (1.0, 1.5, 1.5)]
    dominated = [(2.9, 0.0, 0.0), (3.0, -1.0, 0.0), (1.0, 1.0, 1.0), (0.0, 2.0, -1.0)]
    front = octant_front(*choices(best + dominated), 1)
    assert sorted(map(tuple, front.vertices.tolist())) == sorted(best)
    number, value = front.best(direction_of(0.0, 45.0).parts)
    assert tuple(front.vertices[number]) == (3.0, 0.0, 0.0)
    assert value == 3.0
    assert front.best(direction_of(90.0, 90.0).parts)[1] == 4.0


def test_a_single_point_is_a_front():
    front = octant_front(*choices([(1.0, 2.0, -3.0)] * 2), 1)
    assert front.vertices.tolist() == [[1.0, 2.0, -3.0]]


@pytest.fixture(scope="module")
def ground():
    return ClassGround(tabulate(make_grid("crosswalk7")))


def sums(row):
    return tuple(round(row[name], 6) for name in ("r_env", "r_vehicle", "r_vulnerable"))


@pytest.mark.parametrize(
    ("every", "directions", "optima"),
    [(15.0, 49, 14), pytest.param(3.0, 961, 78, marks=pytest.mark.slow)],
)
def test_the_crosswalk_has_so_many_distinct_optima(every, directions, optima, ground):
    rows = list(ground.optima(every))
    assert len(rows) == directions
    assert len(set(map(sums, rows))) == optima


@pytest.mark.slow
def test_no_optimum_of_a_direction_exceeds_the_front(ground):
    front = ground.front()
    for row in ground.optima(10.0):
        direction = direction_of(row["angle"], row["class_angle"]).parts
        assert front.best(direction)[1] == pytest.approx(row["value"], abs=1e-9)
