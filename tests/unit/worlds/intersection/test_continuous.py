"""Continuous actions of the ego: commands, motion with a known answer, what is refused."""

import math

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from socialiq.errors import UserError
from socialiq.worlds import OLD_IDS
from socialiq.worlds.gym import RoadEnv, RoadVectorEnv
from socialiq.worlds.highway.scene_batch import commands
from socialiq.worlds.intersection.options import ContinuousOptions, Options
from socialiq.worlds.intersection.world import Intersection

STEERED = ContinuousOptions(actions="continuous_steering", spawn_probability=0.0)


def ego_of(batch):
    """The egos' records after the sub-steps of the last decision."""
    return batch.buffers.after[np.arange(batch.size), batch.buffers.present[:, 1]]


def begun(options, size=1, seed=100):
    batch = Intersection(options).batch(size)
    batch.reset(seed)
    return batch


def test_values_mean_commands():
    found = commands(np.array([[-1.0, 1.0], [0.0, 0.0], [0.5, -0.5]]))
    np.testing.assert_allclose(found[0], [-5.0, 0.0, 2.5])
    np.testing.assert_allclose(np.rad2deg(found[1]), [45.0, 0.0, -22.5])
    acceleration, steering = commands(np.ones((2, 1), np.float32))
    assert acceleration.dtype == np.float32 and not steering.any()


@pytest.mark.parametrize("value", [1.0, 0.3, -0.4])
def test_acceleration_alone_drives_straight_on(value):
    batch = begun(ContinuousOptions(), size=20)
    ego = batch.buffers.vehicles[np.arange(20), batch.buffers.episodes["controlled"][:, 0]].copy()
    made = batch.step(np.full((20, 1), value))
    later = ego_of(batch)[~(whole := made.contact > 0)]
    np.testing.assert_allclose(later["speed"], 10.0 + 5.0 * value)
    # ten sub-steps, each at the speed that it begins with
    metres = 10.0 + 0.5 * (1.0 - 0.1) * 5.0 * value
    np.testing.assert_allclose(ego["y"][~whole] - later["y"], metres)
    np.testing.assert_allclose(later["x"], ego["x"][~whole])


def test_constant_steering_drives_a_circle():
    batch = begun(STEERED, size=20)
    made = batch.step(np.tile([0.0, -0.2], (20, 1)))
    later = ego_of(batch)[made.contact == 0]
    slip = math.atan(0.5 * math.tan(0.2 * math.pi / 4))
    turned = later["heading"] + math.pi / 2  # it began to the north
    np.testing.assert_allclose(turned, -10.0 * math.sin(slip) / 2.5)


def test_speed_has_the_bound_of_every_vehicle():
    batch = begun(ContinuousOptions(spawn_probability=0.0), size=20)
    running, slowest = np.ones(20, bool), []
    for _ in range(15):
        made = batch.step(-np.ones((20, 1)), auto_reset=False, rows=running)
        running &= made.ending == 0
        slowest.append(made.speed[running].min())
    np.testing.assert_allclose(slowest[:9], 10.0 - 5.0 * np.arange(1, 10))  # it reverses
    assert -41.0 < slowest[-1] <= -40.0


def test_episodes_do_not_depend_on_their_neighbours():
    actions = np.random.default_rng(0).uniform(-1, 1, (6, 8, 2))
    many, alone = begun(STEERED, 8), begun(STEERED, 1, seed=103)
    for row in actions:
        np.testing.assert_array_equal(
            many.step(row).observation[3:4], alone.step(row[3:4]).observation
        )


def test_an_episode_continues_from_a_saved_state():
    batch = begun(STEERED, 4)
    actions = np.random.default_rng(1).uniform(-1, 1, (6, 4, 2)).astype(np.float32)
    batch.step(actions[0])
    kept = batch.save()
    first = [batch.step(row).rewards.env for row in actions[1:]]
    batch.restore(kept)
    np.testing.assert_array_equal(first, [batch.step(row).rewards.env for row in actions[1:]])


def test_rows_that_do_not_decide_stay_as_they_are():
    batch = begun(STEERED, 3)
    before = batch.save().vehicles[[0, 2]]
    batch.step(np.ones((3, 2)), rows=[1])
    assert (batch.save().vehicles[[0, 2]] == before).all()


def test_the_start_is_that_of_discrete_actions():
    discrete, continuous = begun(Options(), 20), begun(ContinuousOptions(), 20)
    np.testing.assert_array_equal(discrete.observation, continuous.observation)


def test_a_random_destination_is_drawn():
    options = ContinuousOptions(actions="continuous_steering", destination="random")
    batch = begun(options, 50)
    ego = batch.buffers.vehicles[np.arange(50), batch.buffers.episodes["controlled"][:, 0]]
    assert set(ego["destination"].tolist()) == {1, 2, 3}


@pytest.mark.parametrize(
    ("actions", "mend"),
    [
        (np.zeros(2), r"of the shape \(2, 2\), got float64 of the shape \(2,\)"),
        (np.zeros((2, 1)), r"of the shape \(2, 2\)"),
        (np.zeros((2, 2), int), "must be float32 or float64"),
        (np.full((2, 2), np.nan), "between -1 and 1, got nan"),
        (np.array([[0.0, 0.0], [0.0, 1.5]]), "got 1.5: clip them"),
        ("fast", "must be float32 or float64"),
    ],
)
def test_bad_actions_are_refused(actions, mend):
    batch = begun(STEERED, 2)
    kept = batch.save()
    with pytest.raises(UserError, match=mend) as caught:
        batch.step(actions)
    assert "\n" not in str(caught.value)
    assert (batch.save().vehicles == kept.vehicles).all()


def test_bad_options_are_refused():
    with pytest.raises(UserError, match="can't reach 'left' by acceleration alone"):
        ContinuousOptions(destination="left")
    with pytest.raises(UserError, match="choose one of continuous, continuous_steering"):
        gymnasium.make(OLD_IDS["intersection-continuous"], actions="jumps")


def test_the_world_names_its_space():
    assert Intersection().action_space.n == 3
    assert Options().width == 0
    assert Intersection(ContinuousOptions()).action_space.shape == (1,)
    assert Intersection(STEERED).action_space.shape == (2,)
    with pytest.raises(UserError, match="actions of this intersection are continuous"):
        Intersection(STEERED).n_actions  # noqa: B018
    assert Intersection().description == f"intersection {Options()}"
    assert "continuous_steering" in Intersection(STEERED).description


@pytest.mark.parametrize("name", [*OLD_IDS.values()][:3])
def test_gymnasium_accepts_it(name):
    env = gymnasium.make(name)
    check_env(env.unwrapped, skip_render_check=True)
    assert env.action_space.dtype == np.float32


def test_the_vector_environment_is_single_ones_side_by_side():
    options = {"actions": "continuous_steering", "destination": "left"}
    mode = AutoresetMode.NEXT_STEP
    ours = RoadVectorEnv(num_envs=3, autoreset_mode=mode, **options)
    theirs = SyncVectorEnv([lambda: RoadEnv(**options)] * 3, autoreset_mode=mode)
    np.testing.assert_array_equal(ours.reset(seed=1)[0], theirs.reset(seed=1)[0])
    ours.action_space.seed(0)
    for _ in range(40):
        actions = ours.action_space.sample()
        step, expected = ours.step(actions), theirs.step(actions)
        for column, other in zip(step[:4], expected[:4], strict=True):
            np.testing.assert_array_equal(column, other)
