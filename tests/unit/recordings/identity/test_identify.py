"""Sites, chains and vehicles of sets of recordings whose truth is known."""

import dataclasses

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq_recordings.identity.alignment import Placement
from socialiq_recordings.identity.identify import check_names, identify, identify_distinct
from socialiq_recordings.road.network import Lanelet, RoadNetwork

MOVED = Placement(1.0, np.array([30.0, 5.0]))


@pytest.fixture
def four(make):
    """Two overlapping windows of one day, another day there, and another place."""
    whole = make.traffic()
    windows = [make.window(whole, 0, 60, "a"), make.window(whole, 40, 100, "b")]
    windows[1] = make.written(windows[1], MOVED)
    here = make.junction(make.t)
    return [
        make.recording(windows[0], here),
        make.recording(windows[1], make.junction(make.t, turn=1.0, x=30.0)),
        make.recording(dataclasses.replace(make.traffic(7), recording="c"), here),
        make.recording(dataclasses.replace(make.traffic(8), recording="d"), make.junction(make.y)),
    ]


def test_sites_are_places_and_chains_share_vehicles(four):
    found = identify(four)
    assert found.site == ("a", "a", "a", "d")
    assert found.chain == ("a", "a", "c", "d")
    [row] = found.rows()
    assert row == {"first": "a", "second": "b", "seconds": 2.0, "lag": -4.0, "vehicles": 8}
    assert found.n_vehicles == 3 * 8
    np.testing.assert_array_equal(found.vehicle[0], found.vehicle[1])


def test_consecutive_windows_are_chained_by_numbers_and_sizes(make):
    whole = make.traffic()
    one, two = make.window(whole, 0, 50, "a"), make.window(whole, 50, 100, "b")
    road = make.junction(make.t)
    found = identify([make.recording(one, road), make.recording(two, road)])
    assert found.chain == ("a", "a") and found.overlaps[0].seconds == 0.0
    assert found.n_vehicles == 8
    # The same numbers of vehicles of other sizes are another day's.
    other = dataclasses.replace(two, length=two.length + 0.1)
    found = identify([make.recording(one, road), make.recording(other, road)])
    assert found.chain == ("a", "b") and found.n_vehicles == 16


def test_scenarios_of_one_commonroad_map_are_one_site(make):
    names = ("USA_Lanker-1_1_T-1", "USA_Lanker-1_2_T-1")
    tracks = [make.traffic(1), make.traffic(2)]
    roads = [make.junction(make.t), make.junction(make.y)]
    found = identify(
        [
            make.recording(dataclasses.replace(one, recording=name), road)
            for one, name, road in zip(tracks, names, roads, strict=True)
        ]
    )
    assert found.site == ("USA_Lanker-1", "USA_Lanker-1") and found.chain == names


def test_all_overlaps_are_named_at_once(four):
    with pytest.raises(UserError, match=r"in a and b \(2.0 s, 8 vehicles\): leave"):
        identify_distinct(four, "refuse")
    assert len(identify_distinct(four[1:], "refuse").names) == 3
    with pytest.raises(UserError, match="two recordings are named 'a'"):
        check_names(["a", "b", "a"])


def test_a_small_road_that_a_large_one_contains_either_way_is_no_site(make):
    # A bend of 40 m lies on a ring, wherever and however it is drawn, and so does its mirror image.
    angles = np.linspace(0, 2 * np.pi, 121)
    both = [np.stack([np.cos(a), np.sin(a)], axis=1) for a in (angles, -angles)]
    ring = _road([30.0 * side for side in both])
    bend = _road([30.0 * both[0][:26] + np.array([500.0, 80.0])])
    other = _road([30.0 * side + np.array([900.0, 0.0]) for side in both] + [_far()])
    names = ("ring", "bend", "other")
    tracks = [dataclasses.replace(make.traffic(n), recording=name) for n, name in enumerate(names)]
    found = identify(
        [make.recording(t, r) for t, r in zip(tracks, (ring, bend, other), strict=True)]
    )
    assert found.site[1] == "bend"


def test_a_map_in_two_larger_ones_does_not_join_them(make):
    # An arm of 40 m lies in two junctions; a junction that lacks an arm lies in one of them.
    third = (0.0, 2.2, 4.1)
    roads = {"t": make.junction(make.t), "arm": make.junction((0.0,)), "y": make.junction(third)}
    roads["crop"] = RoadNetwork({n: roads["y"].lanelets[n] for n in (0, 1, 3)})
    tracks = [dataclasses.replace(make.traffic(n), recording=name) for n, name in enumerate(roads)]
    recordings = [make.recording(t, roads[t.recording]) for t in tracks]
    for order in ([0, 1, 2, 3], [1, 2, 0, 3], [3, 2, 1, 0]):
        found = identify([recordings[number] for number in order])
        site = dict(zip(found.names, found.site, strict=True))
        assert site["y"] == site["crop"] and len({*site.values()}) == 3
    # One that lies in maps of one site is there.
    assert set(identify(recordings[1:]).site) == {"arm"}


def _road(lines):
    lanelets = {}
    for number, line in enumerate(lines):
        steps = np.gradient(line, axis=0)
        across = np.column_stack([-steps[:, 1], steps[:, 0]]) / np.hypot(*steps.T)[:, None]
        lanelets[number] = Lanelet(number, line + 1.5 * across, line - 1.5 * across)
    return RoadNetwork(lanelets)


def _far():
    return np.stack([np.linspace(1000.0, 1300.0, 60), np.linspace(0.0, 90.0, 60) ** 1.2], axis=1)
