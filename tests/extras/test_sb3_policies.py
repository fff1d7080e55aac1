"""Stable-Baselines3's own zips, read without it, act as it does."""

import runpy
from pathlib import Path

import gymnasium
import numpy as np
import pytest

pytest.importorskip("torch", reason="extra `sb3` is not installed")
pytest.importorskip("stable_baselines3", reason="extra `sb3` is not installed")

import stable_baselines3 as sb3
import torch
from stable_baselines3.common.torch_layers import FlattenExtractor

from socialiq.errors import UserError
from socialiq.evaluation.simulate import SoftPolicy
from socialiq.policies.load import load_policy

EXAMPLES = Path(__file__).parents[2] / "examples" / "policies"
DECISIONS = 10_000


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


class World(gymnasium.Env):
    """Random rows of three numbers, four actions."""

    observation_space = gymnasium.spaces.Box(-5.0, 5.0, (2, 3), np.float32)
    action_space = gymnasium.spaces.Discrete(4)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.np_random.random((2, 3), np.float32), {}

    def step(self, action):
        return self.np_random.random((2, 3), np.float32), float(action), False, False, {}


def saved(path, algorithm, space=None, **options):
    world = World()
    world.observation_space = space or World.observation_space
    kwargs = {"policy_kwargs": options} if options else {}
    model = getattr(sb3, algorithm)("MlpPolicy", world, seed=0, device="cpu", **kwargs)
    # Away from the biases of zero that it begins with.
    with torch.no_grad():
        for parameter in model.policy.parameters():
            parameter.add_(0.3 * torch.randn_like(parameter))
    model.save(path)
    return model


def assert_same(model, policy, shape):
    observations = np.random.default_rng(0).normal(size=(DECISIONS, *shape)).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    found, _ = policy.predict(observations.reshape(DECISIONS, -1))
    np.testing.assert_array_equal(found, expected)
    assert len(np.unique(found)) > 1


@pytest.mark.parametrize("algorithm", ["DQN", "PPO", "A2C"])
@pytest.mark.parametrize("activation", [None, "ReLU", "Tanh", "ELU"])
@pytest.mark.parametrize("sizes", [[8], [16, 8, 4]])
def test_actions_are_stable_baselines_own(tmp_path, algorithm, activation, sizes):
    options = {"activation_fn": getattr(torch.nn, activation)} if activation else {}
    model = saved(tmp_path / "p.zip", algorithm, net_arch=sizes, **options)
    assert_same(model, load_policy(str(tmp_path / "p.zip"), 6, 4).policy, (2, 3))


@pytest.mark.parametrize("algorithm", ["DQN", "PPO"])
def test_defaults_and_no_hidden_layer(tmp_path, algorithm):
    for options in ({}, {"net_arch": []}):
        model = saved(tmp_path / "p.zip", algorithm, **options)
        assert_same(model, load_policy(str(tmp_path / "p.zip"), 6, 4).policy, (2, 3))


def test_policy_and_value_layers_may_differ(tmp_path):
    model = saved(tmp_path / "p.zip", "A2C", net_arch={"pi": [5, 7], "vf": [3]})
    assert_same(model, load_policy(str(tmp_path / "p.zip"), 6, 4).policy, (2, 3))


def test_draws_have_the_probabilities_of_stable_baselines(tmp_path):
    model = saved(tmp_path / "p.zip", "PPO")
    policy = load_policy(str(tmp_path / "p.zip"), 6, 4).policy
    observations = np.random.default_rng(0).normal(size=(500, 6)).astype(np.float32)
    with torch.no_grad():
        tensor = torch.as_tensor(observations.reshape(-1, 2, 3))
        expected = model.policy.get_distribution(tensor).distribution.probs.numpy()
    assert isinstance(policy, SoftPolicy)
    np.testing.assert_allclose(policy.probabilities(observations), expected, atol=1e-5)


@pytest.mark.parametrize(
    ("space", "match"),
    [
        (gymnasium.spaces.Discrete(6), "not a Box of float32"),
        (gymnasium.spaces.MultiBinary(6), "not a Box of float32"),
        (gymnasium.spaces.Box(0, 255, (6,), np.uint8), "not a Box of float32"),
    ],
)
def test_other_observations_are_refused(tmp_path, space, match):
    saved(tmp_path / "p.zip", "DQN", space)
    with pytest.raises(UserError, match=match):
        load_policy(str(tmp_path / "p.zip"), 6, 4)


def test_other_extractors_and_activations_are_refused(tmp_path):
    saved(tmp_path / "p.zip", "DQN", activation_fn=torch.nn.GELU)
    with pytest.raises(UserError, match="its activation is"):
        load_policy(str(tmp_path / "p.zip"), 6, 4)

    class Extractor(FlattenExtractor):
        def forward(self, observations):
            return -super().forward(observations)

    saved(tmp_path / "p.zip", "DQN", features_extractor_class=Extractor)
    with pytest.raises(UserError, match="the unknown entry features_extractor_class"):
        load_policy(str(tmp_path / "p.zip"), 6, 4)


def test_files_of_other_torch_formats_are_refused(tmp_path):
    from socialiq.policies.sb3_tensors import read_state_dict

    tensors = {"w": torch.ones(3)}
    for number, saving in enumerate(
        (
            lambda path: torch.save(tensors, path, _use_new_zipfile_serialization=False),
            lambda path: torch.save(torch.nn.Linear(2, 2), path),
            lambda path: torch.save({"w": torch.ones(3, dtype=torch.float64)}, path),
            lambda path: torch.save({"w": torch.ones(2, 3).T}, path),
            lambda path: torch.save([1, 2], path),
        )
    ):
        path = tmp_path / f"{number}.pth"
        saving(path)
        with pytest.raises(UserError):
            read_state_dict(path.read_bytes(), "policy.pth")
    torch.save(tensors, tmp_path / "good.pth")
    assert list(read_state_dict((tmp_path / "good.pth").read_bytes(), "p")) == ["w"]


def test_example_is_what_stable_baselines_reads():
    path = EXAMPLES / "dqn_intersection.zip"
    assert path.stat().st_size < 300_000
    assert_same(sb3.DQN.load(path, device="cpu"), load_policy(str(path), 70, 3).policy, (10, 7))


def test_script_of_the_example_runs(tmp_path, monkeypatch):
    pytest.importorskip("highway_env", reason="extra `highway` is not installed")
    script = runpy.run_path(str(EXAMPLES / "train_dqn.py"))
    monkeypatch.setitem(script["main"].__globals__, "STEPS", 40)
    script["main"](str(tmp_path / "p.zip"))
    assert load_policy(str(tmp_path / "p.zip"), 70, 3).record.details["layers"] == [70, 64, 64, 3]
