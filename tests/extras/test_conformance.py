"""The compiled roads are highway-env: 200 seeded episodes, every field, to the last bit."""

import dataclasses
import json
import subprocess
import sys

import gymnasium
import pytest

pytest.importorskip("highway_env", reason="extra `highway` is not installed")

from socialiq.worlds import conformance as conformance_module
from socialiq.worlds.intersection.options import (
    MULTI_AGENT,
    ContinuousOptions,
    FleetOptions,
    Options,
)
from socialiq.worlds.intersection.reference import IntersectionEnv, environment_config
from socialiq.worlds.intersection.world import Intersection

EPISODES = 30  # of each population and lane mode
COUNTS = ("episodes", "steps", "off_road")


def conformance(*arguments):
    command = [sys.executable, "-m", "socialiq", "conformance", "--json", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, json.loads(done.stdout)


@pytest.mark.parametrize("connected", [False, True])
@pytest.mark.parametrize("population", ["highway_env", "thesis"])
def test_bits_are_equal(population, connected):
    seed = 31_000 + 1000 * connected + 500 * (population == "thesis")
    flags = ["--connected"] if connected else []
    status, found = conformance(
        "--episodes", EPISODES, "--seed", seed, "--population", population, *flags
    )
    assert found["episodes"] == EPISODES
    assert found["steps"] > 8 * EPISODES
    assert found["discrete_differences"] == 0
    assert found["max_deviation"] == 0.0
    assert found["max_observation_deviation"] == 0.0
    assert found["max_reward_deviation"] == 0.0
    assert status == 0


@pytest.mark.parametrize("actions", ["continuous", "continuous_steering"])
def test_bits_are_equal_with_continuous_actions(actions):
    steering = actions == "continuous_steering"
    flags = ["--connected", "--population", "thesis"] if steering else []
    status, found = conformance(
        "--episodes", 12, "--seed", 33_000 + 500 * steering, "--actions", actions, *flags
    )
    assert found["episodes"] == 12
    assert found["steps"] > 5 * 12
    deviations = [found[name] for name in found if name not in COUNTS]
    assert deviations == [0] * 4
    assert status == 0


@pytest.mark.parametrize(("agents", "connected"), [(2, False), (4, True)])
def test_bits_are_equal_with_several_agents(agents, connected):
    seed = 35_000 + 1000 * connected + 500 * (agents == 4)
    flags = ["--agents", agents, *["--connected"] * connected]
    status, found = conformance("--episodes", 10, "--seed", seed, *flags)
    assert found["episodes"] == 10 and found["steps"] > 6 * 10
    assert [found[name] for name in found if name not in COUNTS] == [0] * 4
    assert status == 0


@pytest.mark.parametrize(
    ("flags", "steps"),
    [
        (["--scene", "merge", "--actions", "continuous"], 60),
        (["--scene", "two_way", "--actions", "continuous"], 30),
        (["--scene", "merge", "--actions", "continuous_steering"], 90),
        (["--scene", "roundabout", "--actions", "continuous_steering"], 40),
        (["--scene", "two_way", "--actions", "continuous_steering"], 70),
        (["--agents", 3, "--actions", "continuous"], 40),
        (["--agents", 4, "--actions", "continuous_steering", "--connected"], 40),
    ],
    ids=str,
)
def test_bits_of_other_continuous_actions_are_equal(flags, steps):
    status, found = conformance("--episodes", 12, "--seed", 36_000, *flags)
    assert found["episodes"] == 12 and found["steps"] > steps
    assert [found[name] for name in found if name not in COUNTS] == [0] * 4
    assert status == 0


@pytest.mark.filterwarnings("ignore:.*is out of date:DeprecationWarning")
@pytest.mark.parametrize("version", [0, 1, 2])
def test_the_registered_environments_have_this_class_and_these_options(version):
    made = gymnasium.make(f"highway_env:intersection-multi-agent-v{version}")
    # of the plain class they change the defaults alone; wrappers show the agents' results
    for kind in type(made.unwrapped).__mro__[: type(made.unwrapped).__mro__.index(IntersectionEnv)]:
        assert {name for name in vars(kind) if not name.startswith("__")} <= {"default_config"}
    options = FleetOptions(agents=2, connected_lanes=version == 2, **MULTI_AGENT)
    ours, theirs = environment_config(options), made.unwrapped.config
    for side, inner in (("action", "action_config"), ("observation", "observation_config")):
        given = theirs[side][inner]
        given.pop("flatten", None)  # accepted and ignored
        ours[side][inner] = {name: ours[side][inner][name] for name in given}
    assert {name: theirs[name] for name in ours} == ours


def test_bits_are_equal_where_leaving_the_road_ends_the_episode():
    flags = ["--actions", "continuous_steering", "--offroad-terminal"]
    status, found = conformance("--episodes", 16, "--seed", 34_500, *flags)
    assert found["episodes"] == 16 and found["off_road"] > 8
    assert [found[name] for name in found if name not in COUNTS] == [0] * 4
    assert status == 0


@pytest.mark.parametrize("scene", ["merge", "roundabout", "two_way"])
def test_bits_of_other_roads_are_equal(scene):
    status, found = conformance("--scene", scene, "--episodes", 20, "--seed", 34_000)
    assert found["episodes"] == 20
    assert found["steps"] > 5 * 20
    deviations = [found[name] for name in found if name not in COUNTS]
    assert deviations == [0] * 4
    assert status == 0


def test_default_numpy_has_no_discrete_difference():
    status, found = conformance("--episodes", 12, "--seed", 32_000, "--default-numpy")
    assert found["discrete_differences"] == 0
    assert status == 0


def changed_in_core(monkeypatch, options, **change):
    """Compare a core that has other options than highway-env."""
    real = Intersection.batch

    def batch(world, size, back_end="core"):
        if back_end == "core":
            world = dataclasses.replace(world, options=dataclasses.replace(options, **change))
        return real(world, size, back_end=back_end)

    monkeypatch.setattr(Intersection, "batch", batch)
    return list(conformance_module.compare_intersection(options, 4, 0))


@pytest.mark.parametrize(
    ("change", "noticed"),
    [
        ({"spawn_probability": 0.9}, "discrete_differences"),
        ({"target_speeds": (0.0, 4.4, 8.8)}, "max_deviation"),
        ({"progress_unit": 27.0}, "max_reward_deviation"),
    ],
)
def test_a_difference_is_noticed(monkeypatch, change, noticed):
    compared = changed_in_core(monkeypatch, Options(), **change)
    assert max(getattr(episode, noticed) for episode in compared) > 0


@pytest.mark.parametrize("ours", [False, True])
def test_an_ending_that_the_other_side_lacks_is_noticed(monkeypatch, ours):
    options = ContinuousOptions(actions="continuous_steering", offroad_terminal=not ours)
    compared = changed_in_core(monkeypatch, options, offroad_terminal=ours)
    assert any(one.off_road and one.discrete_differences for one in compared)
