"""The compiled intersection is highway-env: 208 seeded episodes, every field, to the last bit."""

import json
import subprocess
import sys

import pytest

EPISODES = 52


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


def test_default_numpy_has_no_discrete_difference():
    status, found = conformance("--episodes", 12, "--seed", 32_000, "--default-numpy")
    assert found["discrete_differences"] == 0
    assert status == 0
