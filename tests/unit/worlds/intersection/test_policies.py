"""Rule-based drivers, on hand-made observations: the ego is at (2, y); its stop line at y = 11."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.types import Ending, Policy
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.options import FASTER, IDLE, SLOWER, Options
from socialiq.worlds.intersection.world import Intersection

BEFORE = 15.0  # y of an ego that judges gaps


def view(y, *others, vehicles=4, speed=9.0):
    """An observation of the ego and others, each (x, y, vx, vy)."""
    seen = np.zeros((vehicles, 7), np.float32)
    seen[0] = 1, 0.02, y / 100, 0, -speed / 20, 0, -1
    for row, (x, y_other, vx, vy) in enumerate(others, start=1):
        seen[row] = 1, x / 100, y_other / 100, vx / 20, vy / 20, 1, 0
    return seen.ravel()


def act(name, *arguments, **changes):
    return int(policies.policy(name).predict(view(*arguments, **changes))[0])


@pytest.mark.parametrize(("name", "action"), [("go", FASTER), ("wait", SLOWER), ("idle", IDLE)])
def test_some_always_do_the_same(name, action):
    for others in ([], [(-10, 2, 8, 0)]):
        for y in (60, 15, 0, -20):
            assert act(name, y, *others) == action


@pytest.mark.parametrize(
    ("y", "action"),
    [(60, FASTER), (22.5, FASTER), (21.5, SLOWER), (15, SLOWER), (10, SLOWER), (-5, SLOWER)],
)
def test_the_stopper_brakes_11_m_before_the_stop_line(y, action):
    assert act("stop_line", y) == action


@pytest.mark.parametrize(
    ("other", "action"),
    [
        ((-30, 2, 8, 0), SLOWER),  # 21 m from the junction, there in 2.6 s
        ((-34, 2, 8, 0), FASTER),  # in 3.1 s
        ((30, -2, -8, 0), SLOWER),
        ((-2, -30, 0, 8), SLOWER),
        ((-30, 2, -8, 0), FASTER),  # leaves
        ((-30, -2, -8, 0), FASTER),
        ((0, 0, 8, 0), SLOWER),  # is in the middle
        ((5, 0, 8, 0), SLOWER),  # leaves, but isn't out yet
        ((9.5, 2, 8, 0), FASTER),  # is out
        ((-9.5, 2, 0, 0), FASTER),  # stands before the junction
        ((2, 25, 0, -8), FASTER),  # behind on the ego's lane
        ((2, -5, 0, -2), SLOWER),  # before it, in the junction
        ((-2, 25, 0, 8), FASTER),  # has left towards the south
    ],
)
def test_gaps_are_judged_by_who_will_cross(other, action):
    assert act("gap_3s", BEFORE, other) == action
    assert act("gap_3s", BEFORE, (90, -2, -8, 0), other) == action


def test_a_gap_has_a_length():
    for seconds in (2, 3, 4):
        for time, action in ((seconds - 0.1, SLOWER), (seconds + 0.1, FASTER)):
            assert act(f"gap_{seconds}s", BEFORE, (-9 - 8 * time, 2, 8, 0)) == action


@pytest.mark.parametrize(
    ("y", "action"), [(60, FASTER), (31.5, FASTER), (30.5, SLOWER), (11.5, SLOWER), (10.5, FASTER)]
)
def test_gaps_are_judged_in_the_last_20_m(y, action):
    assert act("gap_3s", y, (-15, 2, 8, 0)) == action


def test_nobody_there_is_nobody_in_the_way():
    assert act("gap_4s", BEFORE) == FASTER


@pytest.mark.parametrize(
    ("other", "action"),
    [
        ((2, 45, 0, 0), SLOWER),
        # At 8 m/s the model gains 2.26 m/s in a second and loses 6 (wanted gap / gap)². At the
        # leader's speed that gap is 19 m: below 6.75 m/s it brakes, up to 24.9 m, and it keeps
        # the 9 m/s that FASTER asks for from 41.5 m on.
        ((2, 35.5, 0, -8), SLOWER),
        ((2, 34.5, 0, -8), IDLE),
        ((2, 19, 0, -8), IDLE),
        ((2, 18, 0, -8), FASTER),
        ((2, 35.5, 0, -10), IDLE),  # draws away
        ((-2, 45, 0, 9), FASTER),  # comes towards it, on the other lane
        ((2, 75, 0, -9), FASTER),  # is behind
        ((2, 5, 0, 0), FASTER),  # is in the junction, too far away to give way to
        ((-15, 2, 8, 0), FASTER),
    ],
)
def test_idm_follows_on_its_approach(other, action):
    assert act("idm", 60, other, speed=8.0) == action
    assert act("idm", 60, (2, 12, 0, -9), other, speed=8.0) == action


@pytest.mark.parametrize(
    ("others", "action"),
    [
        ([], FASTER),
        ([(2, 54, 0, 0)], SLOWER),
        # It wants the whole 4.5 m/s, and 6 (1 - (7 / gap)²) is that at 14 m.
        ([(2, 46.2, 0, 0)], IDLE),
        ([(2, 45.8, 0, 0)], FASTER),
    ],
)
def test_idm_moves_off_if_there_is_room_to_stop_again(others, action):
    assert act("idm", 60, *others, speed=0.0) == action


@pytest.mark.parametrize(
    ("y", "speed", "action"),
    [
        (32, 8.0, FASTER),
        (30, 8.0, SLOWER),
        # To the middle of a car that stands with its rear on the line: 14 m again
        (22.3, 0.0, IDLE),
        (22.7, 0.0, FASTER),
        (10, 8.0, FASTER),
    ],
)
def test_idm_takes_the_stop_line_for_a_leader_if_somebody_crosses(y, speed, action):
    assert act("idm", y, (-15, 2, 8, 0), speed=speed) == action
    assert act("idm", y, speed=speed) == FASTER


@pytest.mark.parametrize(
    ("other", "action"),
    [
        ((-32, -2, -1), SLOWER),
        ((-32, -4, -1), SLOWER),  # 9 degrees to the side
        ((-32, -4.3, -1), FASTER),  # 11 degrees
        ((-32, -2, 1), FASTER),  # heads against the ego
        ((-8, -2, -1), FASTER),  # is behind
    ],
)
def test_idm_follows_on_the_exit_who_is_in_a_narrow_cone(other, action):
    seen = np.zeros((3, 7), np.float32)
    seen[0] = 1, -0.2, -0.02, -0.4, 0, -1, 0
    x, y, heading = other
    seen[1] = 1, x / 100, y / 100, 0, 0, heading, 0
    assert policies.policy("idm").predict(seen.ravel())[0] == action


def driven(name, other, size=200):
    """Endings, last places, and least and last speeds of egos that are alone with one vehicle."""
    batch = Intersection(Options(spawn_probability=0.0, initial_vehicle_count=1)).batch(size)
    batch.reset(0)
    made, rows = batch.buffers, np.arange(size)
    made.vehicles[:, 0] = made.vehicles[rows, made.episodes["controlled"][:, 0]]
    made.vehicles[:, 1] = other
    made.vehicles["identity"][:, :2] = 0, 1
    made.episodes["vehicles"], made.episodes["controlled"][:, 0] = 2, 0
    driver, running, speeds = policies.policy(name), np.ones(size, bool), []
    actions = np.full(size, FASTER)  # what was seen first were other vehicles
    while running.any():
        step = batch.step(actions, auto_reset=False, rows=running)
        speeds.append(step.speed)
        running &= step.ending == Ending.NONE
        actions, _ = driver.predict(step.observation)
    return step.ending, made.after["y"][:, 0], np.min(speeds, axis=0), speeds[-1]


@pytest.mark.parametrize("y", [20, 12])
def test_idm_stops_behind_a_wreck_on_its_lane(y, car):
    wreck = car(2, y, -90, 0, crashed=True, destination=2)
    avoidable = driven("wait", wreck)[0] == Ending.TIMEOUT
    ending, place, _, speed = (column[avoidable] for column in driven("idm", wreck))
    assert avoidable.sum() > 100
    assert (ending == Ending.TIMEOUT).all() and (speed < 0.1).all()
    # Between the cars' length and the room that it needs to move off, in the mean what it wants.
    gap = place - y
    assert gap.min() > 5 and gap.max() < 14 and gap.mean() > 7
    assert (driven("go", wreck)[0] == Ending.COLLISION).all()


def test_idm_stops_before_a_junction_that_is_blocked(car):
    wreck = car(1, 4, -90, 0, crashed=True, destination=2)
    ending, place, _, speed = driven("idm", wreck)
    assert (ending == Ending.TIMEOUT).all() and (speed < 0.1).all()
    assert (place > 11).all() and (place < 31).all()
    assert (driven("go", wreck)[0] == Ending.COLLISION).all()


def test_idm_drives_on_where_nobody_is_in_the_way(car):
    elsewhere = car(-2, 60, 90, 0, crashed=True, origin=2)
    ending, _, slowest, _ = driven("idm", elsewhere)
    assert (ending == Ending.ARRIVAL).all() and (slowest > 8.5).all()


@pytest.mark.parametrize("name", policies.NAMES)
def test_single_and_batched_answers_agree(name):
    rng = np.random.default_rng(0)
    views = rng.uniform(-0.4, 0.4, (50, 28)).astype(np.float32)
    views[:, 0::7] = rng.integers(2, size=(50, 4))
    batched, state = policies.policy(name, 3).predict(views)
    single = policies.policy(name, 3)
    assert state is None and batched.shape == (50,)
    assert isinstance(single, Policy)
    answers = [single.predict(one)[0] for one in views]
    assert {np.ndim(answer) for answer in answers} == {0}
    if name != "random":
        assert batched.tolist() == answers
    assert set(batched.tolist()) <= {SLOWER, IDLE, FASTER}


def test_the_view_is_not_changed():
    seen = view(BEFORE, (-15, 2, 8, 0))
    before = seen.copy()
    policies.policy("gap_3s").predict(seen)
    np.testing.assert_array_equal(seen, before)


def test_random_is_seeded_and_takes_every_action():
    views = np.zeros((40, 28), np.float32)

    def drawn(seed):
        made = policies.policy("random", seed)
        return [made.predict(views)[0].tolist() for _ in range(2)]

    assert drawn(1) == drawn(1) != drawn(2)
    first, second = drawn(1)
    assert first != second and set(first) == {SLOWER, IDLE, FASTER}


def test_unknown_names_are_refused():
    with pytest.raises(UserError, match=r"reference policy 'brake': choose one of go, idle, wait"):
        policies.policy("brake")
