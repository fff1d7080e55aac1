import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import socialiq
from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds import RECORDED_JUNCTION
from socialiq.worlds.environment import make_environment
from socialiq.worlds.registry import open_world
from socialiq_recordings.world.batch import JunctionBatch
from socialiq_recordings.world.config import AS_DRIVER
from socialiq_recordings.world.replay import replay

ENV = RECORDED_JUNCTION
assert socialiq


def test_the_environment_passes_gymnasiums_check(world_file):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(ENV, file=world_file).unwrapped, skip_render_check=True)


def test_the_seed_determines_an_episode(world_file):
    env, again = (make_environment(str(world_file)) for _ in range(2))
    for seed in range(5):
        first, second = env.reset(seed=seed), again.reset(seed=seed)
        assert np.array_equal(first[0], second[0]) and first[1] == second[1]
        for action in (3, 5, 0, 4):
            one, two = env.step(action), again.step(action)
            assert np.array_equal(one[0], two[0]) and one[1:4] == two[1:4]
            if one[2] or one[3]:
                break


def test_the_time_is_a_feature_if_asked(world_file):
    env = gymnasium.make(ENV, file=world_file, clock=True)
    first, _ = env.reset(seed=0)
    after, *_ = env.step(3)
    assert (first[-1], after[-1]) == (0.0, 1.0)


def test_a_picture_of_a_moment(world_file):
    env = gymnasium.make(ENV, file=world_file, render_mode="rgb_array")
    env.reset(seed=0)
    frame = env.render()
    assert isinstance(frame, np.ndarray) and frame.dtype == np.uint8 and frame.std() > 0


@pytest.mark.parametrize("given", [{}, {"file": "nowhere.safetensors"}, {"sha256": "0" * 64}])
def test_what_is_no_world_is_refused_in_one_line(world_file, given):
    given = {"file": world_file} | given if "sha256" in given else given
    with pytest.raises(UserError) as raised:
        gymnasium.make(ENV, **given)
    assert "\n" not in str(raised.value)


def driven(world, action: int, seeds: range) -> JunctionBatch:
    batch = JunctionBatch(world, len(seeds))
    batch.reset(seeds)
    return batch


def test_rows_do_not_depend_on_their_number(world):
    many, one = driven(world, 3, range(6)), JunctionBatch(world, 1)
    made = many.step(np.full(6, 4))
    for seed in range(6):
        one.reset([seed])
        alone = one.step(np.array([4]))
        assert np.array_equal(alone.observation[0], made.observation[seed])
        assert alone.rewards.env[0] == made.rewards.env[seed]


def endings(world, action: int, seeds: range) -> np.ndarray:
    batch, live = driven(world, action, seeds), np.ones(len(seeds), bool)
    found = np.zeros(len(seeds), int)
    while live.any():
        made = batch.step(np.full(len(seeds), action), auto_reset=False, rows=live)
        found[live] = made.ending[live]
        live &= made.ending == 0
    return found


def test_drivers_arrive_and_who_never_brakes_may_not(world):
    drivers = endings(world, AS_DRIVER, range(40))
    assert (drivers == Ending.ARRIVAL).all()
    standing = endings(world, 0, range(40))
    assert not (standing == Ending.COLLISION).any()


def test_an_observation_is_in_the_frame_of_the_route(world):
    """The ego comes from the south; the other's distance beside its route is that to the middle."""
    batch = JunctionBatch(world, 1)
    seed = next(s for s in range(50) if batch.reset([s]) is not None and batch.egos[0] == 1)
    seen = batch.reset([seed]).reshape(-1, 7)
    moment = 0.1 * float(batch.buffers.episodes["sub_steps"][0])
    entry = 50.0 - 0.75  # of the way from the south
    assert seen[0] == pytest.approx(
        [1.0, 0.0, (entry - 6.0 * moment) / 100, 0.0, -6.0 / 20, 0.0, -1.0], abs=2e-3
    )
    west = next(row for row in seen[1:] if abs(row[5]) > 0.5)
    assert west[1] == pytest.approx((8.0 * moment - 40.0) / 100, abs=2e-3)
    assert west[2] == pytest.approx(-0.75 / 100, abs=2e-3)
    assert west[3] == pytest.approx(8.0 / 20, abs=2e-3) and west[5] == pytest.approx(1.0)


def test_replayed_moments_are_observed_as_the_environment_observes_them(world):
    table = replay(world).table
    batch = JunctionBatch(world, 1)
    for seed in range(60):
        seen = batch.reset([seed])[0]
        if batch.buffers.episodes["sub_steps"][0] == 0:
            first = table.episode_starts[int(batch.egos[0])]
            assert np.array_equal(seen, table.observation[first])
            return
    pytest.fail("no episode begins at the first moment")


@pytest.mark.parametrize("shift", ["latency=1", "unseen=.5", "noise=1", "late,unseen=.5 or none"])
def test_faults_are_those_of_every_road(world, world_file, shift):
    """By the seed, in copies and in the environment; late actions are those of before."""
    shifted = world.shifted(shift, "track=2")
    assert shifted.description != world.description and "track=2" in shifted.description
    batch, again = shifted.batch(6), shifted.batch(6)
    plain = world.batch(6)
    assert batch.reset(range(6)).tolist() == again.reset(range(6)).tolist()
    plain.reset(range(6))
    idle = world.config.levels.index(0.0)
    shown = [made.step(np.full(6, 5), auto_reset=False) for made in (batch, again, plain)]
    np.testing.assert_array_equal(shown[0].observation, shown[1].observation)
    if shift == "latency=1":
        plain.reset(range(6))
        on_time = plain.step(np.full(6, idle), auto_reset=False)
        np.testing.assert_array_equal(shown[0].speed, on_time.speed)
    copies = batch.branch([2, 2])
    state = batch.save()
    after = batch.step(np.full(6, 4), auto_reset=False, rows=batch.running).observation
    copied = copies.step(np.full(2, 4), auto_reset=False, rows=copies.running).observation
    np.testing.assert_array_equal(copied, after[[2, 2]])
    batch.restore(state)
    np.testing.assert_array_equal(batch.observation, shown[0].observation)
    env = make_environment(str(world_file), {"shift": shift, "front_end": "track=2"})
    np.testing.assert_array_equal(env.reset(seed=3)[0], again.reset(range(6))[3])


def test_what_a_recording_fixes_is_refused(world):
    with pytest.raises(UserError, match="no option initial_vehicle_count"):
        world.shifted("dense")


def test_a_front_end_predicts_the_speed_by_accelerations(world):
    idle = world.config.levels.index(0.0)
    late = world.shifted("late", "latency=1").batch(6)
    plain = world.batch(6)
    late.reset(np.arange(6))
    plain.reset(np.arange(6))
    plain.step(np.full(6, idle), auto_reset=False)
    for action in (0, idle, len(world.config.levels) - 1):
        late.step(np.full(6, action), auto_reset=False, rows=late.running)
        plain.step(np.full(6, action), auto_reset=False, rows=plain.running)
        driving = late.running & plain.running
        assert driving.any()
        predicted = np.hypot(late.observation[driving, 3], late.observation[driving, 4])
        reached = np.hypot(plain.observation[driving, 3], plain.observation[driving, 4])
        np.testing.assert_allclose(predicted, reached, atol=1e-5)


def test_the_grammar_takes_faults_of_a_file_and_no_options(world, world_file):
    text = f"{world_file},late,noise=1,front_end=[track=2]"
    shifted = world.shifted("late,noise=1", "track=2")
    assert open_world(text).description == shifted.description
    seen = make_environment(text).reset(seed=3)[0]
    np.testing.assert_array_equal(seen, shifted.batch(1).reset([3])[0])
    timed = make_environment(f"{world_file},clock=true")
    assert timed.observation_space.shape == (world.n_features + 1,)
    for option in ("duration=30", "clock=true"):
        with pytest.raises(UserError, match=f"takes no options, got {option.split('=')[0]}"):
            open_world(f"{world_file},{option}")
    with pytest.raises(UserError, match="no option initial_vehicle_count"):
        open_world(f"{world_file},dense")
