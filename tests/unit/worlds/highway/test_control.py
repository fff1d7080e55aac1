"""Continuous actions on every road, of one agent and of several."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.fleet import drive
from socialiq.worlds import grammar
from socialiq.worlds.highway.kinds import PARTS, kind_with
from socialiq.worlds.highway.options import AgentOptions, ControlOptions
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection

ROADS = ("intersection", "merge", "roundabout", "two_way")
CELLS = [(name, agents) for name in ROADS for agents in (1, 3)]


def made(name, agents, size=4):
    batch = grammar.build(f"{name},control=steering,agents={agents}").batch(size)
    batch.reset(5)
    return batch


def drawn(batch, seed):
    shape = *batch.shape, batch.options.width
    return np.random.default_rng(seed).uniform([-0.5, -0.05], [1.0, 0.05], shape)


@pytest.mark.parametrize(("name", "agents"), CELLS, ids=str)
def test_commands_are_held_in_the_records_of_the_agents(name, agents):
    batch = made(name, agents)
    actions = drawn(batch, 0)
    slots = batch.buffers.episodes["controlled"][:, :agents].copy()
    batch.step(actions, auto_reset=False)
    before = batch.buffers.before[np.arange(4)[:, None], slots]
    after = batch.buffers.after[np.arange(4)[:, None], slots]
    actions = actions.reshape(4, agents, 2)
    intact = ~after["crashed"]
    assert intact.sum() >= 4
    np.testing.assert_allclose(after["acceleration"][intact], 5 * actions[..., 0][intact])
    np.testing.assert_allclose(after["steering"][intact], np.pi / 4 * actions[..., 1][intact])
    gained = (after["speed"] - before["speed"])[intact]
    np.testing.assert_allclose(gained, 5 * actions[..., 0][intact], atol=1e-9)


@pytest.mark.parametrize(("name", "agents"), CELLS, ids=str)
def test_copies_and_small_batches_drive_the_same_episodes(name, agents):
    batch = made(name, agents)
    first = drawn(batch, 1)
    batch.step(first, auto_reset=False)
    copies = batch.branch([2])
    alone = batch.like(1)
    alone.reset([5 + 2])
    alone.step(first[2:3], auto_reset=False)
    rows = batch.running.copy()
    second = drawn(batch, 2)
    batch.step(second, auto_reset=False, rows=rows)
    if rows[2]:
        for other in (copies, alone):
            other.step(second[2:3], auto_reset=False)
            np.testing.assert_array_equal(other.observation[0], batch.observation[2])


@pytest.mark.parametrize(("name", "agents"), CELLS, ids=str)
def test_actions_of_another_shape_are_refused(name, agents):
    batch = made(name, agents)
    with pytest.raises(UserError, match=r"of the shape \(4, "):
        batch.step(np.zeros((4, 7)))
    with pytest.raises(UserError, match="float32 or float64"):
        batch.step(np.zeros(batch.shape, np.int64))


def test_one_agent_of_a_fleet_is_the_ego():
    ego = Intersection(grammar.build("intersection,control=steering").options).batch(20)
    parts = tuple(part for part in PARTS if part in (AgentOptions, ControlOptions))
    options = kind_with(Options, parts)(agents=1, actions="continuous_steering")
    fleet = Intersection(options).batch(20)
    ego.reset(0)
    fleet.reset(0)
    for step in range(6):
        running = ego.running
        actions = drawn(ego, step)
        paid = ego.step(actions, auto_reset=False, rows=running).rewards
        others = fleet.step(actions[:, None], auto_reset=False, rows=running).rewards
        np.testing.assert_array_equal(np.stack(paid), np.stack(others)[..., 0])
        np.testing.assert_array_equal(ego.observation, fleet.observation[:, 0])


@pytest.mark.parametrize("name", ["merge", "two_way"])
def test_progress_is_the_way_driven_straight_on(name):
    world = grammar.build(f"{name},control=continuous")
    batch = world.batch(8)
    batch.reset(0)
    decisions = batch.step(np.full((8, 1), 0.2), auto_reset=False)
    moved = batch.buffers.after["x"][:, 0] - batch.buffers.before["x"][:, 0]
    intact = ~batch.buffers.after["crashed"][:, 0]
    expected = moved / world.options.progress_unit
    np.testing.assert_allclose(decisions.signals["progress"][intact], expected[intact])
    assert intact.any() and (moved > 29.0).all()


@pytest.mark.parametrize("name", ROADS)
@pytest.mark.parametrize("rule", ["go", "idle", "wait", "idm", "random"])
def test_rules_drive_by_acceleration(name, rule):
    world = grammar.build(f"{name},control=steering")
    batch = world.batch(6)
    policy = world.driver(rule, 0)
    actions = policy.predict(batch.reset(0))[0]
    assert actions.shape == (6, 2) and actions.dtype == np.float32
    assert rule == "random" or not actions[:, 1].any()
    speed = batch.buffers.vehicles["speed"][
        np.arange(6), batch.buffers.episodes["controlled"][:, 0]
    ]
    batch.step(actions, auto_reset=False)
    after = batch.buffers.after[np.arange(6), batch.buffers.present[:, 1]]
    gained = (after["speed"] - speed)[~after["crashed"]]
    signs = {"go": 1, "wait": -1}
    if rule in signs and world.options.max_speed > 10.0:  # else the ego enters above it
        assert (signs[rule] * gained >= -1e-6).all()
    if rule == "idle":
        np.testing.assert_allclose(gained, 0.0, atol=1e-5)


def test_a_fleet_is_driven_by_rules():
    world = grammar.build("roundabout,control=steering,agents=3")
    fleet = drive(world.batch(3), [world.driver("go"), world.driver("idm")], 7)
    assert fleet.ending.shape == (3, 3) and fleet.ending.all()


def test_a_way_with_bends_needs_steering():
    with pytest.raises(UserError, match="choose control=steering"):
        grammar.build("roundabout,control=continuous")
