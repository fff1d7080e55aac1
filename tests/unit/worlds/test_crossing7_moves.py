import numpy as np
import pytest

from socialiq.types import Ending

STOP, SLOW, FAST = 0, 1, 2
GONE = (-1, 0)  # an empty slot
SOUTH = (0, 2)  # a vehicle just spawned
PASSED = (3, 2)  # a vehicle on the conflict cell, on its way out


def state(x, first, second=GONE, v=0):
    return (x, v, *first, *second)


def disruption(table, x, action, first, second=GONE):
    s = table.world.index(state(x, first, second))
    return table.signals["disruption"][s, action]


def test_starts_with_one_vehicle_at_the_southern_edge(table7):
    assert table7.world.start == ((state(0, SOUTH), 1.0),)
    assert table7.world.horizon == 25


def test_second_slot_may_be_filled_at_start(tabulated):
    start = tabulated("crossing7", second_slot_at_start="random").world.start
    assert start == ((state(0, SOUTH), 0.7), (state(0, SOUTH, SOUTH), 0.3))


@pytest.mark.parametrize("action", [STOP, SLOW, FAST])
def test_ego_moves_by_its_speed(action, table7, play):
    after = play(table7, state(0, SOUTH, v=1), action).state
    assert after == (action, action, 2, FAST, -1, STOP)
    assert table7.speed[table7.world.index(state(0, SOUTH, v=1)), action] == action


@pytest.mark.parametrize(
    ("action", "env"), [(STOP, -0.3), (SLOW, 0.4 * 0.5 - 0.3), (FAST, 0.4 - 0.3)]
)
def test_driving_earns_speed_and_pays_for_time(action, env, table7, play):
    assert play(table7, state(0, SOUTH), action) == (
        (action, action, 2, 2, -1, 0),
        env,
        0.0,
        Ending.NONE,
    )


@pytest.mark.parametrize(("x", "action"), [(4, FAST), (5, FAST), (5, SLOW)])
def test_arrival_replaces_the_steps_reward(x, action, table7, play):
    played = play(table7, state(x, PASSED), action)
    assert played == ((6, action, 5, 2, -1, 0), 2.0, 0.0, Ending.ARRIVAL)


def test_arrival_may_be_added(tabulated, play):
    table = tabulated("crossing7", arrival="added")
    assert play(table, state(4, PASSED), FAST).env == pytest.approx(2.1, abs=1e-15)
    assert play(table, state(5, PASSED), SLOW).env == pytest.approx(1.9, abs=1e-15)


@pytest.mark.parametrize(
    ("x", "action"),
    [(2, SLOW), (2, FAST), (1, FAST), (3, STOP)],
    ids=["enters", "crosses", "enters fast", "stands"],
)
@pytest.mark.parametrize(
    ("y", "after", "cost"),
    [(2, (2, STOP), 2.0), (1, (2, SLOW), 1.0), (0, (2, FAST), 0.0), (3, (5, FAST), 0.0)],
    ids=["at the line: full stop", "one cell before: slows", "too far", "already on the cell"],
)
def test_fast_vehicle_brakes_at_once_for_an_ego_in_conflict(
    x, action, y, after, cost, table7, play
):
    played = play(table7, state(x, (y, FAST)), action)
    assert played.state[2:4] == after
    assert played.social == -cost
    assert played.ending == Ending.NONE


@pytest.mark.parametrize(("x", "action"), [(0, FAST), (2, STOP), (3, FAST), (4, STOP)])
@pytest.mark.parametrize("v", [STOP, SLOW, FAST])
def test_vehicle_drives_on_when_the_conflict_is_free(x, action, v, table7, play):
    played = play(table7, state(x, (2, v)), action)
    assert played.state[2:4] == (4, FAST)
    assert disruption(table7, x, action, (2, v)) == 0.0


@pytest.mark.parametrize(
    ("v", "cost"), [(FAST, 2.0), (SLOW, 1.5), (STOP, 0.0)], ids=["fast", "slow", "stopped"]
)
def test_full_stop_costs_at_least_one_and_a_half(v, cost, table7):
    assert disruption(table7, 2, FAST, (2, v)) == cost


@pytest.mark.parametrize(("v", "cost"), [(FAST, 1.5), (SLOW, 1.5), (STOP, 0.0)])
def test_full_stop_may_be_flat(v, cost, tabulated):
    table = tabulated("crossing7", full_stop="flat")
    assert disruption(table, 2, FAST, (2, v)) == cost
    assert disruption(table, 2, FAST, (1, FAST)) == 1.0


def test_disruption_of_both_vehicles_adds_up(table7):
    assert disruption(table7, 2, FAST, (2, FAST), (1, FAST)) == 3.0


@pytest.mark.parametrize("y", [5, 6])
def test_leaving_is_no_disruption(y, table7, play):
    played = play(table7, state(0, SOUTH, (y, FAST)), STOP)
    assert played.state[4:] == GONE
    assert played.social == 0.0


@pytest.mark.parametrize(
    ("first", "second", "paid"),
    [
        (SOUTH, GONE, 0.2),
        ((2, STOP), GONE, 0.2),
        (SOUTH, (1, FAST), 0.4),
        (PASSED, GONE, 0.0),
        (PASSED, (2, FAST), 0.2),
        ((6, FAST), GONE, 0.0),
    ],
)
def test_stopping_before_the_conflict_is_paid_for_each_vehicle_approaching(
    first, second, paid, table7, play
):
    assert play(table7, state(2, first, second), STOP).social == paid


@pytest.mark.parametrize(
    ("x", "action"), [(0, STOP), (1, STOP), (1, SLOW), (3, STOP), (4, STOP), (2, SLOW), (2, FAST)]
)
def test_no_other_step_counts_as_yielding(x, action, table7):
    s = table7.world.index(state(x, SOUTH, SOUTH))
    assert table7.signals["yielding"][s, action] == 0.0


def test_yielding_may_be_paid_in_the_conflict_cell(tabulated):
    table = tabulated("crossing7", yield_zone="with_conflict")
    standing = table.world.index(state(3, (2, STOP), (2, STOP)))
    entering = table.world.index(state(2, SOUTH))
    assert table.signals["yielding"][standing].tolist() == [2.0, 0.0, 0.0]
    assert table.signals["yielding"][entering].tolist() == [1.0, 0.5, 0.0]


def test_slow_yields_may_be_paid_in_full(tabulated):
    table = tabulated("crossing7", yield_zone="with_conflict", slow_yield="full")
    entering = table.world.index(state(2, SOUTH))
    assert table.signals["yielding"][entering].tolist() == [1.0, 1.0, 0.0]


@pytest.mark.parametrize("y", [5, 6])
@pytest.mark.parametrize("chance", [0, 1])
def test_first_slot_is_refilled_in_the_step_it_leaves(y, chance, table7, play):
    played = play(table7, state(0, (y, FAST), SOUTH), STOP, chance)
    assert played.state == (0, 0, 0, FAST, 2, FAST)


def test_first_slot_may_spawn_once(tabulated, play):
    table = tabulated("crossing7", first_slot="once")
    assert play(table, state(0, (5, FAST), SOUTH), STOP).state[2:4] == GONE
    assert play(table, state(0, GONE, SOUTH), STOP, 1).state[2:4] == GONE


@pytest.mark.parametrize(
    ("reading", "second", "chance", "after"),
    [
        ("next_step", GONE, 0, GONE),
        ("next_step", GONE, 1, SOUTH),
        ("next_step", (5, FAST), 1, GONE),
        ("same_step", GONE, 0, GONE),
        ("same_step", (5, FAST), 0, GONE),
        ("same_step", (5, FAST), 1, SOUTH),
        ("same_step", (4, FAST), 1, (6, FAST)),
    ],
)
def test_second_slot_is_filled_by_chance(reading, second, chance, after, tabulated, play):
    table = tabulated("crossing7", second_slot_refills=reading)
    assert play(table, state(0, SOUTH, second), STOP, chance).state[4:] == after


def test_vehicles_do_not_see_each_other(table7, play):
    after = play(table7, state(0, (1, FAST), (2, STOP)), STOP).state
    assert after[2:] == (3, FAST, 4, FAST)
    assert play(table7, state(0, SOUTH, SOUTH), STOP).state[2:] == (2, FAST, 2, FAST)


def test_spawn_probability_is_that_of_the_second_outcome(tabulated):
    table = tabulated("crossing7", spawn_probability=0.25)
    assert table.world.chance == (0.75, 0.25)
    np.testing.assert_array_equal(table.mdp.probability[0, 0], [0.75, 0.25])


def test_nobody_can_collide_while_vehicles_brake_at_once(table7):
    assert not (table7.mdp.ending == Ending.COLLISION).any()


@pytest.mark.parametrize(
    ("second", "social"), [(GONE, -1.0 - 5.0), ((2, FAST), -2.0 - 5.0), ((2, STOP), -1.0 - 5.0)]
)
def test_braking_by_one_level_can_collide(second, social, tabulated, play):
    table = tabulated("crossing7", braking="one_level")
    played = play(table, state(2, (2, FAST), second), FAST)
    assert played.ending == Ending.COLLISION
    assert played.env == -5.0
    assert played.social == social


def test_a_slow_vehicle_can_stop_when_braking_by_one_level(tabulated, play):
    table = tabulated("crossing7", braking="one_level")
    played = play(table, state(2, (2, SLOW)), FAST)
    assert played.state[2:4] == (2, STOP)
    assert played.ending == Ending.NONE
    assert played.social == -1.5


def test_a_collision_outweighs_an_added_arrival(tabulated, play):
    table = tabulated("crossing7", braking="one_level", arrival="added")
    assert play(table, state(2, (2, FAST)), FAST).env == -5.0


def test_by_end_cells_nobody_meets_in_passing(tabulated, play):
    table = tabulated("crossing7", conflict="end_cell")
    assert play(table, state(2, (2, FAST)), FAST)[:3] == ((4, 2, 4, 2, -1, 0), 0.4 - 0.3, 0.0)
    stands = play(table, state(2, (1, FAST)), SLOW)
    assert stands.state[2:4] == (2, SLOW)
    assert stands.social == -1.0
