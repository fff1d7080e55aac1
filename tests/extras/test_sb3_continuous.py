"""Policies of Stable-Baselines3 with continuous actions act here as they do there."""

import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.demonstrations import files
from socialiq.errors import UserError
from socialiq.evaluation.rollout import rollout_env
from socialiq.policies.load import load_policy
from socialiq.worlds.environment import make_environment

sb3 = pytest.importorskip("stable_baselines3", reason="extra `sb3` is not installed")


@pytest.mark.parametrize("algorithm", ["SAC", "TD3", "DDPG", "PPO", "A2C"])
def test_its_actions_are_theirs_in_units_of_the_bounds(algorithm: str, tmp_path: Path) -> None:
    kind, file = getattr(sb3, algorithm), tmp_path / "policy.zip"
    model = kind(
        "MlpPolicy", "Pendulum-v1", policy_kwargs={"net_arch": [8, 8]}, seed=0, device="cpu"
    )
    model.save(file)
    env = gymnasium.make("Pendulum-v1")
    seen = np.stack([env.observation_space.sample() for _ in range(200)])
    loaded = load_policy(str(file), 3, 0, action_size=1)
    ours = loaded.policy.predict(seen)[0]
    np.testing.assert_allclose(2.0 * ours, model.predict(seen, deterministic=True)[0], atol=1e-5)
    drawn = loaded.policy.predict(np.repeat(seen[:1], 4000, axis=0), deterministic=False)[0]
    theirs = model.predict(np.repeat(seen[:1], 4000, axis=0), deterministic=False)[0]
    assert 2.0 * drawn.std() == pytest.approx(theirs.std(), rel=0.06, abs=1e-6)
    made = make_environment("Pendulum-v1", continuous=True)
    assert rollout_env(made, loaded.policy, 1, seed=0).transitions.n_transitions == 200
    with pytest.raises(UserError, match="takes 3 features and actions of 1 number,"):
        load_policy(str(file), 3, 0, action_size=2)


POLE = """
import gymnasium
from socialiq import RewardPairWrapper


def make():
    swings = gymnasium.wrappers.TimeLimit(gymnasium.make("Pendulum-v1"), 5)
    return RewardPairWrapper(swings, lambda step: (step.reward, -float(step.action[0]) ** 2))


def still(seen):
    return 0.0 * seen[:, :1]
"""


def test_they_go_through_collect_evaluate_and_audit(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("short_pole.py").write_text(POLE)
    for kind in ("SAC", "TD3", "PPO"):
        net = {"net_arch": [8]}
        model = getattr(sb3, kind)("MlpPolicy", "Pendulum-v1", policy_kwargs=net, device="cpu")
        model.save(f"{kind}.zip")
    zips, world = ("SAC.zip", "TD3.zip", "PPO.zip"), "short_pole.py:make"
    drivers = [word for one in zips for word in ("--driver", one)]
    out = ["--episodes", "2", "--out", "shown.safetensors", "--allow-code"]
    assert main(["collect", world, *drivers, *out]) == 0
    found = files.load(Path("shown.safetensors"), continuous=True)
    assert found.mode_names == ("SAC", "TD3", "PPO") and found.action_size == 1
    assert main(["evaluate", *zips, "--world", world, "--episodes", "2", "--allow-code"]) == 0
    new = ["profile", "new", "--world", world, "--angle", "0", "--out", "p.toml"]
    assert main([*new, "--margin", "1", "--allow-code"]) == 0
    declared = Path("p.toml").read_text().replace("min_arrival = 0.0", "min_arrival = 0.5")
    Path("p.toml").write_text(declared)
    audit = ["audit", "SAC.zip", "--profile", "p.toml", "--reference", "PPO.zip"]
    audit += ["--reference", "python:short_pole.py:still", "--isolation", "none", "--seed", "7"]
    assert main([*audit, "--episodes", "20", "--out", "report", "--allow-code"]) == 1
    record = json.loads(Path("report/report.json").read_text())["policy"]["record"]
    assert record["kind"] == "sb3" and record["action_size"] == 1
    capsys.readouterr()
    assert main(["view", "SAC.zip", "--no-open"]) == 2
    assert "the world has 70 and 3 discrete actions" in capsys.readouterr().err
