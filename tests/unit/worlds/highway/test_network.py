"""Tables of roads: lanes in order, ways, and what a box around a lane promises."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.worlds.highway.core import geometry
from socialiq.worlds.highway.core.compile import for_python
from socialiq.worlds.highway.network import APPROACH, Lane, Network, arc, sine, straight
from socialiq.worlds.highway.scenes import _DESTINATIONS, SCENES, _roundabout_roads, scene_of

misfit, lateral = for_python(geometry.misfit), for_python(geometry.lateral)
longitudinal = for_python(geometry.longitudinal)
closest, heading_at = for_python(geometry.closest_lane), for_python(geometry.heading_at)


def test_lanes_stand_by_first_mention_of_their_start():
    lanes = scene_of("merge").road.lanes
    assert lanes["lanes"].tolist() == [2, 2, 3, 3, 3, 2, 2, 1, 1]
    roads = [(0, 1), (1, 2), (2, 3), (4, 5), (5, 1)]  # of the nodes a, b, c, d, j, k
    ends = zip(lanes["start"].tolist(), lanes["end"].tolist(), strict=True)
    assert list(dict.fromkeys(ends)) == roads
    network = Network()
    for nodes in (("k", "b"), ("b", "c"), ("b", "c"), ("a", "b"), ("k", "c")):
        network.add(*nodes, Lane(straight((0.0, 0.0), (3.0, 4.0)), APPROACH))
    assert network.roads == [("k", "b"), ("k", "c"), ("b", "c"), ("a", "b")]
    assert network.lane("b", "c", 1) == 3


def test_the_way_is_the_shortest():
    network = _roundabout_roads()
    table = network.routes(_DESTINATIONS)
    begun, nodes = network.roads.index(("ser", "ses")), _DESTINATIONS.index("nxs")
    firsts = {network.lane(*road, 0): road for road in network.roads}
    way = [firsts[lane] for lane in table[begun, nodes] if lane >= 0]
    assert [end for _, end in way] == ["ses", "se", "ex", "ee", "nx", "nxs"]


def test_a_road_without_a_way_is_the_whole_way():
    network = Network()
    for nodes in ("ab", "bc", "cd"):
        network.add(*nodes, Lane(straight((0.0, 0.0), (3.0, 4.0)), APPROACH))
    assert network.routes(["a"])[2].tolist() == [[2]]


def test_progress_counts_the_roads_of_the_task():
    lanes = scene_of("merge").road.lanes
    before = {(int(row["start"]), int(row["end"])): float(row["before"]) for row in lanes}
    assert sorted(metres for metres in before.values() if metres >= 0) == [0.0, 230.0, 310.0]
    assert np.isnan(list(before.values())).sum() == 2  # the ramp


@pytest.mark.parametrize("name", list(SCENES))
def test_the_closest_lane_does_not_depend_on_the_guess(name):
    lanes = scene_of(name).road.lanes
    rng = np.random.default_rng(0)
    low, high = lanes["low_x"].min() - 20, lanes["high_x"].max() + 20
    for _ in range(100):
        x, y, heading = rng.uniform(low, high), rng.uniform(-60, 60), rng.uniform(-4, 4)
        turned = [
            abs(
                (heading - heading_at(lane, longitudinal(lane, x, y)) + np.pi) % (2 * np.pi) - np.pi
            )
            for lane in lanes
        ]
        whole = [misfit(lane, x, y) + angle for lane, angle in zip(lanes, turned, strict=True)]
        found = {closest(lanes, x, y, heading, guess, 0.0) for guess in range(len(lanes))}
        assert len(found) == 1
        assert whole[found.pop()] == pytest.approx(min(whole), abs=1e-9)


def test_shapes_have_their_lengths_and_swings():
    network = Network()
    network.add("a", "b", Lane(straight((0.0, 0.0), (3.0, 4.0)), APPROACH))
    network.add("b", "c", Lane(sine((0.0, 0.0), (10.0, 0.0), 2.0, np.pi / 10, 0.0), APPROACH))
    network.add("c", "d", Lane(arc((0.0, 0.0), 20.0, 0.0, -np.pi / 2, -1), APPROACH))
    one, swing, circle = network.lanes()
    assert one["length"] == 5.0 and circle["length"] == pytest.approx(10 * np.pi)
    assert lateral(swing, 5.0, 2.0) == pytest.approx(0.0)
    assert lateral(swing, 10.0, 2.0) == pytest.approx(2.0)
    assert lateral(circle, 0.0, -20.0) == pytest.approx(0.0)


def test_an_unknown_scene_is_refused():
    with pytest.raises(UserError, match="choose one of merge, roundabout, two_way"):
        scene_of("motorway")
