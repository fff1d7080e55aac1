"""The wrappers take every constant from their world: one test for each option that they read."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from socialiq.worlds import grammar, registry
from socialiq.worlds.highway.options import ACCELERATION_RANGE, MAX_SPEED
from socialiq.worlds.highway.scenes import SCENES
from socialiq_recordings.world.recorded_world import RecordedWorld

SIZE = 40
JUNCTION = "junction"
RECORDED = Path(__file__).parents[3] / "old_files" / "v0_3_0" / "world.safetensors"
WORLDS = ("intersection", *SCENES, "road,seed=3", JUNCTION)
OPTIONS = (
    "",
    "latency=2",
    "target_speeds=[0,5,10,15]",
    "target_speeds=[3,6,9]",
    "policy_frequency=5",
    "simulation_frequency=30",
    "duration=8",
    "observed_vehicles=3",
    "left_hand=true",
    "control=continuous",
    "control=steering",
    "agents=2",
    "agents=2,frame=world",
    "exit=right",
)
OF_JUNCTION = {
    "": {},
    "latency=2": {},
    "target_speeds=[3,6,9]": {"levels": (-3.0, 0.0, 1.5)},  # its levels are accelerations
    "policy_frequency=5": {"policy_rate": 5},
    "duration=8": {"duration": 8.0},
    "observed_vehicles=3": {"observed_vehicles": 3},
}
"""Configuration of a recorded junction by the option that it has in the place of a road's."""
LACKS = {
    *((name, "exit=right") for name in SCENES),  # one way
    *((name, "control=continuous") for name in ("roundabout", "road,seed=3")),  # bends
    *((JUNCTION, option) for option in OPTIONS if option not in OF_JUNCTION),
}
CELLS = [(name, option) for name in WORLDS for option in OPTIONS if (name, option) not in LACKS]


def world_of(name, option, front_end="known"):
    """Return a world with an option, late actions and a front end that knows of them."""
    late = "" if "latency" in option else "latency=1"
    if name == JUNCTION:
        plain = RecordedWorld.load(RECORDED)
        config = dataclasses.replace(plain.config, **OF_JUNCTION[option])
        shift = late or option
        return dataclasses.replace(plain, config=config).shifted(shift, front_end)
    words = filter(None, [name, option, late, f"front_end=[{front_end}]"])
    return grammar.build(",".join(words))


def actions_of(world, batch, rng):
    if world.action_size:
        drawn = rng.uniform(-1.0, 1.0, (*batch.shape, world.action_size))
        return drawn.astype(np.float32)
    return rng.integers(world.n_actions, size=batch.shape)


def driven(world, decisions=20):
    """Return true and shown rows of all egos and whether they drive, (decision, ego, ...)."""
    batch = world.batch(SIZE)
    batch.reset(np.arange(SIZE))
    rng = np.random.default_rng(0)
    columns = []
    for _ in range(min(decisions, world.options.decisions)):
        running = batch.running
        if not running.any():
            break
        count = len(batch.buffers.ending)
        driving = batch.driving.reshape(SIZE, -1) & running[:, None]
        rows = batch.buffers.observation.reshape(count, -1), batch.observation.reshape(count, -1)
        columns.append([*(row[:, :7].astype(np.float64) for row in rows), driving.ravel()])
        batch.step(actions_of(world, batch, rng), auto_reset=False, rows=running)
    return [np.array(column) for column in zip(*columns, strict=True)]


def errors_of(world):
    """Return errors of the predicted speeds of egos, m/s, and on straight ways of places, m."""
    true, shown, driving = driven(world)
    late = world.shifts[0].latency
    now = true[:-late]
    reached = true[late:]
    predicted = shown[:-late]
    inside = driving[late:]
    for rows in (now, reached, predicted):  # what lies beyond the scales is shown as their end
        inside = inside & (np.abs(rows[..., 1:5]) < 1.0).all(axis=-1)
    units = np.array(world.ego.units)
    speeds, of_reached, of_now = (
        np.hypot(*np.moveaxis(rows[..., 3:5] * units[2:], -1, 0))
        for rows in (predicted, reached, now)
    )
    if world.options.continuous:  # near the largest speed of all the simulator brakes
        inside = inside & (of_now < MAX_SPEED - late * ACCELERATION_RANGE[1])
    straight = inside.copy()
    for step in range(late):
        turned = true[step : len(now) + step, :, 5:] != true[step + 1 : len(now) + step + 1, :, 5:]
        straight &= ~turned.any(axis=-1)
    away = np.moveaxis((predicted - reached)[..., 1:3] * units[:2], -1, 0)
    return (speeds - of_reached)[inside], np.hypot(*away)[straight]


@pytest.mark.parametrize(("name", "option"), CELLS)
def test_the_ego_is_predicted_exactly(name, option):
    """Errors are those of float32."""
    speeds, places = errors_of(world_of(name, option))
    assert len(speeds) > 70
    assert math.sqrt(np.mean(speeds**2)) < 1e-5
    assert np.abs(speeds).max() < 1e-4
    if name != "roundabout":  # its ways bend from the start
        assert len(places) > 15
        assert places.max() < 1e-4


@pytest.mark.parametrize(("name", "option"), CELLS)
def test_the_clock_tells_the_decisions_of_the_world(name, option):
    """It shows the time at which an action takes effect, to the end of every episode."""
    world = world_of(name, option)
    batch = world.batch(4)
    batch.reset(np.arange(4))
    rng = np.random.default_rng(0)
    late = world.shifts[0].latency
    decision = 0
    while (running := batch.running).any():
        assert {*batch.time[running].tolist()} == {decision + late}
        batch.step(actions_of(world, batch, rng), auto_reset=False, rows=running)
        decision += 1
    assert decision <= world.options.decisions + 1  # seconds are sums of floating-point numbers


def test_the_clock_tells_the_exit_by_the_decisions_of_the_world():
    """They are those without the shift, for a policy that doesn't know it."""
    for options, decisions in (({}, 20), ({"duration": 30.0}, 30), ({"shift": "twice"}, 20)):
        world = registry.make("intersection", front_end="exit=straight", **options)
        batch = world.batch(1)
        batch.reset(0)
        assert batch.time.tolist() == [decisions]


@pytest.mark.parametrize(
    "words",
    [
        "latency=3",
        "late,wet",
        "late,target_speeds=[3,6,9]",
        "late,simulation_frequency=4",
        "late,twice,simulation_frequency=6",
        "late,twice,front_end=[latency=1]",
    ],
)
def test_the_speed_of_the_ego_is_predicted_behind_other_shifts(words):
    front_end = "" if "front_end" in words else ",front_end=known"
    speeds, _ = errors_of(grammar.build(f"intersection,{words}{front_end}"))
    assert len(speeds) > 100
    assert np.abs(speeds).max() < 1e-4
