"""Contract of every registered world as an environment, and of the gridworlds' tables."""

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from socialiq.errors import UserError
from socialiq.social.angle import weights
from socialiq.types import Ending
from socialiq.worlds import IDS, SCENE_IDS, catalogue, registry
from socialiq.worlds.crosswalk7 import LONGEST
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.gym import GridWorldEnv

WORLDS = sorted(catalogue.GRIDS)
PICTURES = {**dict.fromkeys(WORLDS, (300, 300, 3)), "intersection": (750, 600, 3)}
"""Sizes of pictures; those of other roads depend on the road."""


@pytest.fixture(params=[*IDS, *SCENE_IDS])
def any_name(request):
    return request.param


@pytest.fixture
def any_id(any_name):
    return (IDS | SCENE_IDS)[any_name]


@pytest.fixture(params=WORLDS)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def tables():
    return {name: tabulate(registry.make(name)) for name in WORLDS}


@pytest.fixture
def table(name, tables):
    return tables[name]


@pytest.fixture
def env(name):
    return gymnasium.make(IDS[name])


def walk(env, steps, seed):
    """A random walk over several episodes: (observation, action, step, whether it began)."""
    rng = np.random.default_rng(seed)
    observation, _ = env.reset(seed=seed)
    for _ in range(steps):
        action = rng.integers(env.action_space.n)
        step = env.step(action)
        yield observation, action, step
        observation = env.reset()[0] if step[2] or step[3] else step[0]


def test_every_world_has_a_gymnasium_id():
    assert sorted(IDS) == sorted(catalogue.KNOWN)


def test_gymnasium_accepts_it(any_id):
    check_env(gymnasium.make(any_id, render_mode="rgb_array").unwrapped)


def test_walks_stay_in_the_spaces(any_id):
    env = gymnasium.make(any_id)
    for observation, action, step in walk(env, 300, seed=0):
        assert env.observation_space.contains(observation)
        assert env.observation_space.contains(step[0])
        assert env.action_space.contains(action)


def test_seeded_walks_are_reproducible(any_id):
    used, fresh = (gymnasium.make(any_id) for _ in range(2))
    first, second, third = (
        [step for *_, step in walk(env, 150, seed=3)] for env in (used, used, fresh)
    )
    for (after, *rest, info), (same_after, *same_rest, same_info) in zip(
        first * 2, second + third, strict=True
    ):
        np.testing.assert_array_equal(after, same_after)
        assert rest == same_rest
        np.testing.assert_equal(info, same_info)


@pytest.mark.parametrize("angle", [0.0, 30.0, 270.0])
def test_reward_is_the_pair_scored_at_the_angle(any_id, angle):
    env = gymnasium.make(any_id, angle=angle)
    for *_, (_, reward, *_, info) in walk(env, 60, seed=2):
        assert type(reward) is float
        assert reward == pytest.approx(np.dot(weights(angle), info["reward_pair"]), abs=1e-15)


@pytest.mark.parametrize("angle", [-1.0, 360.0, float("nan"), float("inf")])
def test_angles_outside_are_refused(any_id, angle):
    with pytest.raises(UserError, match=r"is outside \[0, 360\) degrees"):
        gymnasium.make(any_id, angle=angle)


def test_it_renders_an_image_in_its_render_mode(any_name, any_id):
    env = gymnasium.make(any_id, render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    env.step(1)
    after = env.render()
    assert before.dtype == np.uint8
    assert before.shape == after.shape == PICTURES.get(any_name, before.shape)
    assert (before != after).any()
    plain = gymnasium.make(any_id).unwrapped
    plain.reset(seed=0)
    assert plain.render() is None


def test_info_tells_the_pair_the_signals_and_the_ending(env):
    world = env.unwrapped.world
    for *_, (_, _, terminated, truncated, info) in walk(env, 200, seed=1):
        assert info["reward_pair"].shape == (2,)
        assert info["reward_pair"].dtype == np.float64
        assert set(info["signals"]) == set(world.signal_names)
        ending = Ending[info["ending"].upper()]
        assert (ending == Ending.NONE) == (not terminated and not truncated)
        assert (ending == Ending.TIMEOUT) == truncated
        assert 0.0 <= info["speed"] <= world.max_speed


def test_walks_agree_with_the_table(env, table):
    mdp, world = table.mdp, table.world
    time, ended = 0, 0
    for observation, action, (after, _, terminated, truncated, info) in walk(env, 500, seed=4):
        s = world.index(observation.astype(int))
        time += 1
        kind = Ending[info["ending"].upper()]
        known = Ending.NONE if kind == Ending.TIMEOUT else kind
        outcomes = (mdp.successor[s, action] == world.index(after.astype(int))) & (
            mdp.ending[s, action] == known
        )
        assert mdp.probability[s, action][outcomes].sum() > 0.0
        if not (world.name == "crosswalk7" and observation[-1] == LONGEST):  # drawn by chance
            np.testing.assert_array_equal(
                info["reward_pair"], [reward[s, action] for reward in mdp.rewards]
            )
            assert info["signals"] == {n: value[s, action] for n, value in table.signals.items()}
        assert info["speed"] == table.speed[s, action]
        if terminated or truncated:
            time, ended = 0, ended + 1
        assert time < world.horizon
    assert ended > 10


def test_walks_meet_chance_as_often_as_the_table_says(env, table):
    mdp, surplus, variance = table.mdp, 0.0, 0.0
    for observation, action, (after, *_) in walk(env, 600, seed=5):
        s = table.world.index(observation.astype(int))
        last = mdp.successor[s, action] == table.world.index(after.astype(int))
        p = mdp.probability[s, action][mdp.successor[s, action] == mdp.successor[s, action, -1]]
        surplus += float(last[-1]) - p.sum()
        variance += p.sum() * (1.0 - p.sum())
    assert abs(surplus) <= 4 * np.sqrt(variance)


def test_episodes_begin_in_the_start_states(env, table):
    for seed in range(5):
        observation, _ = env.reset(seed=seed)
        assert table.mdp.initial[table.world.index(observation.astype(int))] > 0.0


def test_the_horizon_truncates(env):
    env.reset(seed=0)
    steps = [env.step(0) for _ in range(env.unwrapped.world.horizon)]
    assert [step[2] for step in steps] == [False] * len(steps)
    assert [step[3] for step in steps] == [False] * (len(steps) - 1) + [True]
    assert [step[4]["ending"] for step in steps[-2:]] == ["none", "timeout"]
    env.reset()
    assert not env.step(0)[3]


def test_simulator_runs_compiled_and_batched(table):
    world, batch = table.world, 8

    def episode(key):
        first, *keys = jax.random.split(key, world.horizon + 1)
        state, observation = world.reset(first)

        def step(state, key):
            state, seen = world.advance(key, state, 0)
            return state, (state.state, seen)

        _, (states, seen) = jax.lax.scan(step, state, jax.numpy.stack(keys))
        return observation, states, seen

    run = jax.jit(jax.vmap(episode))
    first, states, seen = jax.device_get(run(jax.random.split(jax.random.key(0), batch)))
    assert first.shape == (batch, world.n_features)
    assert first.dtype == seen.observation.dtype == np.float32
    assert (table.mdp.initial[world.index(first.astype(int))] > 0.0).all()
    np.testing.assert_array_equal(seen.observation, states)
    assert seen.rewards.env.shape == seen.rewards.social.shape == (batch, world.horizon)
    # the first action never takes the ego anywhere: time runs out, not before the horizon
    assert (seen.ending[:, :-1] == Ending.NONE).all()
    assert (seen.ending[:, -1] == Ending.TIMEOUT).all()


def test_an_end_in_the_last_step_is_no_timeout(table):
    world, mdp = table.world, table.mdp
    state, action, _ = (part[0] for part in np.nonzero(mdp.ending == Ending.ARRIVAL))
    episode, _ = world.reset(jax.random.key(0))
    last = episode._replace(state=table.states[state], time=world.horizon - 1)
    _, step = world.advance(jax.random.key(1), last, action)
    assert step.ending == Ending.ARRIVAL


def test_names_and_sizes_agree(table):
    world = table.world
    assert world.n_actions == len(world.actions) == table.mdp.n_actions
    assert world.n_features == len(world.features) == table.states.shape[1]
    assert np.prod(world.shape) == table.mdp.n_states
    assert len(set(world.signal_names)) == len(world.signal_names)
    assert table.speed.max() == world.max_speed


def test_unknown_options_are_refused(name):
    with pytest.raises(UserError, match=f"unknown option of {name} 'colour': choose one of ") as e:
        registry.make(name, colour="red")
    assert "\n" not in str(e.value)


def test_unknown_values_are_refused(name):
    with pytest.raises(UserError, match=f"unknown value 'x' for arrival of {name}") as e:
        registry.make(name, arrival="x")
    assert "choose one of" in str(e.value)
    assert "\n" not in str(e.value)


@pytest.mark.parametrize("p", [2.0, -0.1, float("nan")])
def test_spawn_probability_must_be_one(p):
    with pytest.raises(UserError, match=r"spawn_probability \S+ is not a probability.*\[0, 1\]$"):
        registry.make("crossing7", spawn_probability=p)


def test_unknown_worlds_are_refused():
    line = f"^unknown world 'crossing9': choose one of {', '.join(catalogue.GRIDS)}"
    with pytest.raises(UserError, match=f"{line}, intersection, merge, roundabout, two_way, road$"):
        registry.make("crossing9")
    line = f"{line}$"
    with pytest.raises(UserError, match=line):
        GridWorldEnv("crossing9")


def test_options_reach_the_environments_world(name):
    readings = {"crossing5": {"ends_on": "time_limit"}, "crossing7": {"braking": "one_level"}}
    readings["crosswalk7"] = {"class_angle": 30.0}
    env = gymnasium.make(IDS[name], **readings[name])
    assert env.unwrapped.world.options == type(env.unwrapped.world.options)(**readings[name])
