"""Faults of sensors and of actions, and the front end, with several agents."""

import numpy as np
import pytest

from socialiq.evaluation.fleet import drive
from socialiq.worlds import grammar
from socialiq.worlds.registry import make, make_fleet

FAULTS = ("late", "noise=1", "unseen=.5", "sight=30", "late or noise=2")
ROADS = ("intersection", "merge", "roundabout")


def fleet(name, agents, shift="", front_end="", size=8):
    world = make_fleet(name, agents, **{"shift": shift, "front_end": front_end})
    batch = world.batch(size)
    batch.reset(3)
    return world, batch


def drawn(batch, seed):
    return np.random.default_rng(seed).integers(batch.n_actions, size=batch.shape)


@pytest.mark.parametrize("front_end", ["", "latency=1,track=3"])
@pytest.mark.parametrize("shift", FAULTS)
def test_one_agent_is_shown_what_an_ego_is(shift, front_end):
    ego = make("roundabout", shift=shift, front_end=front_end).batch(8)
    ego.reset(3)
    _, one = fleet("roundabout", 1, shift, front_end)
    for step in range(5):
        running = ego.running
        np.testing.assert_array_equal(ego.observation, one.observation[:, 0])
        np.testing.assert_array_equal(ego.late, one.late[:, 0])
        np.testing.assert_array_equal(ego.clocks, one.clocks)
        actions = drawn(ego, step)
        ego.step(actions, auto_reset=False, rows=running)
        one.step(actions[:, None], auto_reset=False, rows=running)


@pytest.mark.parametrize("name", ROADS)
def test_late_actions_of_all_agents_are_carried_out_a_decision_later(name):
    world, late = fleet(name, 3, "late")
    _, plain = fleet(name, 3)
    before = np.full(plain.shape, world.ego.idle)
    for step in range(3):
        running = late.running
        actions = drawn(plain, step)
        shown = late.step(actions, auto_reset=False, rows=running).observation
        reached = plain.step(before, auto_reset=False, rows=running).observation
        np.testing.assert_array_equal(shown[late.running], reached[late.running])
        before = actions


def test_late_continuous_actions_of_several_agents_come_later():
    text = "intersection,control=steering,agents=2"
    late = grammar.build(f"{text},late").batch(4)
    plain = grammar.build(text).batch(4)
    late.reset(0)
    plain.reset(0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (4, 2, 2)).astype(np.float32)
    late.step(actions, auto_reset=False)
    plain.step(np.zeros_like(actions), auto_reset=False)
    np.testing.assert_array_equal(late.buffers.speed, plain.buffers.speed)
    late.step(np.zeros_like(actions), auto_reset=False, rows=late.running)
    plain.step(actions, auto_reset=False, rows=plain.running)
    np.testing.assert_array_equal(late.buffers.speed, plain.buffers.speed)


@pytest.mark.parametrize("name", ROADS)
def test_agents_have_errors_apart_from_each_other(name):
    world, noisy = fleet(name, 2, "noise=1")
    _, plain = fleet(name, 2)
    width = world.n_features
    error = (noisy.observation - plain.observation).reshape(8, 2, width // 7, 7)
    present = plain.observation.reshape(8, 2, width // 7, 7)[..., 0] > 0
    assert not error[:, :, 0].any()  # the own row has none
    both = (present[:, 0] & present[:, 1])[:, 1:]
    assert both.any()
    assert (error[:, 0, 1:, 1][both] != error[:, 1, 1:, 1][both]).any()


def test_agents_draw_shifts_apart_from_each_other():
    _, batch = fleet("intersection", 4, "none or late", size=64)
    late = batch.late
    assert late.shape == (64, 4)
    assert 0.35 < late.mean() < 0.65
    assert (late != late[:, :1]).any()
    clocks = fleet("intersection", 4, "none or late", "known", size=64)[1]
    np.testing.assert_array_equal(clocks.clocks.reshape(64, 4), clocks.late)


@pytest.mark.parametrize("front_end", ["", "latency=1,track=3"])
def test_copies_and_other_sizes_are_equal(front_end):
    _, batch = fleet("merge", 3, "late or unseen=.5", front_end)
    first = drawn(batch, 0)
    batch.step(first, auto_reset=False)
    copies = batch.branch([5])
    alone = batch.like(1)
    alone.reset([3 + 5])
    alone.step(first[5:6], auto_reset=False)
    rows = batch.running
    second = drawn(batch, 1)
    batch.step(second, auto_reset=False, rows=rows)
    assert rows[5]
    for other in (copies, alone):
        other.step(second[5:6], auto_reset=False)
        np.testing.assert_array_equal(other.observation[0], batch.observation[5])


def test_an_agent_that_has_left_is_shown_zeros():
    _, batch = fleet("intersection", 4, "late", "latency=1,track=3", size=32)
    count = 0
    for step in range(8):
        batch.step(drawn(batch, step), auto_reset=False, rows=batch.running)
        left = (batch.buffers.present[:, 1:] < 0) & batch.running[:, None]
        count += left.sum()
        assert not batch.observation[left].any()
    assert count > 8


@pytest.mark.parametrize("text", ["intersection,agents=3,late", "merge,agents=2,noise=1"])
def test_a_front_end_drives_a_fleet(text):
    world = grammar.build(f"{text},front_end=known")
    episodes = drive(world.batch(4), [world.driver("idm")], 0)
    assert episodes.ending.all()
