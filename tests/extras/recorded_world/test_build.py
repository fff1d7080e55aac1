import dataclasses

import numpy as np
import pytest
from tests.extras.recorded_world.conftest import crossing_road, tracks

from socialiq.errors import UserError
from socialiq_recordings.recording import Recording
from socialiq_recordings.road.network import RoadNetwork, Sign
from socialiq_recordings.world.build import build
from socialiq_recordings.world.compare import contacts
from socialiq_recordings.world.config import WorldConfig
from socialiq_recordings.world.lines import closures_of
from socialiq_recordings.world.replay import replay


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
    lit = {**recording.road.lanelets}
    lit[1] = dataclasses.replace(lit[1], sign=Sign.LIGHT)  # another approach has the only light
    elsewhere = Recording(recording.tracks, RoadNetwork(lit))
    assert len(build([elsewhere], WorldConfig()).world.road.closed) == 0
    world = build([recording], WorldConfig())
    road = world.world.road
    [(at, begin, end)] = road.closed[road.closed_first[-2] : road.closed_first[-1]]
    front = road.state[road.state_first[-2], 0] + 4.5 / 2
    assert at == pytest.approx(front + 1.0, abs=0.01)
    assert begin == -np.inf and end == np.inf
    none = WorldConfig(lights="none")
    again = build([recording], none)
    assert len(again.world.road.closed) == 0


def without_signs():
    lanes = crossing_road().lanelets
    return RoadNetwork({n: dataclasses.replace(lane, sign=Sign.NONE) for n, lane in lanes.items()})


def test_courtesy_closes_no_line():
    # The one from the west comes slowly and is let go first; the one from the south goes after it.
    time = np.arange(120) * 0.1
    west = -15.0 + 0.6 * time + np.clip(time - 1, 0, None) ** 2
    south = -14.0 + np.clip(time - 6, 0, None) ** 2 * 1.2
    still, up = np.zeros(120), np.full(120, np.pi / 2)
    vx, vy = np.gradient(west, 0.1), np.gradient(south, 0.1)
    first = tracks()
    made = dataclasses.replace(
        first.select(np.array([True, True, False])),
        track=np.repeat(np.arange(2, dtype=np.int32), 120),
        frame=np.tile(np.arange(120, dtype=np.int32), 2),
        x=np.concatenate([west, still]),
        y=np.concatenate([still, south]),
        heading=np.concatenate([still, up]),
        vx=np.concatenate([vx, still]),
        vy=np.concatenate([still, vy]),
    )
    world = build([Recording(made, without_signs())], WorldConfig()).world
    assert len(world.road.closed) == 0


def test_a_vehicle_in_view_for_longer_than_an_episode_is_demonstrated_in_parts(made):
    config = dataclasses.replace(made.world.config, duration=2.0)
    world = dataclasses.replace(made.world, config=config)
    found = replay(world).table
    assert found.episode_lengths.max() <= config.decisions
    assert found.n_transitions == replay(made.world).table.n_transitions


def test_vehicles_that_drive_through_each_other_are_counted(crossing):
    # Both are in the middle after 5 s; drivers that know no conflict area don't yield.
    met = build(
        [Recording(tracks(speeds={"west": 8.0, "south": 10.0, "behind": 6.0}), crossing_road())],
        WorldConfig(),
    )
    counts = contacts(met, 0, 2)
    assert counts["vehicles"] == 6 and counts["pairs_in_contact"] == 0
    blind = met.world.road._replace(area_of=np.full_like(met.world.road.area_of, -1))
    blind_world = dataclasses.replace(met.world, road=blind)
    seen = contacts(met._replace(world=blind_world), 0, 2)
    assert seen["pairs_in_contact"] > 0 and seen["deepest_contact"] > 0
    # In an episode, too, those that are no ego are counted, each once.
    for world, wanted in ((met.world, 0), (blind_world, 2)):
        egos = world.road._replace(egos=np.array([2]))  # the one behind
        batch = dataclasses.replace(world, road=egos).batch(1)
        batch.reset([0])
        collided = [batch.step(np.array([0]), auto_reset=False).neighbours_collided[0]]
        collided += [batch.step(np.array([0])).neighbours_collided[0] for _ in range(5)]
        assert sum(collided) == wanted


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
