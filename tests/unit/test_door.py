"""The public names take what a user passes, or say in one line what they take."""

import re
import subprocess
import sys
from pathlib import Path

import gymnasium
import jaxtyping
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import socialiq

OFFLINE = {"updates": 2, "hidden": (4,), "batch_size": 4, "online": False}


@pytest.fixture(autouse=True)
def as_a_user(monkeypatch, tmp_path):
    """The tests' own checker of types would refuse wrong ones before the library does."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    monkeypatch.chdir(tmp_path)


@pytest.fixture(name="data", scope="module")
def some_data():
    table = socialiq.tabulate(socialiq.make("crossing7"))
    return socialiq.expert_datasets(table, seeds=[0], episodes_each=2)[0]


def test_paths_may_be_text(data):
    socialiq.save_demonstrations("d.safetensors", data)
    assert socialiq.load_demonstrations("d.safetensors").n_transitions == data.n_transitions
    weights, biases = (np.zeros((3, 6), np.float32),), (np.zeros(3, np.float32),)
    socialiq.QPolicy(weights, biases, "relu", 1.0).save("q.safetensors")
    assert socialiq.QPolicy.load("q.safetensors").n_features == 6
    assert socialiq.load_policy(Path("q.safetensors"), 6, 3).policy.n_actions == 3
    for load in (socialiq.load_demonstrations, socialiq.QPolicy.load, socialiq.read_arrays):
        for wrong in (3, None, ["d.safetensors"]):
            with pytest.raises(socialiq.UserError, match="is no path: give a text or a pathlib"):
                load(wrong)


def test_one_run_and_one_set_may_stand_alone(data):
    static = socialiq.StaticConfig(value_term="value_expert", prior="none", **OFFLINE)
    numbers = socialiq.Hyperparameters(angle=45.0)
    alone = socialiq.train(static, numbers, data)
    listed = socialiq.train(static, [numbers], [data])
    assert alone.policy(0).weights[0].tobytes() == listed.policy(0).weights[0].tobytes()
    assert repr(alone) == "Trained(iq_learn: 1 runs of 2 updates, failures=())"


def test_a_name_or_an_environment_in_the_place_of_a_world_is_one_line(data):
    static, numbers = socialiq.StaticConfig(), [socialiq.Hyperparameters()]
    for world in ("crossing7", gymnasium.make("CartPole-v1"), socialiq.make("intersection")):
        with pytest.raises(socialiq.UserError, match=r"pass Demonstrations, a gridworld by make"):
            socialiq.train(static, numbers, [data], world)
    with pytest.raises(socialiq.UserError, match="datasets has a str"):
        socialiq.train(static, numbers, ["d.safetensors"])
    for world in ("crossing7", gymnasium.make("CartPole-v1"), socialiq.make("intersection")):
        with pytest.raises(socialiq.UserError, match="is no gridworld: make one by make"):
            socialiq.tabulate(world)
    for world in ("CartPole-v1", socialiq.make("crossing7"), None):
        with pytest.raises(socialiq.UserError, match=r"is no gymnasium\.Env"):
            socialiq.RewardPairWrapper(world, lambda step: (step.reward, 0.0))


@pytest.mark.parametrize("name", ["crossing7", "Pendulum-v1", "CartPole-v1"])
@pytest.mark.filterwarnings("ignore")
def test_made_environments_pass_gymnasiums_check(name):
    check_env(socialiq.make_environment(name, continuous=True), skip_render_check=True)


@pytest.mark.filterwarnings("ignore")
def test_the_wrapper_passes_gymnasiums_check():
    pole = gymnasium.make("CartPole-v1")
    wrapped = socialiq.RewardPairWrapper(pole, lambda step: (step.reward, 0.0))
    check_env(wrapped, skip_render_check=True)


def test_dir_has_the_public_names_alone():
    text = "import socialiq; print(dir(socialiq) == sorted(socialiq.__all__))"
    found = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert found.stdout == "True\n"
    assert Path(socialiq.__file__).is_file()


@pytest.mark.parametrize("page", ["README.md", "docs/api.md"])
def test_the_pages_name_the_registered_ids(page):
    text = (Path(__file__).parents[2] / page).read_text()
    registered = {name for name in gymnasium.registry if name.startswith("socialiq/")}
    assert {*re.findall(r"`(socialiq/\w+-v\d)`", text)} == registered
