"""Episodes of the scenes: reproducible, in their spaces, with rewards and endings that fit."""

import gymnasium
import numpy as np
import pytest

from socialiq.audit.profile.profile import world_of as world_of_profile
from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds import SCENE_IDS
from socialiq.worlds.environment import is_environment, make_environment, sizes
from socialiq.worlds.highway.options import Contact
from socialiq.worlds.highway.scenes import FASTER, IDLE, LANE_LEFT, SCENES, SLOWER
from socialiq.worlds.highway.world import world_of

NAMES = list(SCENES)


def actions_of(size, steps, seed=0):
    return np.random.default_rng(seed).integers(5, size=(steps, size))


@pytest.mark.parametrize("name", NAMES)
def test_episodes_do_not_depend_on_their_neighbours(name):
    many, alone = world_of(name).batch(6), world_of(name).batch(1)
    many.reset(10)
    alone.reset(14)
    for row in actions_of(6, 30):
        np.testing.assert_array_equal(
            many.step(row).observation[4:5], alone.step(row[4:5]).observation
        )
    np.testing.assert_array_equal(many.observation[4:5], alone.observation)


@pytest.mark.two_cores
@pytest.mark.parametrize("name", NAMES)
def test_two_threads_drive_the_same_episodes(name):
    one, two = world_of(name).batch(9), world_of(name).batch(9, threads=2)
    np.testing.assert_array_equal(one.reset(3), two.reset(3))
    for row in actions_of(9, 15):
        np.testing.assert_array_equal(one.step(row).rewards, two.step(row).rewards)


@pytest.mark.parametrize("name", NAMES)
def test_rewards_are_the_weighted_signals(name):
    batch = world_of(name).batch(50)
    batch.reset(0)
    endings = set()
    for row in actions_of(50, 20):
        made = batch.step(row)
        weigh = {signal: getattr(batch.options, f"{signal}_weight") for signal in made.signals}
        total = sum(weigh[signal] * values for signal, values in made.signals.items())
        np.testing.assert_allclose(sum(made.rewards), total, atol=1e-12)
        collided = made.ending == int(Ending.COLLISION)
        np.testing.assert_array_equal(made.signals["collision"], collided)
        assert np.abs(made.observation).max() <= 1.0
        endings |= {Ending(ending) for ending in made.ending.tolist()}
    arrives = {Ending.ARRIVAL} if np.isfinite(batch.scene.road.sight["arrival"]).all() else set()
    assert {Ending.COLLISION} | arrives <= endings


def test_progress_of_the_merge_is_the_way_along_the_motorway():
    batch = world_of("merge").batch(1)
    batch.reset(3)
    begun = batch.buffers.vehicles[0, 0]["x"].copy()
    metres = 0.0
    while (made := batch.step(np.array([IDLE]), auto_reset=False)).ending[0] == Ending.NONE:
        metres += made.signals["progress"][0] * batch.options.progress_unit
    assert made.ending[0] in (Ending.ARRIVAL, Ending.COLLISION)
    assert metres == pytest.approx(float(batch.buffers.before[0, 0]["x"] - begun))


def test_a_lane_change_takes_the_other_lane():
    batch = world_of("merge").batch(30)
    batch.reset(0)
    assert (batch.buffers.vehicles[:, 0]["target_lane"] == 1).all()
    batch.step(np.full(30, LANE_LEFT), auto_reset=False)
    assert (batch.buffers.vehicles[:, 0]["target_lane"] == 0).all()
    assert (batch.buffers.vehicles[:, 0]["y"] < 4.0).all()


def test_who_waits_in_the_roundabout_times_out():
    batch = world_of("roundabout").batch(20)
    batch.reset(0)
    running = np.ones(20, bool)
    for _ in range(11):
        made = batch.step(np.full(20, SLOWER), auto_reset=False, rows=running)
        running &= made.ending == 0
    assert (made.ending == int(Ending.TIMEOUT)).mean() > 0.5


@pytest.mark.parametrize("name", NAMES)
def test_the_id_and_the_name_alone_are_accepted(name):
    assert is_environment(name)
    assert sizes(make_environment(SCENE_IDS[name])) == sizes(make_environment(name)) == (35, 5)
    assert world_of_profile(name, {}).name == name


@pytest.mark.parametrize(
    ("call", "mend"),
    [
        (lambda batch: batch.step([1, 5]), "actions must be 0 to 4"),
        (lambda batch: batch.step([0.0, 1.0]), "whole numbers"),
        (lambda batch: batch.step([1]), "2 whole numbers"),
        (lambda batch: batch.reset(-1), "at least 0"),
        (lambda _: world_of("merge").batch(0), "size must be at least 1"),
        (lambda _: world_of("merge", spawns=2), "unknown option of merge 'spawns'"),
        (lambda _: world_of("merge", duration=-1.0), "duration must be a positive number"),
    ],
)
def test_bad_input_is_one_line(call, mend):
    batch = world_of("merge").batch(2)
    batch.reset(0)
    with pytest.raises(UserError, match=mend) as caught:
        call(batch)
    assert "\n" not in str(caught.value)


def test_an_episode_begins_before_it_steps():
    with pytest.raises(UserError, match="reset it first"):
        world_of("merge").batch(1).step([1])


@pytest.mark.parametrize("name", NAMES)
def test_a_restored_state_continues_with_equal_bits(name):
    batch, fork = world_of(name).batch(3), world_of(name).batch(6)
    batch.reset(7)
    for row in actions_of(3, 3):
        batch.step(row)
    fork.restore(batch.save().rows([0, 0, 1, 1, 2, 2]))
    for row in actions_of(3, 20, seed=1):
        ours, theirs = batch.step(row), fork.step(np.repeat(row, 2))
        np.testing.assert_array_equal(np.repeat(ours.observation, 2, 0), theirs.observation)
        np.testing.assert_array_equal(np.repeat(ours.contact, 2), theirs.contact)
    np.testing.assert_array_equal(np.repeat(batch.time, 2), fork.time)


@pytest.mark.parametrize("name", NAMES)
def test_a_collision_names_its_contact(name):
    batch = world_of(name).batch(200)
    batch.reset(0)
    for row in actions_of(200, 10):
        made = batch.step(row)
        collided = made.ending == int(Ending.COLLISION)
        assert (made.contact[collided] != int(Contact.NONE)).all()
        assert (made.contact[~collided] == int(Contact.NONE)).all()


def test_the_time_is_a_last_feature_on_request():
    env = gymnasium.make("socialiq/Merge-v1", clock=True)
    assert env.reset(seed=1)[0].shape == (36,)
    assert env.step(FASTER)[0][-1] == 1.0
