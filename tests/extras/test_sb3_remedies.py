"""Advice of the documentation on policies under VecNormalize holds with the real library."""

import io
import json
import re
import warnings
import zipfile
from pathlib import Path

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="extra `sb3` is not installed")
pytest.importorskip("onnxruntime", reason="extra `onnx` is not installed")

import stable_baselines3 as sb3
import torch
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.policies.load import load_policy

DOCUMENTED = Path(__file__).parents[2] / "docs" / "policies.md"
OBSERVATIONS = np.random.default_rng(0).normal(0.3, 2.0, size=(2_000, 4)).astype(np.float32)


def block(number):
    """The code of the section on VecNormalize."""
    section = DOCUMENTED.read_text().partition("### Trained under")[2]
    return re.findall(r"```text\n(.*?)```", section, re.DOTALL)[number]


def trained(algorithm="PPO", world="CartPole-v1", **settings):
    """A short training, and its VecNormalize."""
    env = VecNormalize(DummyVecEnv([lambda: gymnasium.make(world)]))
    if algorithm in ("PPO", "A2C"):
        settings["n_steps"] = 64
    net = {"net_arch": [8]}
    model = getattr(sb3, algorithm)(
        "MlpPolicy", env, policy_kwargs=net, seed=0, device="cpu", **settings
    )
    model.learn(64)
    return model, env


def actions(model, env):
    return model.predict(env.normalize_obs(OBSERVATIONS), deterministic=True)[0]


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("algorithm", ["PPO", "A2C"])
def test_normalised_policy_is_refused_and_the_remedies_give_its_actions(algorithm):
    model, env = trained(algorithm)
    model.save("policy.zip")
    with pytest.raises(UserError, match=r"VecNormalize.*add them to the zip as vecnormalize\.json"):
        load_policy("policy.zip", 4, 2)
    expected = actions(model, env)
    names = {"model": model, "env": env}
    with warnings.catch_warnings(action="ignore"):  # the newer exporter needs a further package
        exec(block(1).replace('"policy.onnx")', '"policy.onnx", dynamo=False)'), names)
    exec(block(0), names)
    loaded = load_policy("policy.zip", 4, 2)
    np.testing.assert_array_equal(loaded.policy.predict(OBSERVATIONS)[0], expected)
    assert loaded.record.details["normalised"] and loaded.record.soft
    exported = load_policy("policy.onnx", 4, 2).policy.predict(OBSERVATIONS)[0]
    assert np.mean(exported != expected) <= 0.001  # float32 in the place of float64
    assert len(np.unique(expected)) == 2
    getattr(sb3, algorithm).load("policy.zip", device="cpu")


def test_evaluate_and_audit_refuse_it_in_one_line(capsys):
    trained()[0].save("policy.zip")
    words = ["--world", "CartPole-v1", "--episodes", "2"]
    assert main(["evaluate", "policy.zip", *words]) == 2
    assert "VecNormalize" in capsys.readouterr().err
    Path("pole.py").write_text(
        "import gymnasium\nfrom socialiq import RewardPairWrapper\n\n\n"
        "def make():\n"
        "    env = gymnasium.make('CartPole-v1')\n"
        "    return RewardPairWrapper(env, lambda step: (step.reward, 0.0))\n\n\n"
        "def still(seen):\n    return [0 for _ in seen]\n"
    )
    new = ["profile", "new", "--world", "pole.py:make", "--angle", "0", "--out", "p.toml"]
    assert main([*new, "--margin", "1", "--allow-code"]) == 0
    audit = ["audit", "policy.zip", "--profile", "p.toml", "--episodes", "20", "--seed", "7"]
    audit += ["--reference", "python:pole.py:still", "--isolation", "none", "--allow-code"]
    capsys.readouterr()
    assert main([*audit, "--out", "report"]) == 2
    assert "VecNormalize" in capsys.readouterr().err and not Path("report").exists()


def test_rewards_alone_may_be_normalised():
    model, _ = trained()
    model.save("policy.zip")
    with zipfile.ZipFile("policy.zip", "a") as archive:
        archive.writestr("vecnormalize.json", '{"norm_obs": false}')
    loaded = load_policy("policy.zip", 4, 2)
    expected = model.predict(OBSERVATIONS, deterministic=True)[0]
    np.testing.assert_array_equal(loaded.policy.predict(OBSERVATIONS)[0], expected)
    assert loaded.record.details["normalised"] is False


@pytest.mark.parametrize(
    "place",
    [
        "vecnormalize.pkl",
        "x_vecnormalize_64_steps.pkl",
        "dqn/vec_normalize.pkl",
        "VecNormalize.pkl",
    ],
)
def test_statistics_beside_a_zip_that_shows_nothing_refuse_it(place):
    model, env = trained("DQN", learning_starts=10, buffer_size=100)
    Path("dqn").mkdir()
    model.save("dqn.zip")
    env.save(place)
    with pytest.raises(UserError, match=f"lies beside {place}, whose statistics"):
        load_policy("dqn.zip", 4, 2)
    exec(block(0).replace("policy.zip", "dqn.zip"), {"env": env})
    found = load_policy("dqn.zip", 4, 2).policy.predict(OBSERVATIONS)[0]
    np.testing.assert_array_equal(found, actions(model, env))


@pytest.mark.parametrize("algorithm", ["A2C", "PPO", "SAC"])
def test_deterministic_action_with_state_dependent_noise_is_theirs(algorithm):
    net = {"net_arch": [8, 8]}
    model = getattr(sb3, algorithm)(
        "MlpPolicy", "Pendulum-v1", use_sde=True, policy_kwargs=net, seed=0, device="cpu"
    )
    with torch.no_grad():
        for parameter in model.policy.parameters():
            parameter.add_(0.5 * torch.randn_like(parameter))
    model.save("noisy.zip")
    loaded = load_policy("noisy.zip", 3, 0, action_size=1)
    seen = OBSERVATIONS[:, :3]
    for deterministic in (True, False):
        found = 2.0 * loaded.policy.predict(seen, deterministic=deterministic)[0]
        np.testing.assert_allclose(found, model.predict(seen, deterministic=True)[0], atol=2e-5)
    assert np.std(found) > 0.1


def test_older_names_of_spaces_are_read(tmp_path):
    """`shape` for `_shape` and no `start`, as Gym before 0.22 had them."""
    model = sb3.DQN("MlpPolicy", "CartPole-v1", policy_kwargs={"net_arch": [8]}, device="cpu")
    buffer = io.BytesIO()
    model.save(buffer)
    with zipfile.ZipFile(buffer) as archive, zipfile.ZipFile("old.zip", "w") as old:
        for name in archive.namelist():
            content = archive.read(name)
            if name == "data":
                data = json.loads(content)
                for space in (data["observation_space"], data["action_space"]):
                    space["shape"] = space.pop("_shape")
                    space[":type:"] = space[":type:"].replace("gymnasium", "gym")
                data["action_space"].pop("start")
                content = json.dumps(data)
            old.writestr(name, content)
    found = load_policy("old.zip", 4, 2).policy.predict(OBSERVATIONS)[0]
    np.testing.assert_array_equal(found, model.predict(OBSERVATIONS, deterministic=True)[0])
