"""Faults and a front end on every road: each changes something, by the seed of an episode alone."""

import gymnasium
import numpy as np
import pytest

from socialiq import UserError
from socialiq.worlds import SCENE_IDS, registry
from socialiq.worlds.highway.scenes import SCENES
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.spelled_out import defaults

ROADS = ("intersection", *SCENES)
FAULTS = {
    "latency": ("latency=1", ""),
    "unseen": ("unseen=0.3", ""),
    "sight": ("sight=20", ""),
    "occlusion": ("occlusion=true", ""),
    "noise": ("noise=1", ""),
    "drift": ("drift=2", ""),
    "front end": ("late,unseen=0.3,noise=1 or none", "known"),
}
SEEDS = np.arange(700, 724)
STEPS = 6


def actions_of(world, size):
    return np.random.default_rng(3).integers(world.n_actions, size=(STEPS, size))


def driven(batch, actions):
    """Return what is shown in each decision, and the pair, of episodes as long as they run."""
    rows = []
    for chosen in actions:
        running = batch.running.copy()
        decisions = batch.step(chosen, auto_reset=False, rows=running)
        columns = decisions.observation, batch.time[:, None], np.stack(decisions.rewards, axis=1)
        rows.append(np.where(running[:, None], np.concatenate(columns, axis=1), 0.0))
    return np.stack(rows)


@pytest.mark.parametrize("name", ROADS)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_follows_from_the_seed(name, fault):
    shift, front_end = FAULTS[fault]
    world = registry.make(name, shift=shift, front_end=front_end)
    actions = actions_of(world, len(SEEDS))
    batch = world.batch(len(SEEDS))
    first = batch.reset(SEEDS)
    rows = driven(batch, actions)
    plain = registry.make(name).batch(len(SEEDS))
    changed = not np.array_equal(plain.reset(SEEDS), first)
    assert changed or not np.array_equal(driven(plain, actions), rows)
    np.testing.assert_array_equal(batch.reset(SEEDS), first)
    np.testing.assert_array_equal(driven(batch, actions), rows)
    alone = world.batch(1)
    for number in (0, 7):
        np.testing.assert_array_equal(alone.reset(SEEDS[[number]])[0], first[number])
        single = driven(alone, actions[:, [number]])
        np.testing.assert_array_equal(single[:, 0], rows[:, number])


@pytest.mark.parametrize("name", ROADS)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_saved_state_and_copies_have_the_faults_of_their_episodes(name, fault):
    shift, front_end = FAULTS[fault]
    world = registry.make(name, shift=shift, front_end=front_end)
    actions = actions_of(world, len(SEEDS))
    batch = world.batch(len(SEEDS))
    batch.reset(SEEDS)
    driven(batch, actions[:2])
    state = batch.save()
    chosen = [0, 0, 5]
    copies = batch.branch(chosen)
    np.testing.assert_array_equal(copies.observation, batch.observation[chosen])
    rows = driven(batch, actions[2:])
    np.testing.assert_array_equal(driven(copies, actions[2:][:, chosen]), rows[:, chosen])
    batch.restore(state)
    np.testing.assert_array_equal(driven(batch, actions[2:]), rows)


@pytest.mark.parametrize("name", ["merge", "two_way"])
@pytest.mark.parametrize("action", [1, 4])
def test_a_vehicle_relative_to_the_ego_is_carried_on_in_its_frame(name, action):
    """The ego keeps or slows down, the other drives at 22 m/s and is not seen in two decisions."""
    world = registry.make(name, front_end="track=2")
    front = world.front_end
    units = np.array(world.ego.units)
    plain = registry.make(name).batch(1)
    plain.reset(0)
    memory = front.memory(1, world.n_features)
    start = None
    for time in range(3):
        rows = plain.observation.reshape(-1, 7).copy()
        ego = plain.buffers.vehicles[0, 0]
        start = ego["x"] + 60.0 if start is None else start
        relative = start + 22.0 * time - ego["x"], 4.0, 22.0 - ego["speed"], 0.0
        rows[1:] = 0.0
        if time == 0:
            rows[1] = [1.0, *np.array(relative) / units, 1.0, 0.0]
        shown, memory = front.see(rows.reshape(1, -1), memory, world.n_features)
        seen = shown.reshape(-1, 7)
        np.testing.assert_allclose(seen[1, 1:5] * units, relative, atol=0.05)
        np.testing.assert_array_equal(seen[0], rows[0])
        plain.step(np.array([action]), auto_reset=False)


def test_a_front_end_changes_nothing_that_is_not_declared():
    for name in SCENES:
        plain = registry.make(name).batch(4)
        wrapped = registry.make(name, shift="none", front_end="track=0").batch(4)
        np.testing.assert_array_equal(plain.reset(SEEDS[:4]), wrapped.reset(SEEDS[:4]))
        actions = actions_of(registry.make(name), 4)
        np.testing.assert_array_equal(driven(plain, actions), driven(wrapped, actions))


@pytest.mark.parametrize("name", SCENES)
def test_environments_show_what_batches_show(name):
    options = {"shift": "late,unseen=.3", "front_end": "track=2"}
    batch = registry.open_world(name, **options).batch(1)
    env = gymnasium.make(SCENE_IDS[name], **options)
    np.testing.assert_array_equal(env.reset(seed=4)[0], batch.reset([4])[0])
    for _ in range(3):
        batch.step(np.array([4]), auto_reset=False)
        np.testing.assert_array_equal(env.step(4)[0], batch.observation[0])


def test_options_of_every_road_name_the_wrappers():
    for name in (*ROADS, "merge-caused"):
        assert {"shift": "", "front_end": ""}.items() <= defaults(name).items()
    assert defaults("merge")["duration"] == 40.0


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("merge", {"shift": "exit=right"}, "merge has no option destination, .* latency, .* rate$"),
        ("two_way", {"shift": "dense"}, "no option initial_vehicle_count"),
        ("roundabout", {"shift": "late", "front_end": "exit=left"}, "leave out exit"),
        ("merge", {"shift": 3}, "shift must be text"),
        ("merge", {"front_end": "ego=3"}, "unknown front end 'ego'"),
    ],
)
def test_what_a_road_lacks_is_refused_with_the_reason(name, options, words):
    with pytest.raises(UserError, match=words):
        registry.open_world(name, **options)


def test_an_empty_text_keeps_what_a_road_has():
    world = Intersection().shifted("late", "known")
    assert world.shifted() == world
    assert world.shifted("", "track=2").shifts == world.shifts
    slow = world.shifted("wet")
    assert not slow.shifts and slow.front_end.ego.speeds == (0.0, 3.0, 6.0, 9.0)
