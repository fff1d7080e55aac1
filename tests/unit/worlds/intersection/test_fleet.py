"""Several controlled vehicles in an episode."""

import dataclasses

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.fleet import drive
from socialiq.types import Ending
from socialiq.worlds.highway.options import Contact
from socialiq.worlds.intersection.options import MULTI_AGENT, Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make_fleet
from socialiq.worlds.world import ConstantPolicy

RESULTS = ("reached", "signals", "rewards", "classical", "speed", "ending", "contact", "braking")
PER_AGENT = ("controlled", "start", "touched", "contact", "ended")
HIGHWAY_ENV = {"ends": "joint", "frame": "world"}
GO, QUIET = 2, {"spawn_probability": 0.0, "initial_vehicle_count": 1}


def fleet(agents, size=40, **options):
    batch = make_fleet("intersection", agents, **options).batch(size)
    batch.reset(0)
    return batch


def drawn(batch, seed=0):
    return np.random.default_rng(seed).integers(3, size=batch.shape)


def results(batch, agent=0):
    """Results of one agent in every episode."""
    columns = {name: getattr(batch.buffers, name) for name in (*RESULTS, "neighbours_collided")}
    return {name: column[agent :: batch.options.agents].copy() for name, column in columns.items()}


def assert_equal(one, other):
    assert [name for name in one if not np.array_equal(one[name], other[name])] == []


@pytest.mark.parametrize("frame", ["own", "world"])
def test_one_agent_is_the_ego(frame):
    ego, one = Intersection().batch(60), fleet(1, 60, ends="joint", frame=frame)
    ego.reset(0)
    for step in range(20):
        running = ego.running
        np.testing.assert_array_equal(running, one.running)
        actions = drawn(ego, step)
        ego.step(actions, auto_reset=False, rows=running)
        one.step(actions[:, None], auto_reset=False, rows=running)
        assert_equal(results(ego), results(one))


def test_results_of_each_agent_are_those_of_an_ego_in_its_place(annotated):
    batch = fleet(4, destination="random", **HIGHWAY_ENV)
    for step in range(4):
        batch.step(drawn(batch, step), auto_reset=False, rows=batch.running)
    options = dataclasses.replace(Options(), destination="random")
    compared = 0
    for row in np.flatnonzero(batch.running)[:8]:
        episode, (count, *slots) = batch.buffers.episodes[row], batch.buffers.present[row]
        for agent, slot in enumerate(slots):
            facts = {name: episode[name][agent] for name in ("start", "contact", "touched")}
            snapshots = (getattr(batch.buffers, name)[row, :count] for name in ("before", "after"))
            alone = annotated(*snapshots, options, slot, time=episode["time"], **facts)
            result = 4 * row + agent
            for name in ("reached", "speed", "ending", "contact", "classical"):
                np.testing.assert_array_equal(
                    getattr(alone, name)[0], getattr(batch.buffers, name)[result], name
                )
            if batch.driving[row, agent]:
                np.testing.assert_array_equal(alone.rewards[0], batch.buffers.rewards[result])
                compared += 1
    assert compared > 20


def placed(batch, state, agent):
    """Put the episodes of one ego into a batch of two agents; the other one is 9 km away."""
    rows, away = np.arange(batch.size), 1 - agent
    made = batch.save()
    count, ego = state.episodes["vehicles"], state.episodes["controlled"][:, 0]
    for name in set(state.episodes.dtype.names) - set(PER_AGENT):
        made.episodes[name] = state.episodes[name]
    width = state.vehicles.shape[1]
    made.vehicles[:, :width] = state.vehicles
    made.vehicles["agent"][rows, ego] = agent
    made.vehicles[rows, count] = state.vehicles[rows, ego]
    for name, value in {"x": 9e3, "y": 9e3, "speed": 0.0, "target_speed": 0.0}.items():
        made.vehicles[name][rows, count] = value
    made.vehicles["agent"][rows, count], made.vehicles["identity"][rows, count] = away, 99
    made.episodes["vehicles"] += 1
    for name in PER_AGENT:
        made.episodes[name][:, agent] = state.episodes[name][:, 0]
        made.episodes[name][:, away] = -1 if name == "touched" else 0
    made.episodes["controlled"][:, away] = count
    batch.restore(made)


@pytest.mark.parametrize("agent", [0, 1])
def test_an_agent_far_from_the_other_drives_as_an_ego_alone(agent):
    ego, batch = Intersection().batch(40), fleet(2, **HIGHWAY_ENV)
    ego.reset(0)
    placed(batch, ego.save(), agent)
    for step in range(12):
        running = ego.running & batch.running
        actions = drawn(ego, step)
        both = np.zeros(batch.shape, np.int64)
        both[:, agent] = actions
        ego.step(actions, auto_reset=False, rows=running)
        batch.step(both, auto_reset=False, rows=running)
        mine, alone = results(batch, agent), results(ego)
        # slots are shifted, and the other one is in the mean of the neighbours
        del mine["braking"], alone["braking"]
        mine["classical"], alone["classical"] = mine["classical"][:, 0], alone["classical"][:, 0]
        assert_equal(mine, alone)
    assert not ego.running.all()


def swapped(state):
    """The same state in which agents 0 and 1 have each other's numbers."""
    other = state.rows(np.arange(len(state.episodes)))
    for name in PER_AGENT:
        other.episodes[name][:, :2] = other.episodes[name][:, 1::-1]
    numbers = other.vehicles["agent"]
    numbers[:] = np.choose(numbers + 1, [-1, 1, 0])
    return other


@pytest.mark.parametrize("options", [{}, HIGHWAY_ENV])
def test_numbers_of_agents_do_not_matter(options):
    batch, other = fleet(2, **options), fleet(2, **options)
    other.restore(swapped(batch.save()))
    for step in range(12):
        actions, running = drawn(batch, step), batch.running
        made = batch.step(actions, auto_reset=False, rows=running)
        also = other.step(actions[:, ::-1], auto_reset=False, rows=running)
        for one, two in zip(made.rewards, also.rewards, strict=True):
            np.testing.assert_array_equal(one, two[:, ::-1])
        np.testing.assert_array_equal(made.observation, also.observation[:, ::-1])
        np.testing.assert_array_equal(made.ending, also.ending[:, ::-1])
    assert set(np.unique(made.ending)) >= {Ending.ARRIVAL, Ending.COLLISION}


def test_agents_that_meet_blame_one_another():
    batch = fleet(4, 200, **QUIET)
    while batch.running.any():
        actions = np.full(batch.shape, GO)
        made = batch.step(actions, auto_reset=False, rows=batch.running)
    crashed = made.ending == Ending.COLLISION
    assert crashed.any() and (made.ending == Ending.ARRIVAL).any()
    assert np.isin(crashed.sum(axis=1), (0, 2, 3, 4)).all()  # never one alone
    contact = batch.buffers.episodes["contact"][:, :4]
    assert (contact[crashed] != Contact.NONE).all() and not contact[~crashed].any()
    pairs = contact[crashed.sum(axis=1) == 2]
    struck = (pairs == Contact.EGO_STRUCK).sum(axis=1)
    assert (struck > 0).all()


def test_each_agent_has_a_view_of_its_own_from_the_south():
    batch = fleet(4, 200)
    first = batch.observation.reshape(200, 4, 10, 7)[:, :, 0]
    np.testing.assert_allclose(first[..., 1], 0.02, atol=1e-6)  # m east of the centre / 100
    assert (first[..., 2] > 0.2).all()
    assert np.abs(first[..., 5:] - [0.0, -1.0]).max() < 1e-6  # heading north
    world = fleet(4, 200, frame="world").observation.reshape(200, 4, 10, 7)[:, :, 0]
    np.testing.assert_allclose(world[0, :, 5:], [[0, -1], [1, 0], [0, 1], [-1, 0]], atol=1e-6)


def test_a_view_turns_with_the_crossing():
    batch = fleet(2, 60, **QUIET)
    alone = np.flatnonzero(batch.buffers.episodes["vehicles"] == 2)  # no one has to give way
    batch = batch.branch(alone)
    state, turned = batch.save(), batch.save()
    vehicles, there = turned.vehicles, state.vehicles
    vehicles["x"], vehicles["y"] = -there["y"], there["x"]  # from south to west
    vehicles["along_x"], vehicles["along_y"] = -there["along_y"], there["along_x"]
    vehicles["heading"] += np.pi / 2
    for name in ("lane", "target_lane"):
        vehicles[name] = (there[name] + 5) % 20
    for name in ("origin", "destination"):
        vehicles[name] = (there[name] + 1) % 4
    vehicles["route"] = 5 * vehicles["origin"]
    other = batch.like(len(alone))
    other.restore(turned)
    for step in range(6):
        # those who stop magnify a rounding of the turn
        actions, running = np.maximum(drawn(batch, step), 1), batch.running & other.running
        made = batch.step(actions, auto_reset=False, rows=running)
        also = other.step(actions, auto_reset=False, rows=running)
        np.testing.assert_allclose(made.observation, also.observation, atol=1e-6)
        np.testing.assert_allclose(made.rewards, also.rewards, atol=1e-9)


@pytest.mark.parametrize(("frame", "arms"), [("own", [1, 2, 3, 0]), ("world", [1, 1, 1, 1])])
def test_destinations_are_counted_from_the_own_arm_or_the_south(frame, arms):
    batch = fleet(4, 3, frame=frame, destination="left")
    slots = batch.buffers.episodes["controlled"][:, :4]
    found = batch.buffers.vehicles["destination"][np.arange(3)[:, None], slots]
    assert found.tolist() == [arms] * 3


def test_an_agent_that_has_ended_leaves_and_the_others_go_on():
    batch = fleet(4, 100, **QUIET)
    before, left = batch.driving, 0
    while (running := batch.running).any():
        made = batch.step(np.full(batch.shape, GO), auto_reset=False, rows=running)
        np.testing.assert_array_equal(batch.driving, made.ending == Ending.NONE)
        gone = ~before & running[:, None]
        assert not made.observation[gone].any() and not np.array(made.rewards)[:, gone].any()
        count, agents = batch.buffers.episodes["vehicles"], batch.buffers.vehicles["agent"]
        there = (agents >= 0) & (np.arange(agents.shape[1]) < count[:, None])
        done = batch.driving.sum(axis=1)
        np.testing.assert_array_equal(there.sum(axis=1)[batch.running], done[batch.running])
        left += int(gone.sum())
        before = batch.driving
    assert left > 50 and not batch.driving.any()


def test_joint_episodes_end_with_the_first_crash_or_the_last_arrival():
    batch = fleet(2, 200, **HIGHWAY_ENV)
    while (running := batch.running).any():
        made = batch.step(np.full(batch.shape, GO), auto_reset=False, rows=running)
        crashed = (made.ending == Ending.COLLISION).any(axis=1)
        arrived = (made.ending == Ending.ARRIVAL).all(axis=1)
        np.testing.assert_array_equal(running & ~batch.running, running & (crashed | arrived))
    assert crashed.any() and arrived.any()


def test_what_follows_an_arrival_pays_nothing():
    made = drive(fleet(2, 200, **HIGHWAY_ENV), [ConstantPolicy(np.full((), GO))], 0)
    arrivals = made.signal_arrival
    assert arrivals.max() == 1.0
    batch = fleet(2, 200, **HIGHWAY_ENV)
    paid = np.zeros(batch.shape)
    while (running := batch.running).any():
        step = batch.step(np.full(batch.shape, GO), auto_reset=False, rows=running)
        paid += np.where(running[:, None], step.rewards.env, 0.0)
    np.testing.assert_allclose(paid, made.r_env, atol=1e-12)


@pytest.mark.parametrize("options", [{}, MULTI_AGENT])
def test_saved_and_branched_episodes_go_on_alike(options):
    batch = fleet(3, 20, **options)
    for step in range(5):
        batch.step(drawn(batch, step), auto_reset=False, rows=batch.running)
    rows = np.flatnonzero(batch.running)[[0, 0, 1]]
    state, copies = batch.save(), batch.branch(rows)
    actions = drawn(batch, 9)
    made = copies.step(actions[rows])
    batch.restore(state)
    again = batch.step(actions, rows=batch.running)
    np.testing.assert_array_equal(made.observation, again.observation[rows])
    np.testing.assert_array_equal(made.rewards, np.array(again.rewards)[:, rows])


def test_policies_of_one_ego_drive_each_agent():
    batch, waits = fleet(2, 100, **QUIET), ConstantPolicy(np.zeros((), np.int64))
    made = drive(batch, [policy("gap_3s"), waits], 0)
    assert (made.ending[:, 0] == Ending.ARRIVAL).mean() > 0.9
    assert not (made.ending[:, 1] == Ending.ARRIVAL).any()
    drivers = np.array([[1, 0]] * 100)
    also = drive(batch, [policy("gap_3s"), waits], 0, drivers)
    assert (also.ending[:, 1] == Ending.ARRIVAL).mean() > 0.9
    np.testing.assert_array_equal(also.length.max(axis=0), [20, made.length[:, 0].max()])


@pytest.mark.parametrize(
    ("name", "agents", "options", "message"),
    [
        ("intersection", 17, {}, "agents must be at most 16, got 17"),
        ("intersection", 0, {}, "agents must be a whole number of at least 1, got 0"),
        ("intersection", 2, {"ends": "never"}, "unknown value 'never' for ends"),
        ("merge", 6, {}, "merge has 5 vehicles: choose at most as many agents, not 6"),
        ("crossing7", 2, {}, "unknown road 'crossing7'"),
    ],
)
def test_fleets_that_cannot_be_are_refused(name, agents, options, message):
    with pytest.raises(UserError, match=message):
        make_fleet(name, agents, **options).batch(1)


def test_wrong_actions_and_drivers_are_refused():
    batch = fleet(2, 3)
    with pytest.raises(UserError, match=r"^actions must be 3 x 2 whole numbers"):
        batch.step(np.zeros(3, int))
    with pytest.raises(UserError, match="has one ego: make the world by make_fleet"):
        drive(Intersection().batch(3), [policy("go")], 0)
    with pytest.raises(UserError, match="at least one policy"):
        drive(batch, [], 0)
    with pytest.raises(UserError, match=r"drivers must have the shape \(3, 2\)"):
        drive(batch, [policy("go")], 0, np.ones((3, 2), int))


@pytest.mark.parametrize(("name", "agents"), [("merge", 5), ("roundabout", 5), ("two_way", 2)])
def test_vehicles_of_other_roads_are_controlled_too(name, agents):
    world = make_fleet(name, agents)
    batch = world.batch(40)
    batch.reset(0)
    most = max(world.options.target_speeds[-1], 35.0) / world.options.progress_unit
    while (running := batch.running).any():
        actions = np.random.default_rng(0).integers(5, size=batch.shape)
        made = batch.step(actions, auto_reset=False, rows=running)
        assert np.abs(made.signals["progress"]).max() < most
    assert len(np.unique(made.ending)) > 1
