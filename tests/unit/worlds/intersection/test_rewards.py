"""Reward pair by hand: snapshots annotated by the core, compared with Eq 4.1 and 4.2.

The ego comes from the south on x = 2; its approach ends at y = 11, 100 m from where it began.
"""

import math

import numpy as np
import pytest

from socialiq.types import Ending
from socialiq.worlds.highway.network import APPROACH, EXIT
from socialiq.worlds.highway.options import SIGNALS, Contact
from socialiq.worlds.intersection.core.geometry import LEFT
from socialiq.worlds.intersection.options import Options

EAST, NORTH, WEST = 0.0, -90.0, 180.0
WEST_APPROACH, EAST_APPROACH, WEST_EXIT = 5, 15, 14


def signals(made):
    return dict(zip(SIGNALS, made.signals[0].tolist(), strict=True))


def pair(made):
    return made.rewards[0].tolist()


@pytest.fixture(scope="module")
def ego(car):
    """The ego on its way to the west."""

    def make(y, speed, x=2.0, lane=APPROACH, degrees=NORTH, **fields):
        route = {"lane": lane, "target_lane": lane, "destination": 1}
        return car(x, y, degrees, speed, **route, **fields)

    return make


@pytest.fixture(scope="module")
def crossing(car):
    """A car on the western approach, on its way to the east."""

    def make(x, speed, y=2.0, lane=WEST_APPROACH, origin=1, **fields):
        lanes = {"lane": lane, "target_lane": lane}
        return car(x, y, EAST, speed, origin=origin, destination=3, **lanes, **fields)

    return make


@pytest.fixture(scope="module")
def scene(ego, crossing, annotated):
    """Two crossing cars, 17.7 and 18.4 m from an ego that came 4.5 m nearer, lose 2 and 0.5 m/s."""

    def make(ego_after=None, options=None, lost=(2.0, 0.5), **rest):
        before = [ego(19.5, 4.5), crossing(-14, 8.0), crossing(-15, 8.0)]
        speeds = [8.0 - loss for loss in lost]
        after = [crossing(-10, speeds[0]), crossing(-11, speeds[1])]
        return annotated(before, [ego_after or ego(15.0, 4.5), *after], options, **rest)

    return make


ROLLING = 2 * 4.5 / 28 + 0.5 * 0.5 - 0.15


def test_both_rewards_by_hand(scene):
    made = scene()
    expected = {"progress": 4.5 / 28, "speed": 0.5, "step": 1, "yielding": 1.0, "disruption": 0.4}
    assert signals(made) == pytest.approx(dict.fromkeys(SIGNALS, 0) | expected)
    assert pair(made) == pytest.approx([ROLLING, 0.2 * 1.0 - 0.4])
    assert made.braking[0, :3].tolist() == [False, True, False]
    assert (made.ending[0], made.speed[0]) == (Ending.NONE, 4.5)


def test_as_printed_every_neighbour_is_charged(scene):
    made = scene(options=Options(disruption="literal"))
    assert signals(made)["disruption"] == pytest.approx(0.4 + 0.2)
    assert made.braking[0, :3].tolist() == [False, True, True]


@pytest.mark.parametrize(
    ("lost", "dead_zone", "literal"),
    [
        ((0.0, 0.0), 0.0, 0.4),
        ((-3.0, 1.0), 0.0, 0.4),
        ((1.5, 1.0), 0.3, 0.5),
        ((5.0, 0.0), 1.0, 1.2),
        ((7.0, 8.0), 2.0, 2.0),
    ],
)
def test_loss_of_speed_has_a_threshold_and_a_cap(lost, dead_zone, literal, scene):
    assert signals(scene(lost=lost))["disruption"] == pytest.approx(dead_zone)
    printed = scene(lost=lost, options=Options(disruption="literal"))
    assert signals(printed)["disruption"] == pytest.approx(literal)


def test_threshold_cap_and_weights_are_options(scene):
    options = Options(
        speed_threshold=0.2, speed_cap=1.0, disruption_weight=-3.0, yielding_weight=0.0
    )
    assert pair(scene(options=options))[1] == pytest.approx(-3.0 * (1.0 + 0.5))


@pytest.mark.parametrize(
    ("speed", "ratio"), [(9.0, 0.0), (0.0, 1.0), (12.0, 0.0), (-1.0, 1.0), (2.25, 0.75)]
)
def test_yielding_is_the_part_of_the_speed_that_is_left(speed, ratio, ego, scene):
    assert signals(scene(ego(15.0, speed)))["yielding"] == pytest.approx(2 * ratio)
    assert signals(scene(ego(15.0, speed)))["speed"] == pytest.approx(1 - ratio)


def test_nobody_yields_to_nobody(ego, annotated):
    made = annotated([ego(19.5, 4.5)], [ego(15.0, 0.0)])
    assert pair(made)[1] == 0.0


@pytest.mark.parametrize(("x", "counted"), [(13.99, True), (14.0, True), (14.01, False)])
def test_neighbours_count_up_to_20_m(x, counted, ego, crossing, annotated):
    cars = [ego(15.0, 0.0), crossing(x, 8.0, y=-1.0)]  # 12 m to the side, 16 m ahead
    assert signals(annotated(cars, cars))["yielding"] == counted
    near = annotated(cars, cars, Options(conflict_distance=19.0))
    assert signals(near)["yielding"] == 0


def test_the_distance_is_that_at_the_end_of_the_decision(ego, crossing, annotated):
    here, there = [ego(15.0, 0.0), crossing(-10, 8.0)], [ego(15.0, 0.0), crossing(-20, 8.0)]
    assert signals(annotated(there, here))["yielding"] == 1
    assert signals(annotated(here, there))["yielding"] == 0


@pytest.mark.parametrize(
    ("zone", "from_", "until"),
    [
        ("last_20_m", 80.0, 100.0),
        ("last_8_m", 92.0, 100.0),
        ("beyond_8_m", 8.0, 100.0),
        ("travelled_8_m", 68.0, 100.0),
    ],
)
def test_the_influence_zone_ends_with_the_approach(zone, from_, until, ego, annotated):
    for along, within in ((from_ - 0.1, False), (from_ + 0.1, True), (until - 0.1, True)):
        cars = [ego(111 - along, 0.0), ego(111 - along - 7, 0.0)]
        found = signals(annotated(cars, cars, Options(zone=zone), start=60.0))
        assert found["yielding"] == within


@pytest.mark.parametrize("zone", ["last_20_m", "last_8_m", "beyond_8_m", "travelled_8_m"])
def test_the_junction_is_in_the_zone_and_the_exit_is_not(zone, ego, crossing, annotated):
    for lane, within in ((LEFT, True), (WEST_EXIT, False), (EXIT, False)):
        cars = [ego(2.0, 0.0, lane=lane), crossing(-10, 8.0)]
        made = annotated(cars, cars, Options(zone=zone), start=60.0)
        assert signals(made)["yielding"] == within
        assert signals(made)["disruption"] == 0


@pytest.mark.parametrize(
    ("origin", "lane", "kinds"),
    [
        (1, WEST_APPROACH, {"all", "cross", "approaching"}),
        (3, EAST_APPROACH, {"all", "cross", "approaching"}),
        (1, WEST_APPROACH + LEFT, {"all", "cross"}),
        (1, WEST_EXIT, {"all"}),
        (0, APPROACH, {"all"}),
        (0, LEFT, {"all"}),
    ],
)
def test_who_counts(origin, lane, kinds, ego, crossing, annotated):
    cars = [ego(15.0, 0.0), crossing(-10, 8.0, lane=lane, origin=origin)]
    for counted in ("all", "cross", "approaching"):
        found = signals(annotated(cars, cars, Options(counted=counted)))
        assert found["yielding"] == (counted in kinds)
        assert found["disruption"] == 0


def test_a_neighbour_is_where_it_steers(ego, crossing, annotated):
    """A lane's end is the next one's: the lane aimed for says who has left the junction."""
    leaving = crossing(8, 8.0, lane=WEST_APPROACH + LEFT)
    leaving["target_lane"] = WEST_EXIT
    cars = [ego(15.0, 0.0), leaving]
    assert signals(annotated(cars, cars, Options(counted="cross")))["yielding"] == 0


def test_a_collision_replaces_everything(scene, ego):
    made = scene(ego(15.0, 4.5, crashed=True), contact=Contact.EGO_STRUCK)
    assert pair(made) == [-2.0, -5.0]
    zeros = dict.fromkeys(SIGNALS, 0.0)
    assert signals(made) == zeros | {"collision": 1.0, "neighbour_collision": 1.0}
    assert (made.ending[0], made.contact[0]) == (Ending.COLLISION, Contact.EGO_STRUCK)
    assert not made.braking.any()


def test_a_collision_may_be_added_to_what_was_done_to_neighbours(scene, ego):
    made = scene(ego(15.0, 4.5, crashed=True), Options(crash="add"))
    assert pair(made) == pytest.approx([-2.0, -5.0 + 0.2 * 1.0 - 0.4])
    assert made.braking[0, :3].tolist() == [False, True, False]


def test_an_arrival_replaces_what_was_earned_on_the_way(ego, crossing, annotated):
    for x, arrived in ((-35.9, False), (-36.1, True)):  # the exit begins at x = -11
        out = ego(-2.0, 9.0, x=x, lane=WEST_EXIT, degrees=WEST)
        before = ego(-2.0, 9.0, x=x + 9, lane=WEST_EXIT, degrees=WEST)
        made = annotated([before, crossing(x, 8.0)], [out, crossing(x + 8, 3.0)], time=20.0)
        if arrived:
            assert pair(made) == [1.0, 0.0]
            assert made.ending[0] == Ending.ARRIVAL
            assert [name for name, value in signals(made).items() if value] == ["arrival"]
        else:
            assert made.ending[0] == Ending.TIMEOUT
            assert pair(made) == pytest.approx([2 * 9 / 28 + 0.5 - 0.15 - 0.5, 0])


def test_any_exit_is_an_arrival(ego, annotated):
    out = ego(2.0, 9.0, x=36.5, lane=EXIT, degrees=EAST)
    assert annotated([out], [out]).ending[0] == Ending.ARRIVAL


def test_a_collision_comes_before_an_arrival(ego, annotated):
    out = ego(-2.0, 9.0, x=-40.0, lane=WEST_EXIT, degrees=WEST, crashed=True)
    made = annotated([out], [out])
    assert made.ending[0] == Ending.COLLISION and pair(made) == [-2.0, -5.0]


def test_a_timeout_comes_on_top(scene):
    for time, ending in ((19.0, Ending.NONE), (20.0, Ending.TIMEOUT), (20.5, Ending.TIMEOUT)):
        made = scene(time=time)
        assert made.ending[0] == ending
        late = -0.5 if ending else 0.0
        assert pair(made) == pytest.approx([ROLLING + late, 0.2 - 0.4])


def test_progress_follows_the_route_through_the_turn(ego, annotated):
    def turning(along):  # the left turn's centre is (-11, 11), its radius 13 m
        angle = -along / 13
        x, y = -11 + 13 * math.cos(angle), 11 + 13 * math.sin(angle)
        return ego(y, 9.0, x=x, lane=LEFT)

    length = 13 * math.pi / 2
    out = ego(-2.0, 9.0, x=-16.0, lane=WEST_EXIT, degrees=WEST)
    for before, after, advance in (
        (ego(12.0, 9.0), turning(3.0), 4.0),
        (turning(3.0), turning(11.0), 8.0),
        (turning(18.0), out, length - 18 + 5),
        (ego(12.0, 9.0), out, 1 + length + 5),
        (ego(12.0, 9.0), ego(12.5, 9.0), -0.5),
    ):
        assert signals(annotated([before], [after]))["progress"] == pytest.approx(advance / 28)
    made = annotated([ego(12.0, 9.0)], [turning(3.0)], Options(progress_unit=2.0))
    assert signals(made)["progress"] == pytest.approx(2.0)


@pytest.mark.parametrize(("x", "on_lane"), [(3.9, True), (4.1, False), (0.1, True), (-0.1, False)])
def test_off_the_lane_nothing_is_earned(x, on_lane, ego, annotated):
    made = annotated([ego(50.0, 9.0)], [ego(41.0, 9.0, x=x)])
    earned = 2 * 9 / 28 + 0.5 if on_lane else 0.0
    assert pair(made)[0] == pytest.approx(earned - 0.15)


def test_every_weight_is_an_option(scene):
    values = {f"{name}_weight": 2.0**number for number, name in enumerate(SIGNALS)}
    made = scene(options=Options(**values))
    found = signals(made)
    expected = [
        sum(values[f"{name}_weight"] * found[name] for name in names)
        for names in (SIGNALS[:6], SIGNALS[6:])
    ]
    assert pair(made) == pytest.approx(expected)


def test_classically_everybody_is_paid_alike(ego, crossing, car, annotated):
    before = [ego(19.5, 4.5), crossing(-14, 8.0), crossing(-15, 8.0), crossing(-60, 9.0)]
    after = [
        ego(15.0, 4.5),
        crossing(-7, 6.0),
        crossing(-15, 0.0),
        crossing(-55, 9.0, crashed=True),
    ]
    made = annotated(before, after)
    others = [2 * 7 / 28 + 0.5 * 6 / 9 - 0.15, -0.15, -2.0]
    assert made.classical[0] == pytest.approx([ROLLING, sum(others) / 3])
    # who lies there is paid no second time for it
    again = annotated(after, after)
    rest = [0.5 * 6 / 9 - 0.15, -0.15, 0.5 - 0.15]
    assert again.classical[0] == pytest.approx([0.5 * 0.5 - 0.15, sum(rest) / 3])


def test_classically_arrival_and_timeout_are_worth_nothing_and_a_crash_is(ego, annotated):
    out = ego(-2.0, 9.0, x=-40.0, lane=WEST_EXIT, degrees=WEST)
    assert annotated([out], [out], time=20.0).classical[0] == pytest.approx([0.5 - 0.15, 0.0])
    wreck = ego(15.0, 4.5, crashed=True)
    assert annotated([ego(19.5, 4.5)], [wreck]).classical[0].tolist() == [-2.0, 0.0]


@pytest.mark.parametrize(
    ("already", "crashed", "touched", "collided"),
    [
        ([], [], -1, 0),
        ([], [1, 2], -1, 2),
        ([], [1, 2], 1, 2),  # a touch that was no crash
        ([], [0, 1], 1, 0),
        ([], [0, 1, 2], 1, 1),
        ([1, 2], [1, 2], -1, 0),
        ([1], [0, 1], 1, 0),
        ([1], [0, 1, 2, 3], 1, 2),
    ],
)
def test_neighbours_that_ran_into_one_another_are_counted(
    already, crashed, touched, collided, ego, crossing, annotated
):
    cars = [ego(15.0, 4.5), *(crossing(x, 8.0) for x in (-10, -20, -30))]
    before, after = [one.copy() for one in cars], [one.copy() for one in cars]
    for moment, slots in ((before, already), (after, crashed)):
        for slot in slots:
            moment[slot]["crashed"] = True
    assert annotated(before, after, touched=touched).neighbours_collided[0] == collided


def test_contact_is_told_only_of_a_crash(scene, ego):
    for crashed in (False, True):
        made = scene(ego(15.0, 4.5, crashed=crashed), contact=Contact.EGO_WAS_STRUCK)
        assert made.contact[0] == (Contact.EGO_WAS_STRUCK if crashed else Contact.NONE)


def test_the_ego_may_have_any_place_in_the_list(ego, crossing, annotated):
    cars = [ego(19.5, 4.5), crossing(-14, 8.0)], [ego(15.0, 4.5), crossing(-10, 6.0)]
    first = annotated(*cars)
    last = annotated(*(moment[::-1] for moment in cars), ego=1)
    for name in ("signals", "rewards", "classical", "speed", "reached"):
        np.testing.assert_array_equal(getattr(first, name), getattr(last, name))
    assert first.braking[0, :2].tolist() == last.braking[0, 1::-1].tolist() == [False, True]
