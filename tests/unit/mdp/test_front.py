from itertools import product

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from socialiq.errors import UserError
from socialiq.mdp.front import AttainableSet, attainable_set
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.mdp.tabular import TabularMDP
from socialiq.types import Ending, RewardPair

SQUARE = AttainableSet(np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]))
DIAMOND = AttainableSet(np.array([[3.0, 1.0], [2.0, 2.0], [1.0, 1.0], [2.0, 0.0]]))
SEGMENT = AttainableSet(np.array([[2.0, 0.0], [0.0, 2.0]]))
POINT = AttainableSet(np.array([[1.0, 1.0]]))


def scored(mdp, angle):
    radians = np.deg2rad(angle)
    return np.cos(radians) * mdp.rewards.env + np.sin(radians) * mdp.rewards.social


def bandit(pairs) -> TabularMDP:
    """One state, one step: each action ends the episode with its own pair of rewards."""
    env, social = np.array(pairs, np.float64).T
    shape = (1, len(pairs), 1)
    return TabularMDP(
        successor=np.zeros(shape, np.int64),
        probability=np.ones(shape),
        ending=np.full(shape, Ending.ARRIVAL),
        rewards=RewardPair(env[None], social[None]),
        initial=np.ones(1),
    )


@pytest.mark.parametrize("seed", range(3))
def test_support_is_the_optimum_in_every_direction(seed, random_mdp):
    rng = np.random.default_rng(seed)
    mdp = random_mdp(rng, 5, 3, 2, 0.1)
    region = attainable_set(mdp, 5)
    for angle in rng.uniform(-180, 180, 360):
        value = horizon_optimum(mdp, scored(mdp, angle), 5).value
        assert region.optimum(angle).value == pytest.approx(value, abs=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_every_vertex_is_attained_within_its_interval(seed, random_mdp):
    mdp = random_mdp(np.random.default_rng(seed), 4, 2, 2, 0.1)
    region = attainable_set(mdp, 4)
    assert len(region.vertices) > 4
    for vertex, point in enumerate(region.vertices):
        low, high = region.supporting_interval(vertex)
        middle = (low + high) / 2
        policy = horizon_optimum(mdp, scored(mdp, middle), 4).probabilities(2)
        np.testing.assert_allclose(horizon_evaluation(mdp, policy, 4).totals, point, atol=1e-9)
        assert region.optimum(middle).vertex == vertex


@pytest.mark.parametrize("seed", range(3))
def test_the_hull_of_all_deterministic_policies_is_the_set(seed, random_mdp):
    mdp = random_mdp(np.random.default_rng(seed), 2, 2, 2, 0.2)
    totals = np.array(
        [
            horizon_evaluation(mdp, np.eye(2)[np.reshape(choice, (3, 2))], 3).totals
            for choice in product(range(2), repeat=6)
        ]
    )
    region = attainable_set(mdp, 3)
    corners = totals[ConvexHull(totals).vertices]
    start = np.linalg.norm(corners - region.vertices[0], axis=1).argmin()
    np.testing.assert_allclose(region.vertices, np.roll(corners, -start, axis=0), atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_randomised_policies_lie_inside(seed, random_mdp, random_policy):
    rng = np.random.default_rng(seed)
    mdp = random_mdp(rng, 5, 3, 2, 0.1)
    region = attainable_set(mdp, 5)
    for _ in range(20):
        assert region.contains(horizon_evaluation(mdp, random_policy(rng, 5, 5, 3), 5).totals)


@pytest.mark.parametrize("seed", range(3))
def test_supporting_intervals_follow_one_another_round_the_circle(seed, random_mdp):
    region = attainable_set(random_mdp(np.random.default_rng(seed), 5, 3, 2, 0.1), 5)
    intervals = [region.supporting_interval(vertex) for vertex in range(len(region.vertices))]
    assert sum(high - low for low, high in intervals) == pytest.approx(360.0)
    for (_, high), (low, _) in zip(intervals, intervals[1:] + intervals[:1], strict=True):
        assert abs((high - low + 180) % 360 - 180) < 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_radius_ends_on_the_boundary(seed, random_mdp):
    region = attainable_set(random_mdp(np.random.default_rng(seed), 5, 3, 2, 0.1), 5)
    around_the_origin = AttainableSet(region.vertices - region.vertices.mean(axis=0))
    for angle in np.arange(0.0, 360.0, 7.0):
        ray = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
        radius = around_the_origin.radius(angle)
        assert around_the_origin.contains(RewardPair(*(ray * (radius - 1e-6))))
        assert around_the_origin.contains(RewardPair(*(ray * radius)))
        assert not around_the_origin.contains(RewardPair(*(ray * (radius + 1e-6))))


@pytest.mark.parametrize("seed", range(3))
def test_radius_of_a_set_beside_the_origin_is_its_far_side(seed, random_mdp):
    region = attainable_set(random_mdp(np.random.default_rng(seed), 5, 3, 2, 0.1), 5)
    beside = AttainableSet(region.vertices + np.array([2 * region.scale, 0.0]))
    for angle in (-20.0, 0.0, 10.0):
        ray = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
        along = np.linspace(0.0, 4 * region.scale, 801)
        inside = [r for r in along if beside.contains(RewardPair(*(ray * r)), 0.0)]
        assert bool(inside)
        assert inside[0] > 0.0
        assert beside.radius(angle) == pytest.approx(inside[-1], abs=along[1])


def test_radius_by_hand():
    assert SQUARE.radius(0.0) == pytest.approx(1.0)
    assert SQUARE.radius(45.0) == pytest.approx(np.sqrt(2))
    assert SQUARE.radius(300.0) == pytest.approx(2 / np.sqrt(3))
    assert DIAMOND.radius(45.0) == pytest.approx(np.sqrt(8))
    assert DIAMOND.radius(0.0) == pytest.approx(2.0)
    assert SEGMENT.radius(45.0) == pytest.approx(np.sqrt(2))
    assert SEGMENT.radius(0.0) == pytest.approx(2.0)
    assert SEGMENT.radius(90.0) == pytest.approx(2.0)
    assert POINT.radius(45.0) == pytest.approx(np.sqrt(2))


@pytest.mark.parametrize(
    ("region", "angle"),
    [
        (DIAMOND, 90.0),
        (DIAMOND, 225.0),
        (SEGMENT, -1.0),
        (SEGMENT, 91.0),
        (SEGMENT, 225.0),
        (POINT, 44.0),
    ],
)
def test_a_ray_that_misses_is_refused(region, angle):
    with pytest.raises(UserError, match=f"at {angle:g} degrees"):
        region.radius(angle)


def test_radius_is_zero_where_only_the_origin_is_met():
    corner = AttainableSet(np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]))
    assert corner.radius(225.0) == 0.0
    assert corner.radius(45.0) == pytest.approx(np.sqrt(0.5))
    assert AttainableSet(np.zeros((1, 2))).radius(30.0) == 0.0


def test_radius_along_a_segment_is_its_far_end():
    assert AttainableSet(np.array([[2.0, 2.0], [1.0, 1.0]])).radius(45.0) == pytest.approx(8**0.5)


def test_contains_by_hand():
    for inside in [(1.0, 1.0), (0.0, -1.0), (0.3, 0.2)]:
        assert SQUARE.contains(RewardPair(*inside))
    for callbacks in [(1.001, 0.0), (0.0, -1.001)]:
        assert not SQUARE.contains(RewardPair(*callbacks))
    assert SEGMENT.contains(RewardPair(1.0, 1.0))
    assert not SEGMENT.contains(RewardPair(0.9, 1.0))
    assert not SEGMENT.contains(RewardPair(2.1, -0.1))
    assert POINT.contains(RewardPair(1.0, 1.0))
    assert not POINT.contains(RewardPair(1.0, 1.1))


def test_optimum_and_intervals_by_hand():
    best = DIAMOND.optimum(30.0)
    assert best.vertex == 0
    assert best.point == RewardPair(3.0, 1.0)
    assert best.value == pytest.approx(3 * np.cos(np.pi / 6) + 0.5)
    assert DIAMOND.supporting_interval(0) == pytest.approx((-45.0, 45.0))
    assert DIAMOND.supporting_interval(1) == pytest.approx((45.0, 135.0))
    assert SEGMENT.supporting_interval(0) == pytest.approx((-135.0, 45.0))
    assert POINT.supporting_interval(0) == (-180.0, 180.0)
    # At 0 degrees the square's whole right side ties: its upper corner dominates.
    assert SQUARE.optimum(0.0).point == RewardPair(1.0, 1.0)
    assert SQUARE.optimum(90.0).point == RewardPair(1.0, 1.0)


def test_front_is_pareto_optimal_and_in_order():
    pairs = [(4, 0), (4, 2), (3, 4), (1, 5), (0, 5), (0, 0), (2, 2)]
    region = attainable_set(bandit(pairs), 1)
    np.testing.assert_allclose(
        region.vertices, [(4, 2), (3, 4), (1, 5), (0, 5), (0, 0), (4, 0)], atol=1e-12
    )
    np.testing.assert_allclose(region.front(), [(4, 2), (3, 4), (1, 5)], atol=1e-12)
    np.testing.assert_allclose(SQUARE.front(), [(1, 1)])
    np.testing.assert_allclose(POINT.front(), [(1, 1)])
    np.testing.assert_allclose(SEGMENT.front(), [(2, 0), (0, 2)])


@pytest.mark.parametrize(
    ("pairs", "vertices"),
    [
        ([(1, 2)], [(1, 2)]),
        ([(0, 0), (0, 0)], [(0, 0)]),
        ([(0.6, 0), (0, 0), (1, 0), (0.4, 0)], [(1, 0), (0, 0)]),
        ([(0, 0.4), (0, 0), (0, 1), (0, 0.6)], [(0, 1), (0, 0)]),
        ([(1, 1), (0, 0), (3, 3), (2, 2)], [(3, 3), (0, 0)]),
        ([(0, 1), (2, 1), (1, 0), (1, 1), (1, 2)], [(2, 1), (1, 2), (0, 1), (1, 0)]),
        ([(1, 0), (1, 2), (1, 1), (0, 1)], [(1, 2), (0, 1), (1, 0)]),
        ([(1, 1), (0, 2), (2, 0), (0, 0)], [(2, 0), (0, 2), (0, 0)]),
        ([(1e9, 1), (1e9, 2)], [(1e9, 1.5)]),
    ],
)
def test_points_segments_and_ties_leave_only_vertices(pairs, vertices):
    found = attainable_set(bandit(pairs), 1).vertices
    assert len(found) == len(vertices)
    np.testing.assert_allclose(found, vertices, atol=0.5 if pairs[0][0] == 1e9 else 1e-12)


def test_attainable_set_refuses_a_horizon_of_nothing():
    with pytest.raises(UserError, match="horizon 0"):
        attainable_set(bandit([(1, 1)]), 0)
