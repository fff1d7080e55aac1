"""Generated roads: lanes that continue each other, and ways from each arm to each further arm."""

import itertools
import math
from functools import cache

import numpy as np
import pytest

from socialiq.worlds.highway.core.geometry import heading_at, position
from socialiq.worlds.highway.generated import (
    ACCESS,
    SMALLEST_CIRCLE,
    TURN,
    Layout,
    circle_of,
    road_of_layout,
    stop_of_crossing,
)
from socialiq.worlds.highway.network import APPROACH, CONFLICT, EXIT, LANE_WIDTH
from socialiq.worlds.intersection.core.geometry import ROAD
from socialiq.worlds.intersection.options import ALONG, SIGHT, SPEED_LIMIT

SEEDS = range(200)
DRAWN = {
    (layout.form, layout.arms, layout.lanes, layout.enters): layout
    for layout in map(Layout.of_seed, SEEDS)
}
"""A layout of each kind; what else a seed draws is the priority and the skew."""

WIDE = [
    Layout(form, arms, lanes, "main", skew, 0)
    for form in ("crossing", "roundabout")
    for arms in (3, 4, 5)
    for lanes in (1, 2)
    for skew in (-30.0, 30.0)
]
"""Layouts with the largest skew."""


@cache
def road_of(layout):
    return road_of_layout(layout, SIGHT, ALONG, SPEED_LIMIT)


def ways_of(layout, road):
    """Yield the arms of entry and exit, and the lanes of the way between them."""
    for entry, exit in itertools.permutations(range(layout.arms), 2):
        way = road.routes[road.lanes["road"][road.arrivals[entry, exit]], exit]
        yield entry, exit, [int(number) for number in way if number >= 0]


def points(lane, count=60):
    """Points along a lane, (point, 2)."""
    return np.array([position(lane, along) for along in np.linspace(0.0, lane.length, count)])


@pytest.mark.parametrize("layout", [*DRAWN.values(), *WIDE], ids=str)
def test_each_lane_continues_its_predecessor(layout):
    road = road_of(layout)
    lanes = road.lanes.view(np.recarray)
    for entry, exit, way in ways_of(layout, road):
        assert way[0] == road.arrivals[entry, exit]
        kinds = [int(lanes[number].kind) for number in way]
        assert kinds == [APPROACH, *[CONFLICT] * (len(way) - 2), EXIT]
        end = position(lanes[way[-1]], lanes[way[-1]].length)
        direction = layout.directions[exit]
        along = end[0] * math.cos(direction) + end[1] * math.sin(direction)
        right = end[1] * math.cos(direction) - end[0] * math.sin(direction)
        assert along > ACCESS
        assert 0 < right < layout.lanes * LANE_WIDTH
        for before, after in itertools.pairwise(way):
            first = lanes[before]
            gap = math.dist(position(first, first.length), position(lanes[after], 0.0))
            assert gap < 1e-9
            turn = heading_at(first, first.length) - heading_at(lanes[after], 0.0)
            assert abs(math.remainder(turn, math.tau)) < 1e-9


@pytest.mark.parametrize("layout", WIDE, ids=str)
def test_a_way_does_not_come_back_to_itself(layout):
    road = road_of(layout)
    lanes = road.lanes.view(np.recarray)
    for _, _, way in ways_of(layout, road):
        parts = [points(lanes[number]) for number in way]
        for first, second in itertools.combinations(range(len(parts)), 2):
            if second - first > 1:
                apart = np.linalg.norm(parts[first][:, None] - parts[second][None], axis=-1)
                assert apart.min() > 1.0


@pytest.mark.parametrize("layout", [layout for layout in WIDE if layout.lanes == 2], ids=str)
def test_ways_of_two_lanes_of_an_arm_do_not_cross(layout):
    road = road_of(layout)
    lanes = road.lanes.view(np.recarray)
    ways = list(ways_of(layout, road))
    for (entry, _, one_way), (other, _, other_way) in itertools.combinations(ways, 2):
        if entry == other and one_way[0] != other_way[0]:
            first = np.concatenate([points(lanes[number]) for number in one_way])
            second = np.concatenate([points(lanes[number]) for number in other_way])
            apart = np.linalg.norm(first[:, None] - second[None], axis=-1)
            assert apart.min() > LANE_WIDTH / 2


def test_a_cross_without_skew_has_the_lanes_of_the_intersection():
    layout = Layout()
    road = road_of(layout)
    lanes = road.lanes.view(np.recarray)
    crossing = ROAD.lanes.view(np.recarray)
    assert stop_of_crossing(layout) == pytest.approx(11.0)
    for entry, exit, way in ways_of(layout, road):
        usual = ROAD.routes[5 * entry, exit][:3]
        ranks = [int(lanes[number].priority) for number in way[:2]]
        assert ranks == [int(crossing[number].priority) for number in usual[:2]]
        for number, known in zip(way, usual, strict=True):
            for share in (0.0, 0.5, 1.0):
                place = position(lanes[number], share * lanes[number].length)
                assert place == pytest.approx(
                    position(crossing[known], share * crossing[known].length)
                )


@pytest.mark.parametrize("layout", WIDE, ids=str)
def test_turns_are_not_sharper_than_the_least_radius(layout):
    lanes = road_of(layout).lanes
    radii = lanes["radius"][lanes["radius"] > 0]
    assert radii.min() > TURN - 1e-9
    if layout.form == "roundabout":
        assert circle_of(layout, 0).radius >= SMALLEST_CIRCLE


def test_the_seed_draws_every_property():
    layouts = [Layout.of_seed(seed) for seed in SEEDS]
    assert layouts == [Layout.of_seed(seed) for seed in SEEDS]
    for name in Layout._fields:
        values = {getattr(layout, name) for layout in layouts}
        assert len(values) > 1
    assert {layout.arms for layout in layouts} == {3, 4, 5}
    assert {layout.priority for layout in layouts} == {"main", "stop", "none"}


def test_the_main_road_has_priority_at_a_crossing_and_the_circle_at_a_roundabout():
    crossing = road_of(Layout(enters=1)).lanes
    ranks = crossing["priority"][crossing["kind"] == APPROACH]
    assert ranks.tolist() == [3, 1, 3, 1]
    lanes = road_of(Layout("roundabout")).lanes
    on_circle = (lanes["radius"] == circle_of(Layout("roundabout"), 0).radius) & ~lanes["straight"]
    assert {*lanes["priority"][on_circle]} == {3}
    assert {*lanes["priority"][lanes["kind"] == APPROACH]} == {1}
    equal = road_of(Layout(priority="none")).lanes
    assert {*equal["priority"][equal["kind"] == APPROACH]} == {1}


def test_drivers_roll_before_an_all_way_stop_alone():
    stop = road_of(Layout(priority="stop")).lanes
    assert (stop["slow_from"][stop["kind"] == APPROACH] == ACCESS - 8.0).all()
    assert np.isinf(stop["slow_from"][stop["kind"] != APPROACH]).all()
    assert np.isinf(road_of(Layout()).lanes["slow_from"]).all()
