from collections.abc import Callable

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import socialiq  # noqa: F401 - registers the worlds
from socialiq.errors import UserError
from socialiq.learners.acting import soft
from socialiq.learners.collect import Collector, from_env, from_simulator
from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.iq_learn.config import IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.iq_learn.train import IQLearn, train
from socialiq.learners.state import Runs, stack
from socialiq.types import Ending
from socialiq.worlds import registry

STRUCTURE = IQLearnConfig(hidden=(8,), batch_size=8, updates=40, replay_capacity=80)
RUNS = [IQLearnHyperparameters(seed=3), IQLearnHyperparameters(seed=4)]
STEPS = 60


def crossing7() -> gymnasium.Env:
    return gymnasium.make("socialiq/Crossing7-v1")


def collector(steps: int = STEPS) -> Callable[[Runs, int], Runs]:
    """A collector that is given copies, because it takes the memory of what it is given."""
    collect = Collector([from_env(crossing7(), steps) for _ in RUNS], [3, 4], soft([1.0, 1.0]))
    return lambda runs, done: collect(jax.tree.map(jnp.copy, runs), done)


@pytest.fixture(name="runs", scope="module")
def fresh_runs(demonstrations):
    table = ExpertTable.of([demonstrations()], "running", 0.99)
    start = jax.vmap(IQLearn(STRUCTURE, (6, 3), table).initialise)
    zero = np.zeros(2, np.int32)
    return Runs(*start(stack(RUNS)), zero, zero - 1, zero - 1)


@pytest.fixture(name="filled", scope="module")
def filled_runs(runs):
    return collector()(runs, 0)


def test_the_ring_holds_what_the_world_did(filled):
    """Every stored row is a transition of the world's own rules under one of its chances."""
    ring, world = filled.carry.replay, registry.make("crossing7")
    assert ring.added.tolist() == [STEPS, STEPS]
    rules = jax.jit(jax.vmap(world.rules, in_axes=(0, 0, None)))
    for run in range(2):
        rows = jax.tree.map(lambda column, run=run: np.asarray(column[run][:STEPS]), ring.columns)
        possible = []
        for chance in range(2):
            outcome = rules(rows.observation.astype(np.int32), rows.action, chance)
            pair = world.rewards(outcome.signals)
            possible.append(
                (outcome.state == rows.next_observation).all(axis=1)
                & ((outcome.ending == rows.ending) | (rows.ending == Ending.TIMEOUT))
                & np.isclose(pair.env, rows.target.env)
                & np.isclose(pair.social, rows.target.social)
            )
        assert np.logical_or(*possible).all()
        goes_on = rows.ending[:-1] == Ending.NONE
        follows = (rows.next_observation[:-1] == rows.observation[1:]).all(axis=1)
        assert follows[goes_on].all()
        assert (rows.observation[1:][~goes_on, 0] == 0).all()  # a new episode starts at x = 0
        assert set(rows.ending.tolist()) <= {0, 1, 2, 3}
        assert (rows.ending > 0).any()


def test_experience_depends_on_the_seed_and_the_updates_done_alone(runs, filled, assert_same):
    assert_same(collector()(runs, 0), filled)
    used = collector()
    used(runs, 500)
    assert_same(used(runs, 0), filled)
    later = collector()(runs, 20).carry.replay.columns
    columns = filled.carry.replay.columns
    assert (later.action != columns.action).any()
    assert (columns.action[0] != columns.action[1]).any()


def test_the_replay_keeps_what_came_before(filled):
    ring = collector(10)(filled, 20).carry.replay
    assert ring.added.tolist() == [70, 70]
    before = filled.carry.replay.columns.observation
    np.testing.assert_array_equal(ring.columns.observation[:, :60], before[:, :60])


class Counting(gymnasium.Env):
    """Observations count the steps of an episode of seven."""

    observation_space = gymnasium.spaces.Box(0.0, 7.0, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.time = 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.time += 1
        return np.full(1, self.time, np.float32), 0.0, False, self.time == 7, {}


def test_each_chunk_begins_with_a_reset_of_every_environment():
    source = from_env([Counting(), Counting()], 10)
    rng = np.random.default_rng(0)
    for _ in range(2):
        rows = source(lambda observations: np.zeros(len(observations), int), rng)
        assert rows.observation[:, 0].tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]


def test_actions_that_are_not_discrete_are_refused():
    with pytest.raises(UserError, match="only discrete actions"):
        from_env(gymnasium.make("Pendulum-v1"), 5)


def test_an_online_run_trains_on_what_is_collected(demonstrations):
    found = train(STRUCTURE, RUNS, [demonstrations()], chunk=20, before_chunk=collector())
    assert found.failures == ()
    assert found.history.updates == [20, 40]
    assert all(np.isfinite(found.history.array(name)).all() for name in found.history.values)


def test_a_batch_of_a_world_is_a_source_of_whole_transitions():
    """Rows of an episode follow one another, also through the step at which time ran out."""
    world = registry.make("crossing7")
    source = from_simulator(world.batch(3), world.n_features, 300)
    batch = source(lambda observation: np.zeros(len(observation), int), np.random.default_rng(0))
    rows = [np.asarray(column).reshape(100, 3, -1) for column in batch[:4]]
    before, _, after, ending = rows
    assert set(np.unique(ending)) == {Ending.NONE, Ending.TIMEOUT}
    goes_on = (ending[:-1] == Ending.NONE)[..., 0]
    assert (after[:-1][goes_on] == before[1:][goes_on]).all()
    table = world.table()
    for index in np.argwhere(ending[..., 0] == Ending.TIMEOUT):
        places = (column[tuple(index)].astype(int) for column in (before, after))
        state, reached = map(table.world.index, places)
        assert reached in table.mdp.successor[state, 0]
