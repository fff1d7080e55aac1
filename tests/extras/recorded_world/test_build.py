import numpy as np
import pytest
from tests.extras.recorded_world.conftest import crossing_road, tracks

from socialiq.errors import UserError
from socialiq_recordings.recording import Recording
from socialiq_recordings.road.network import RoadNetwork
from socialiq_recordings.world.build import build
from socialiq_recordings.world.lines import closures_of
from socialiq_recordings.world.recorded_world import WorldConfig


def test_vehicles_areas_and_stretches_of_the_crossing(made):
    road = made.world.road
    assert road.identity.tolist() == [11, 12, 13]
    of = road.area_of.reshape(3, 3)
    assert (np.diag(of) == -1).all() and of[1, 2] == of[2, 1] == -1
    assert (of[0, 1:] >= 0).all() and (of[1:, 0] >= 0).all()
    # The car from the west has priority.
    assert road.area_yields[of[0, 1]] == -1 and road.area_yields[of[1, 0]] == 1
    stretched = np.diff(road.stretch_first).reshape(3, 3) > 0
    assert stretched.tolist() == [[False] * 3, [False, False, True], [False, True, False]]


def test_the_conflict_area_is_where_the_lanes_cross(made):
    road = made.world.road
    entry, end = road.area[road.area_of[1], :2]
    start = road.state[road.state_first[0], 0]
    # 40 m to the middle; half of 1.8 m less the slack on both sides of it.
    assert entry - start == pytest.approx(40.0 - 0.75, abs=0.05)
    assert end - start == pytest.approx(40.0 + 0.75, abs=0.05)
    assert road.zone[0] == pytest.approx([entry - 20.0, end])


def test_states_are_the_recorded_ones(made):
    road = made.world.road
    states = road.state[road.state_first[1] : road.state_first[2]]
    assert np.diff(states[:, 0]) == pytest.approx(0.6, abs=1e-6)
    assert states[:, 1] == pytest.approx(6.0, abs=1e-6)


def test_no_line_is_closed_where_no_one_stands(made):
    assert len(made.world.road.closed) == 0
    assert closures_of(made.every[0], 0) == []


def test_a_lane_is_closed_in_front_of_one_that_stands_without_a_reason():
    standing = tracks(speeds={"west": 8.0, "south": 6.0, "behind": 0.0})
    west = standing.track == 0
    far = np.where(west, standing.x - 55.0, standing.x)  # no car comes from the west soon
    moved = {"x": far} | {n: getattr(standing, n) for n in standing.arrays() if n != "x"}
    more = {"dt": 0.1, "recording": "ZAM_Stands-1_1_T-1", "source": {}}
    recording = Recording(type(standing)(**moved, **more), crossing_road())
    world = build([recording], WorldConfig())
    road = world.world.road
    [(at, begin, end)] = road.closed[road.closed_first[-2] : road.closed_first[-1]]
    front = road.state[road.state_first[-2], 0] + 4.5 / 2
    assert at == pytest.approx(front + 1.0, abs=0.01)
    assert begin == -np.inf and end == np.inf
    none = WorldConfig(lights="none")
    again = build([recording], none)
    assert len(again.world.road.closed) == 0


def test_what_makes_no_world(crossing):
    with pytest.raises(UserError, match="no road: name its map with --road"):
        build([Recording(crossing.tracks, RoadNetwork())], WorldConfig())
    alone = crossing.tracks.select(np.array([True, False, False]))
    with pytest.raises(UserError, match="has 1 vehicles on its lanelets"):
        build([Recording(alone, crossing.road)], WorldConfig())
    both = crossing.tracks.select(np.array([False, True, True]))
    with pytest.raises(UserError, match="no vehicle has a way across a conflict area"):
        build([Recording(both, crossing.road)], WorldConfig())


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"policy_rate": 3}, "policy rate must be 1, 2, 5 or 10"),
        ({"levels": (1.0, -1.0)}, "levels must be two or more ascending numbers"),
        ({"levels": (-1.0, 1.0)}, "levels must have 0 among them"),
        ({"duration": 0.5}, "duration must be from one decision"),
        ({"observed_vehicles": 1}, "observed vehicles must be 2 to 100"),
    ],
)
def test_options_that_make_no_world(given, line):
    with pytest.raises(UserError, match=line):
        WorldConfig(**given)
