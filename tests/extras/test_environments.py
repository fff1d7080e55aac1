"""The example on the real highway-env: its pair, its whole path, its numbers from their seeds."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("highway_env", reason="extra `highway` is not installed")

from socialiq.cli.main import main
from socialiq.types import Ending

EXAMPLE = Path(__file__).parents[2] / "examples" / "environments" / "roundabout.py"
pytestmark = [
    # highway-env has a second version of the scenario; the example takes the first.
    pytest.mark.filterwarnings("ignore:.*is out of date:DeprecationWarning"),
]


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("roundabout", EXAMPLE)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def driven(example, driver, seed):
    env = example.make()
    seen, _ = env.reset(seed=seed)
    rows, ended = [], False
    while not ended:
        action = int(driver(seen[None])[0])
        seen, _, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
        rows.append((*info["reward_pair"], Ending.of_step(terminated, truncated, info)))
    return np.array(rows)


def test_the_example_is_short():
    assert len(EXAMPLE.read_text().splitlines()) < 100


def test_both_rewards_are_finite_and_vary(example):
    pushy, polite = (
        np.concatenate([driven(example, driver, seed) for seed in range(4)])
        for driver in (example.pushy, example.polite)
    )
    for rows in (pushy, polite):
        assert np.isfinite(rows).all() and (np.ptp(rows[:, :2], axis=0) > 0.1).all()
    assert pushy[:, 0].mean() > polite[:, 0].mean()
    assert (pushy[:, 1] <= 0).all()
    assert Ending.TIMEOUT in polite[:, 2]  # 11 s are over: a truncation


def test_an_episode_belongs_to_its_seed(example):
    first, again, other = (driven(example, example.pushy, seed) for seed in (3, 3, 4))
    assert first.tolist() == again.tolist() != other.tolist()


def test_the_whole_path_from_its_seeds(example):
    rows = example.main(episodes=3, updates=150, seeds=1)
    assert [row["driver"] for row in rows] == [
        "pushy",
        "polite",
        *(f"{angle}, seed 0" for angle in (0, 45, 90)),
    ]
    numbers = {row["driver"]: (row["r_env"], row["r_social"]) for row in rows}
    assert np.isfinite(list(numbers.values())).all()
    untrained = {row["driver"]: row for row in example.main(episodes=3, updates=1, seeds=1)}
    assert any(
        numbers[name] != (untrained[name]["r_env"], untrained[name]["r_social"])
        for name in numbers
        if "seed" in name
    )
    assert rows == example.main(episodes=3, updates=150, seeds=1)


def test_it_goes_by_name_on_the_command_line(tmp_path, capsys):
    data = tmp_path / "mixed.safetensors"
    drivers = [
        word for name in ("pushy", "polite") for word in ("--driver", f"python:{EXAMPLE}:{name}")
    ]
    command = ["collect", f"{EXAMPLE}:make", *drivers, "--episodes", "2", "--out", str(data)]
    assert main(command) == 2 and "--allow-code" in capsys.readouterr().err
    assert main([*command, "--allow-code"]) == 0 and data.exists()
    plain = ["collect", "highway_env:roundabout-v0", *drivers, "--out", str(tmp_path / "other")]
    assert main([*plain, "--allow-code"]) == 2
    assert "gives no reward pair" in capsys.readouterr().err
