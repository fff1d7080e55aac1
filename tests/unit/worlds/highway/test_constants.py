"""The front end takes every constant from its world: one test for each option that it reads."""

import numpy as np
import pytest

from socialiq.worlds import registry
from socialiq.worlds.highway.scenes import SCENES

SEEDS = np.arange(40)


def errors_of(front_end="known", world="intersection", **options):
    """Return errors of the ego's predicted speed, m/s, after random actions."""
    world = registry.make(world, front_end=front_end, **options)
    batch = world.batch(len(SEEDS))
    batch.reset(SEEDS)
    rng = np.random.default_rng(0)
    late = world.shifts[0].latency
    shown = []
    speeds = []
    running = np.ones(len(SEEDS), bool)
    for number in range(world.options.decisions):
        true = batch.buffers.observation[running, 0].astype(np.float64)
        if number >= late:
            predicted = shown[number - late][running]
            scale = np.array(world.ego.units[2:])
            inside = (np.abs(predicted[:, 3:5]) < 1.0).all(1) & (np.abs(true[:, 3:5]) < 1.0).all(1)
            predicted = predicted[inside]
            true = true[inside]
            ends = (np.hypot(*(scale * rows[:, 3:5]).T) for rows in (predicted, true))
            speeds.append(np.subtract(*ends))
        shown.append(batch.observation.reshape(len(SEEDS), -1, 7)[:, 0])
        actions = rng.integers(world.n_actions, size=len(SEEDS))
        running &= batch.step(actions, auto_reset=False, rows=running).ending == 0
        if not running.any():
            break
    return np.concatenate(speeds)


def test_the_clock_tells_the_exit_by_the_decisions_of_the_world():
    """They are those without the shift, for a policy that doesn't know it."""
    for options, decisions in (({}, 20), ({"duration": 30.0}, 30), ({"shift": "twice"}, 20)):
        world = registry.make("intersection", front_end="exit=straight", **options)
        batch = world.batch(1)
        batch.reset(0)
        assert batch.time.tolist() == [decisions]


@pytest.mark.parametrize("name", SCENES)
def test_the_speed_of_the_ego_is_predicted_on_other_roads(name):
    """A lane change turns the ego, and keeps its speed; at the roundabout 15 m/s are seen as 1."""
    speeds = errors_of(world=name, shift="latency=2")
    most = 0.05 if name == "roundabout" else 1e-4
    assert len(speeds) > 100 and np.abs(speeds).max() < most


@pytest.mark.parametrize(
    ("front_end", "options"),
    [
        ("known", {"shift": "late"}),
        ("known", {"shift": "latency=3"}),
        ("known", {"shift": "late,wet"}),
        ("known", {"shift": "late", "target_speeds": (0.0, 5.0, 10.0, 15.0)}),
        ("known", {"shift": "late", "target_speeds": (3.0, 6.0, 9.0)}),
        ("known", {"shift": "late", "simulation_frequency": 4}),
        ("known", {"shift": "late,twice", "simulation_frequency": 6}),
        ("latency=1", {"shift": "late,twice"}),
    ],
)
def test_the_speed_of_the_ego_is_predicted_by_the_options_of_the_world(front_end, options):
    speeds = errors_of(front_end, **options)
    assert len(speeds) > 100 and np.abs(speeds).max() < 1e-4
