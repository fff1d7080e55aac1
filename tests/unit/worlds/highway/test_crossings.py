"""Places at which the lanes of a road cross crosswalks and bicycle lanes."""

import math

import numpy as np
import pytest

from socialiq.worlds.highway import network
from socialiq.worlds.highway.crossings import crossings_of, crosswalk
from socialiq.worlds.highway.network import CONFLICT, EXIT, Lane, Network, straight
from socialiq.worlds.highway.scenes import SCENES, scene_of
from socialiq.worlds.intersection.core.geometry import BESIDE, LANES, MIDDLE, ROAD


def two_lanes():
    roads = Network()
    roads.add("a", "b", Lane(straight((0.0, 0.0), (50.0, 0.0)), CONFLICT))
    roads.add("a", "b", Lane(straight((0.0, 4.0), (50.0, 4.0)), CONFLICT))
    roads.add("b", "c", Lane(straight((50.0, 0.0), (150.0, 0.0)), EXIT))
    return roads


def metres(meeting, along):
    return float(meeting["base"] - along + meeting["place"] + meeting["between"])


def test_a_vehicle_meets_a_crosswalk_on_its_lane_or_on_the_next():
    roads = two_lanes()
    ways = crosswalk(70.0, 2.0, math.pi / 2, 5.0)
    table = crossings_of(roads.lanes(), roads.routes([]), ways, has_routes=False)
    assert (table.crosswalks, len(table.ways)) == (1, 2)
    for number, along, left in ((0, 10.0, 60.0), (2, 10.0, 10.0), (2, 30.0, -10.0)):
        (meeting,) = table.meetings[:, number, 0]
        assert metres(meeting, along) == pytest.approx(left, abs=0.05)
        assert meeting["across"] == pytest.approx(-2.0, abs=1e-9)


def test_a_lane_beyond_the_ends_of_a_crosswalk_does_not_cross_it():
    roads = two_lanes()
    ways = crosswalk(20.0, 0.0, math.pi / 2, 3.0)
    table = crossings_of(roads.lanes(), roads.routes([]), ways, has_routes=False)
    assert table.meetings["base"][:, :2, 0].tolist() == [[20.0, -np.inf]]


def test_every_route_of_the_intersection_crosses_two_crosswalks():
    for origin in range(4):
        for destination in set(range(4)) - {origin}:
            meetings = ROAD.crossings.meetings[:, 5 * origin, destination]
            arms = np.flatnonzero(meetings["base"] > -np.inf)
            assert set(arms) == {origin, destination}
            way = ROAD.routes[5 * origin, destination]
            length = float(LANES["length"][way[1]])
            assert metres(meetings[origin], 0.0) == 111.0 - MIDDLE
            assert metres(meetings[destination], 0.0) == pytest.approx(104.0 + length)


def test_turns_cross_the_bicycle_lane_that_lies_beside_them():
    """A left turn from the south crosses the lanes of bicycles from the west and from the north."""
    places = ROAD.crossings.ridden[0, 1]
    assert np.flatnonzero(places[:, 0] > -np.inf).tolist() == [1, 2]
    along = places[2, 0] - 100.0
    assert 0.0 < along < LANES["length"][2]
    turn = network.points(LANES[2], 4001)
    place = turn[:, np.abs(turn[0] - along).argmin()]
    assert place[1] == pytest.approx(-BESIDE, abs=0.02)
    assert places[2, 1] == pytest.approx(place[2], abs=0.02)


@pytest.mark.parametrize("name", SCENES)
def test_vehicles_of_every_scene_come_to_a_crosswalk(name):
    road = scene_of(name).road
    assert road.crossings.crosswalks >= 1
    entries = road.entries
    meetings = road.crossings.meetings[:, entries["lane"], entries["destination"]]
    reached = (meetings["base"] > -np.inf).any(axis=0)
    assert reached.all()
    ego = meetings[:, 0][meetings["base"][:, 0] > -np.inf]
    assert all(metres(meeting, entries["along"][0]) > 5.0 for meeting in ego)
