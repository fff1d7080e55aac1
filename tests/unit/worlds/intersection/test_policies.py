"""Drivers by rule, on hand-made views: the ego is at (2, y); its stop line at y = 11."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.types import Policy
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.interface import FASTER, IDLE, SLOWER

BEFORE = 15.0  # y of an ego that judges gaps


def view(y, *others, vehicles=4):
    """An observation of the ego and others, each (x, y, vx, vy)."""
    seen = np.zeros((vehicles, 7), np.float32)
    seen[0] = 1, 0.02, y / 100, 0, -0.45, 0, -1
    for row, (x, y_other, vx, vy) in enumerate(others, start=1):
        seen[row] = 1, x / 100, y_other / 100, vx / 20, vy / 20, 1, 0
    return seen.ravel()


def act(name, *arguments):
    return int(policies.policy(name).predict(view(*arguments))[0])


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
