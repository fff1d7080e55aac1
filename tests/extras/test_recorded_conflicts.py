"""Conflicts of hand-made traffic with known answers, and of the recorded scenarios.

Two lanes cross at right angles in the origin. Vehicles are 4 m long and 2 m wide, and 0.3 m
narrower in a conflict, so that the area is a square of 1.7 m: a vehicle enters it with its middle
2.85 m before the origin, and leaves it 2.85 m behind.
"""

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("shapely", reason="extra `maps` is not installed")


from socialiq.cli.main import main
from socialiq.results_folder import load
from socialiq_recordings import files
from socialiq_recordings.conflicts.encounters import ConflictConfig, Encounters, held
from socialiq_recordings.conflicts.measures import UNAVOIDABLE, required_at, rows_of, ttc_at
from socialiq_recordings.conflicts.ways import Occupancy
from socialiq_recordings.conflicts.yielding import who_yields
from socialiq_recordings.readers.commonroad import read_commonroad
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import Colour, Cycle, Lanelet, RoadNetwork, Sign
from socialiq_recordings.road.routes import Scene

FOLDER = os.environ.get("SOCIALIQ_COMMONROAD_DATA", "")
DT = 0.1
EDGE = 0.85 + 2.0  # m from the origin to a vehicle's middle as its bumper is at the area's edge
RESULTS = Path(__file__).parents[2] / "results" / "recordings-conflicts"


def lane(identity, start, end, **more):
    ends = np.array([start, end], np.float64)
    along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    left = np.array([-along[1], along[0]]) * 1.75
    return Lanelet(identity, ends + left, ends - left, **more)


CROSSROADS = RoadNetwork(
    {
        1: lane(1, (-80, 0), (120, 0), sign=Sign.PRIORITY),
        2: lane(2, (0, -80), (0, 120), sign=Sign.YIELD),
    }
)
# Lane 2 joins lane 1 at the origin; both go on as lane 3.
JUNCTION = RoadNetwork(
    {
        1: lane(1, (-80, 0), (0, 0), successors=(3,)),
        2: lane(2, (-70, -40), (0, 0), successors=(3,)),
        3: lane(3, (0, 0), (120, 0), predecessors=(1, 2)),
    }
)


def speeds_to_metres(speed):
    return np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * DT)])


def east(start, speed):
    """x from `start` on, at speeds by frame."""
    made = start + speeds_to_metres(speed)
    return made, np.zeros(len(made)), np.zeros(len(made)), speed


def north(start, speed):
    made = start + speeds_to_metres(speed)
    return np.zeros(len(made)), made, np.full(len(made), np.pi / 2), speed


def steady(speed, frames=100):
    return np.full(frames, float(speed))


def recording(*driven, road=CROSSROADS, users=None):
    """Cars, or road users of other classes: a pedestrian is 0.5 m long and wide."""
    users = np.array([RoadUser.CAR] * len(driven) if users is None else users, np.int8)
    small = users == RoadUser.PEDESTRIAN
    sizes = [len(one[0]) for one in driven]
    x, y, heading, speed = (np.concatenate(column) for column in zip(*driven, strict=True))
    count = len(driven)
    tracks = Tracks(
        np.repeat(np.arange(count, dtype=np.int32), sizes),
        np.concatenate([np.arange(size, dtype=np.int32) for size in sizes]),
        x,
        y,
        heading,
        speed * np.cos(heading),
        speed * np.sin(heading),
        np.arange(count) + 1,
        users,
        np.where(small, 0.5, 4.0),
        np.where(small, 0.5, 2.0),
        DT,
        "hand-made",
        {"made_by": "a test"},
    )
    return Recording(tracks, road)


def found(*driven, road=CROSSROADS, users=None, **more):
    encounters = Encounters(Scene(recording(*driven, road=road, users=users)), **more)
    return encounters, rows_of(encounters, encounters.meetings())


def heading_to(degrees, start, speed):
    """States towards the origin and on, from `start` m before it."""
    along = speeds_to_metres(speed) - start
    heading = np.full(len(along), math.radians(degrees))
    return along * np.cos(heading), along * np.sin(heading), heading, speed


def passing(beside):
    """A rider to the west who swerves by some metres, and is level with the origin after 10 s."""
    x, y, heading, speed = heading_to(180.0, 50, steady(5, 200))
    return x, y + beside * np.clip((12 - np.abs(x)) / 8, 0, 1), heading, speed


RIDERS = {"road": RoadNetwork({}), "users": [RoadUser.BICYCLE] * 2, "everybody": True}
OF_ORDER = ("ego_first", "pet", "ttc", "required_deceleration", "ego_lost", "gap_accepted")


@pytest.mark.parametrize(("beside", "clearance"), [(0.5, -1.5), (3.5, 1.5)])
def test_who_meet_head_on_in_shared_space_have_a_lateral_clearance(beside, clearance):
    """Riders of 2 m width on one line, who swerve or don't: neither crosses the other's way."""
    _, rows = found(east(-50, steady(5, 200)), passing(beside), **RIDERS)
    assert len(rows) == 2
    for row in rows:
        assert row["kind"] == "head_on" and row["angle"] > 150
        assert row["lateral_clearance"] == pytest.approx(clearance, abs=0.05)
        assert {name: row[name] for name in OF_ORDER} == dict.fromkeys(OF_ORDER)
    [counts] = who_yields(rows)
    assert counts["conflicts"] == 1 and counts["with_pet"] == counts["ordered"] == 0


def test_a_picture_of_two_who_meet_head_on_and_no_vehicle(tmp_path, capsys):
    path = tmp_path / "riders.safetensors"
    riders = {name: RIDERS[name] for name in ("road", "users")}
    files.save(path, recording(east(-50, steady(5, 200)), passing(3.5), **riders))
    call = ["data", "conflicts", str(path), "--out", str(tmp_path / "out"), "--pictures", "1"]
    assert main([*call, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["head_on"] == 1
    assert [drawn.name for drawn in (tmp_path / "out").glob("*.png")] == ["conflict-01.png"]


@pytest.mark.parametrize(("on_lanes", "degrees"), [(True, 165), (False, 140)])
def test_a_turn_across_oncoming_traffic_is_a_crossing(on_lanes, degrees):
    ways = east(-50, steady(10)), heading_to(degrees, 65, steady(10))
    end = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    road = RoadNetwork({1: lane(1, (-80, 0), (120, 0)), 2: lane(2, -80 * end, 120 * end)})
    _, rows = found(*ways, **({"road": road} if on_lanes else RIDERS))
    assert [row["kind"] for row in rows] == ["crossing"] * 2
    assert rows[0]["angle"] == pytest.approx(degrees, abs=1.0)
    assert rows[0]["pet"] is not None and rows[0]["lateral_clearance"] is None


def test_more_than_a_tyre_brakes_is_unavoidable(tmp_path, capsys):
    """The first creeps across the area; the second drives into it at 15 m/s."""
    ways = east(-4, steady(0.5)), north(-60, steady(15))
    _, rows = found(*ways)
    needed = [(row["required_deceleration"], row["other_required_deceleration"]) for row in rows]
    assert needed == [(0.0, UNAVOIDABLE), (UNAVOIDABLE, 0.0)]
    path = tmp_path / "hand-made.safetensors"
    files.save(path, recording(*ways))
    call = ["data", "conflicts", str(path), "--out", str(tmp_path / "out"), "--pictures", "1"]
    assert main([*call, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["unavoidable"] == 1


def test_pet_gap_and_times_of_a_crossing():
    # The first is at the origin after 3 s, the second after 5 s, both at 10 m/s.
    _, rows = found(east(-30, steady(10)), north(-50, steady(10)))
    assert [(row["ego"], row["other"]) for row in rows] == [(1, 2), (2, 1)]
    one, two = rows
    assert one["kind"] == "crossing" and one["angle"] == pytest.approx(90)
    assert (one["x"], one["y"]) == pytest.approx((0, 0), abs=1e-9)
    assert (one["ego_sign"], one["other_sign"]) == ("priority", "yield")
    assert one["ego_first"] and not two["ego_first"]
    assert one["ego_enters"] == pytest.approx(3 - EDGE / 10)
    assert one["ego_leaves"] == pytest.approx(3 + EDGE / 10)
    assert one["pet"] == two["pet"] == pytest.approx(2 - 2 * EDGE / 10)
    assert one["lag_accepted"] == pytest.approx(2.0) and one["gap_accepted"] is None
    assert two["lag_accepted"] is None  # it went second
    assert one["ttc"] is None  # never on a collision course
    assert one["required_deceleration"] == two["required_deceleration"] == 0.0


def at(measure, meeting, frame=10):
    """A measure at one frame."""
    row = meeting.frames.tolist().index(frame)
    return measure(meeting, frame, tuple(Occupancy(*times[row]) for times in meeting.times))


def test_a_collision_course_by_hand():
    # At the origin after 5 s and 5.2 s: the second arrives before the first has left.
    encounters, rows = found(east(-50, steady(10)), north(-52, steady(10)))
    assert rows[0]["pet"] == pytest.approx(0.2 - 2 * EDGE / 10)
    one, two = encounters.meetings()
    # After 1 s: 4.2 s less EDGE to the later arrival; the first leaves after 4 s and EDGE more.
    assert at(ttc_at, one) == at(ttc_at, two) == pytest.approx(4.2 - EDGE / 10)
    gap, seconds = 42 - EDGE, 4 + EDGE / 10
    assert at(required_at, two) == pytest.approx(2 * (10 * seconds - gap) / seconds**2)
    assert at(required_at, one) == 0.0
    # The least TTC is that of the last frame before the first leaves; 0 once both are inside.
    assert rows[0]["ttc"] == rows[1]["ttc"] == 0.0


def test_the_gap_between_two_of_a_stream():
    # The stream on lane 1 passes at 2 and 8 s; the vehicle of lane 2 passes at 5 s.
    _, rows = found(east(-20, steady(10)), east(-80, steady(10)), north(-50, steady(10)))
    third = {row["other"]: row for row in rows if row["ego"] == 3}
    assert third[2]["gap_accepted"] == pytest.approx(6.0)
    assert third[2]["lag_accepted"] is None
    assert third[1]["gap_accepted"] is None  # it came after that one


def test_who_queues_behind_another_is_in_no_conflict_with_crossing_traffic():
    # The third would be at the origin after 6.5 s, and the second, 15 m before it, after 5 s.
    _, rows = found(east(-46, steady(10)), north(-50, steady(10)), north(-65, steady(10)))
    assert {(row["ego"], row["other"]) for row in rows} == {(1, 2), (2, 1)}
    config = ConflictConfig(queued=True)
    cars = east(-46, steady(10)), north(-50, steady(10)), north(-65, steady(10))
    assert len(found(*cars, config=config)[1]) == 4
    # Without the second, it is the third's conflict.
    _, rows = found(east(-46, steady(10)), north(-65, steady(10)))
    assert len(rows) == 2


def lit(*phases):
    """The crossroads with lights 5 m before the origin; those of lane 2 alone have states."""
    cycle = Cycle(phases) if phases else None
    return RoadNetwork(
        {
            1: lane(1, (-80, 0), (-5, 0), successors=(11,), sign=Sign.LIGHT),
            11: lane(11, (-5, 0), (120, 0), predecessors=(1,)),
            2: lane(2, (0, -80), (0, -5), successors=(12,), sign=Sign.LIGHT, cycle=cycle),
            12: lane(12, (0, -5), (0, 120), predecessors=(2,)),
        }
    )


STOPS = north(-52, np.interp(np.arange(120) * DT, [0, 1, 7, 12], [10, 10, 0, 0]))  # at -12


@pytest.mark.parametrize(
    ("phases", "conflicts"),
    [
        ((), 2),
        (((Colour.GREEN, 900),), 2),
        (((Colour.INACTIVE, 900),), 2),
        (((Colour.RED, 900),), 0),
    ],
)
def test_who_stands_at_a_red_light_yields_to_nobody(phases, conflicts):
    _, rows = found(east(-50, steady(10)), STOPS, road=lit(*phases))
    assert len(rows) == conflicts


def test_a_light_holds_those_before_it_while_it_is_closed():
    road = lit((Colour.RED, 20), (Colour.RED_YELLOW, 5), (Colour.GREEN, 20), (Colour.YELLOW, 15))
    encounters, _ = found(east(-50, steady(10)), STOPS, road=road)
    ways = encounters.ways
    at = [held(encounters.scene, ways[1], frame) for frame in (0, 19, 24, 25, 44, 45, 59, 60)]
    assert at == [True, True, True, False, False, True, True, True]
    assert not held(encounters.scene, ways[0], 0)
    # 35 m a second: the light, 5 m before the origin, is passed after 1.9 s, and too far at first.
    fast, _ = found(north(-72, steady(35, 40)), road=lit((Colour.RED, 900)))
    assert [held(fast.scene, fast.ways[0], frame) for frame in (0, 6, 18, 20)] == [
        False,
        True,
        True,
        False,
    ]


def test_far_apart_in_time_is_no_conflict():
    assert found(east(-20, steady(10, 60)), north(-79, steady(4, 300)))[1] == []


def test_vehicles_that_follow_each_other_are_no_conflict():
    assert found(east(-30, steady(10)), east(-45, steady(10)))[1] == []


def test_a_merge_is_measured_at_the_line_where_ways_join():
    angle = math.atan2(40, 70)
    length = math.hypot(70, 40)
    metres = 20.0 + speeds_to_metres(steady(10))  # on its lane, the origin after 60.6 m
    x = np.where(metres < length, -70 + metres * math.cos(angle), metres - length)
    y = np.where(metres < length, -40 + metres * math.sin(angle), 0.0)
    joins = x, y, np.where(metres < length, angle, 0.0), steady(10)
    _, rows = found(east(-40, steady(10)), joins, road=JUNCTION)
    one, two = rows
    assert one["kind"] == two["kind"] == "merging"
    assert one["ego_enters"] < one["ego_leaves"] < one["other_enters"]
    # The same lengths and speeds: the rear passes the line 0.4 s after the front.
    assert one["ego_leaves"] - one["ego_enters"] == pytest.approx(0.4, abs=0.01)
    # 2.06 s apart at the origin, from lines of different length before it.
    assert one["pet"] == pytest.approx((length - 20) / 10 - 4.0 - 0.4, abs=0.15)


def test_the_command_writes_tables_and_pictures(tmp_path, capsys):
    path, out = tmp_path / "hand-made.safetensors", tmp_path / "conflicts"
    files.save(path, recording(east(-30, steady(10)), north(-50, steady(10))))
    call = ["data", "conflicts", str(path), "--pictures", "3"]
    assert main([*call, "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["with_pet"] == 1
    results = load(out)
    assert len(results.tables["conflicts"]) == 2
    assert [one.name for one in out.glob("*.png")] == ["conflict-01.png"]
    assert main(call) == 2 and "--out" in capsys.readouterr().err
    assert main(["data", "conflicts", str(path), "--largest-pet", "0.5"]) == 0
    assert capsys.readouterr().err.startswith("hand-made is simulated")
    assert main(["data", "conflicts", str(path), "--horizon", "-1"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


CAR, WALKER = RoadUser.CAR, RoadUser.PEDESTRIAN


@pytest.mark.parametrize("road", [CROSSROADS, RoadNetwork()])
def test_pet_of_a_car_and_a_pedestrian_with_and_without_lanelets(road):
    # The car is at the origin after 3 s at 10 m/s, the pedestrian after 6 s at 1.5 m/s. A car is
    # 1.7 m wide in a conflict, a pedestrian 0.5 m: no slack is taken off its nominal size.
    driven = east(-30, steady(10)), north(-9, steady(1.5))
    _, rows = found(*driven, road=road, users=[CAR, WALKER], everybody=True)
    assert [(row["ego"], row["other"]) for row in rows] == [(1, 2), (2, 1)]
    one, two = rows
    assert (one["ego_class"], one["other_class"]) == ("car", "pedestrian")
    leaves, arrives = 3 + (0.25 + 2.0) / 10, 6 - (0.85 + 0.25) / 1.5
    assert one["pet"] == two["pet"] == pytest.approx(arrives - leaves, abs=1e-6)
    assert (one["ego_speed"], two["ego_speed"]) == pytest.approx((10, 1.5))
    assert (one["ego_lost"], two["ego_lost"]) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert one["ego_sign"] == ("priority" if road.lanelets else "none")
    assert two["lag_accepted"] is None and one["lag_accepted"] is None  # no stream of walkers
    assert not found(*driven, road=road, users=[CAR, WALKER])[1]  # vehicles alone by default


def test_a_car_that_waits_for_a_pedestrian_lost_time():
    braking = np.concatenate([steady(10, 30), np.linspace(10, 0, 20), steady(0, 30), steady(10)])
    driven = east(-45, braking), north(-9, steady(1.5, 180))
    _, rows = found(*driven, users=[CAR, WALKER], everybody=True)
    one, two = rows
    assert not one["ego_first"] and two["ego_lost"] == pytest.approx(0.0, abs=1e-9)
    # At 10 m/s its front would be at the area (45 - 0.25 - 2) / 10 s after the beginning.
    assert one["ego_lost"] == pytest.approx(one["ego_enters"] - 4.275, abs=1e-6)


def test_two_pedestrians_are_in_no_conflict():
    driven = east(-4.5, steady(1.5)), north(-4.5, steady(1.4))
    assert not found(*driven, users=[WALKER] * 2, everybody=True)[1]
    assert found(*driven, users=[WALKER, RoadUser.BICYCLE], everybody=True)[1]


def test_who_is_left_out_of_conflicts_is_counted(tmp_path, capsys):
    driven = east(-30, steady(10)), north(-9, steady(1.5)), east(-30, steady(10))
    aside = (driven[2][0], driven[2][1] + 60.0, *driven[2][2:])
    made = recording(*driven[:2], aside, users=[CAR, WALKER, CAR])
    files.save(tmp_path / "made.safetensors", made)
    call = ["data", "conflicts", str(tmp_path / "made.safetensors"), "--out", str(tmp_path / "out")]
    assert main([*call, "--json"]) == 0
    row = {"road_user": "car", "read": 2, "used": 1, "left_out": 1}
    row["why"] = "beside the lanelets of the map"
    users = json.loads(capsys.readouterr().out)["road_users"]
    assert users[0] == row and (users[1]["used"], users[1]["why"]) == (1, "")
    assert [one["used"] for one in load(tmp_path / "out").tables["road_users"]] == [1, 1]


@pytest.mark.recorded
@pytest.mark.skipif(not FOLDER, reason="SOCIALIQ_COMMONROAD_DATA names no folder")
def test_a_part_of_the_committed_conflicts_made_again():
    committed = load(RESULTS).tables["conflicts"]
    for name in ("USA_Peach-2_1_T-1", "USA_Lanker-1_17_T-1"):
        scene = Scene(read_commonroad(Path(FOLDER) / f"{name}.xml").recording)
        encounters = Encounters(scene)
        rows = rows_of(encounters, encounters.meetings())
        there = [row for row in committed if row["recording"] == name]
        assert [(row["ego"], row["other"]) for row in rows] == [
            (row["ego"], row["other"]) for row in there
        ]
        for mine, theirs in zip(rows, there, strict=True):
            if mine["pet"] is not None:
                assert mine["pet"] == pytest.approx(theirs["pet"], abs=1e-5)
