"""The perception front end, by hand: it tracks, filters, predicts, and changes nothing else."""

import numpy as np
import pytest

from socialiq import UserError
from socialiq.evaluation.episodes import episodes_of
from socialiq.worlds import grammar
from socialiq.worlds.highway.perception import FrontEnd
from socialiq.worlds.highway.shifts import shifts_of
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.options import FASTER, Options
from socialiq.worlds.intersection.world import Intersection

F = 28  # of an ego and three others


def observation(*others, speed=9.0):
    rows = np.zeros((4, 7), np.float32)
    rows[0] = [1, 0.02, 0.3, 0, -speed / 20, 0, -1]
    for number, (x, y, vx, vy) in enumerate(others, 1):
        rows[number] = [1, x / 100, y / 100, vx / 20, vy / 20, 1, 0]
    return rows.reshape(1, F)


def metres(shown):
    rows = shown[0, :F].reshape(4, 7)[1:]
    return [tuple(np.round(row[1:3] * 100, 3).tolist()) for row in rows if row[0]]


def test_texts():
    known = FrontEnd.of("known,exit=own", shifts_of("late or noise=2"), Intersection().ego)
    assert known == FrontEnd(latency=1, track=3, noise=2.0, rate=1, exit="left")
    for text, words in (
        ("seen", "unknown front end"),
        ("track=30", "track must be"),
        ("rate=0", "rate must be"),
        ("latency=x", "an integer"),
    ):
        with pytest.raises(UserError, match=words):
            FrontEnd.of(text)
    with pytest.raises(UserError, match="without a world"):
        FrontEnd.of("known")
    with pytest.raises(UserError, match="destination"):
        FrontEnd.of("exit=own", (), Intersection(Options(destination="random")).ego)


def test_what_is_not_declared_is_not_changed():
    for front in (FrontEnd(), FrontEnd(track=3)):
        memory = front.memory(1, F)
        for time in range(3):
            rows = observation((-20 + 8 * time, 2, 8, 0), (5, -30 + 5 * time, 0, 7))
            shown, memory = front.see(rows, memory, F)
            np.testing.assert_array_equal(shown, rows)
            memory = front.decided(memory, np.ones((1, 1), np.float32), F)


def test_a_vehicle_that_is_not_seen_is_carried_on_for_some_decisions():
    front = FrontEnd(track=2)
    _, memory = front.see(observation((-20, 2, 8, 0), (5, -30, 0, 7)), front.memory(1, F), F)
    places = []
    for time in range(1, 4):
        rows = observation((5, -30 + 7 * time, 0, 7))
        shown, memory = front.see(rows, memory, F)
        places.append(metres(shown))
    assert places == [
        [(5.0, -23.0), (-12.0, 2.0)],
        [(5.0, -16.0), (-4.0, 2.0)],
        [(5.0, -9.0)],
    ]


def test_a_vehicle_that_is_seen_again_is_the_same_one():
    front = FrontEnd(track=3)
    _, memory = front.see(observation((-20, 2, 8, 0)), front.memory(1, F), F)
    _, memory = front.see(observation(), memory, F)
    shown, _ = front.see(observation((-5.5, 2, 7, 0)), memory, F)
    assert metres(shown) == [(-5.5, 2.0)]


def test_noise_is_filtered():
    """Of a standing vehicle the errors shrink, and a first measurement is taken as it is."""
    rng, front = np.random.default_rng(0), FrontEnd(noise=3.0)
    memory, errors = front.memory(500, F), []
    for _ in range(6):
        rows = np.repeat(observation((-20, 2, 0, 0)), 500, axis=0)
        noise = rng.normal(size=(500, 4)) * [0.03, 0.03, 0.075, 0.075]
        rows[:, 8:12] += noise.astype(np.float32)
        shown, memory = front.see(rows, memory, F)
        errors.append(np.std(shown[:, 8] * 100))
    assert errors[0] == pytest.approx(3.0, rel=0.1) and errors[-1] < 0.75 * errors[0]


def test_all_are_predicted_to_the_time_of_the_effect():
    """The ego slows down from 9 to 4.5 m/s: (1 - 0.1 / 0.6)^10 = 0.1615 of 4.5 m/s are left."""
    front = FrontEnd(latency=1)
    _, memory = front.see(observation((-20, 2, 8, 0)), front.memory(1, F), F)
    memory = front.decided(memory, np.zeros((1, 1), np.float32), F)
    shown, _ = front.see(np.append(observation((-20, 2, 8, 0)), [[4]], axis=1), memory, F)
    assert metres(shown) == [(-12.0, 2.0)] and shown[0, -1] == 5
    ego = shown[0, :7] * [1, 100, 100, 20, 20, 1, 1]
    left = (1 - 0.1 / 0.6) ** 10
    assert ego[4] == pytest.approx(-(4.5 + 4.5 * left), abs=1e-4)
    assert ego[2] == pytest.approx(30 - 4.5 - 4.5 * 0.6 * (1 - left), abs=1e-4)


def test_an_ego_that_is_predicted_is_where_the_simulator_takes_it():
    """On its approach, with the actions that were decided but not yet carried out."""
    still = Intersection().shifted("latency=2", "latency=2").batch(8)
    still.reset(np.arange(8))
    early = still.observation[:, 1:5]
    other = Intersection().batch(8)
    other.reset(np.arange(8))
    for _ in range(2):
        other.step(np.ones(8, np.int64), auto_reset=False)
    np.testing.assert_allclose(early, other.observation[:, 1:5], atol=2e-3)


@pytest.mark.parametrize("road", ["intersection", "merge"])
def test_an_ego_that_accelerates_is_where_the_simulator_takes_it(road):
    """On its approach, where its heading stays: the last two decisions are predicted."""
    decided = np.array([[-0.4], [-0.2], [0.6]], np.float32)
    still = grammar.build(f"{road},control=continuous,latency=2,front_end=[latency=2]").batch(4)
    still.reset(np.arange(4))
    for action in decided:
        actions = np.repeat(action[None], 4, axis=0)
        still.step(actions, auto_reset=False, rows=still.running)
    other = grammar.build(f"{road},control=continuous").batch(4)
    other.reset(np.arange(4))
    for action in [[0.0], [0.0], *decided]:
        actions = np.repeat(np.array([action], np.float32), 4, axis=0)
        other.step(actions, auto_reset=False, rows=other.running)
    driving = other.running & still.running
    assert driving.sum() >= 2
    predicted = still.observation[driving, 1:5]
    np.testing.assert_allclose(predicted, other.observation[driving, 1:5], atol=1e-5)


def test_it_repairs_what_it_is_declared_for():
    def collisions(shift, front_end=""):
        world = Intersection().shifted(shift, front_end)
        rule, seeds = policies.policy("gap_3s"), np.arange(40_000, 40_200)
        return episodes_of(world.batch(200), rule, seeds).metrics().collision

    assert collisions("late", "known") < collisions("late") - 0.02
    assert collisions("unseen-30", "known") < collisions("unseen-30")


def test_the_clock_tells_the_exit():
    front = FrontEnd(exit="right")
    time = np.array([[3.0], [25.0]], np.float32)
    assert front.clock(time).tolist() == [[43.0], [59.0]]
    assert FASTER == 2  # of the actions that a memory counts from IDLE
