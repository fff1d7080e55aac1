import json
import os
import re
import zipfile

import numpy as np
import pytest
from scipy.special import softmax

from socialiq.errors import UserError
from socialiq.nn.q_policy import QPolicy
from socialiq.policies.interface import Interface
from socialiq.policies.load import load_policy
from socialiq.policies.sb3_load import EpsilonGreedy, read_sb3

WORLD = Interface(6, 3)
BOX = {":type:": "<class 'gymnasium.spaces.box.Box'>", "dtype": "float32", "_shape": [2, 3]}
DISCRETE = {":type:": "<class 'gymnasium.spaces.discrete.Discrete'>", "n": "3", "start": "0"}
RANDOM = np.random.default_rng(0)
OBSERVATIONS = RANDOM.normal(size=(100, 6)).astype(np.float32)


def layer(name, inputs, outputs):
    return {
        f"{name}.weight": RANDOM.normal(size=(outputs, inputs)).astype(np.float32),
        f"{name}.bias": RANDOM.normal(size=outputs).astype(np.float32),
    }


DQN = layer("q_net.q_net.0", 6, 5) | layer("q_net.q_net.2", 5, 3)
DQN |= layer("q_net_target.q_net.0", 6, 5) | layer("q_net_target.q_net.2", 5, 3)
ACTOR = layer("mlp_extractor.policy_net.0", 6, 4) | layer("action_net", 4, 3)
ACTOR |= layer("mlp_extractor.value_net.0", 6, 4) | layer("value_net", 4, 1)


def words(kind="dqn", **other):
    return {
        "policy_class": {"__module__": f"stable_baselines3.{kind}.policies"},
        "policy_kwargs": {},
        "observation_space": BOX,
        "action_space": DISCRETE,
        "use_sde": False,
        **({"exploration_rate": 0.25} if kind == "dqn" else {}),
        **other,
    }


@pytest.fixture
def read(crafted):
    def made(said, arrays):
        members = {"data": json.dumps(said).encode(), "policy.pth": crafted.pth(arrays)}
        return read_sb3(crafted.zipped(members), "some.zip", WORLD)

    return made


@pytest.fixture
def refused(read):
    def check(match, said=None, arrays=None):
        with pytest.raises(UserError, match=match) as caught:
            read(words() if said is None else said, DQN if arrays is None else arrays)
        assert "\n" not in str(caught.value) and len(str(caught.value)) < 350

    return check


def scores(arrays, layers, activation):
    value = OBSERVATIONS
    for number, name in enumerate(layers):
        value = activation(value) if number else value
        value = value @ arrays[f"{name}.weight"].T + arrays[f"{name}.bias"]
    return value


def test_dqn_takes_the_best_action_of_its_network(read):
    policy, details = read(words(), DQN)
    expected = scores(DQN, ("q_net.q_net.0", "q_net.q_net.2"), lambda x: np.maximum(x, 0))
    assert isinstance(policy, EpsilonGreedy)
    np.testing.assert_array_equal(policy.predict(OBSERVATIONS)[0], expected.argmax(axis=1))
    assert policy.predict(OBSERVATIONS[0])[0] == expected[0].argmax()
    assert details["layers"] == [6, 5, 3] and details["epsilon"] == 0.25


def test_dqn_explores_with_the_rate_that_it_was_saved_with(read):
    policy, _ = read(words(), DQN)
    chances = policy.probabilities(OBSERVATIONS)
    best, _ = policy.predict(OBSERVATIONS)
    np.testing.assert_allclose(chances.sum(axis=1), 1.0)
    np.testing.assert_allclose(chances[np.arange(100), best], 0.75 + 0.25 / 3)
    many, _ = policy.predict(np.repeat(OBSERVATIONS[:1], 20_000, axis=0), deterministic=False)
    np.testing.assert_allclose(np.bincount(many, minlength=3) / 20_000, chances[0], atol=0.02)


def test_actor_critic_draws_from_the_softmax_of_its_outputs(read):
    policy, details = read(words("common"), ACTOR)
    expected = scores(ACTOR, ("mlp_extractor.policy_net.0", "action_net"), np.tanh)
    assert isinstance(policy, QPolicy)
    np.testing.assert_array_equal(policy.predict(OBSERVATIONS)[0], expected.argmax(axis=1))
    np.testing.assert_allclose(
        policy.probabilities(OBSERVATIONS), softmax(expected, axis=1), atol=1e-5
    )
    assert details["algorithm"] == "actor-critic"


@pytest.mark.parametrize(("name", "known"), [("ReLU", "relu"), ("Tanh", "tanh"), ("ELU", "elu")])
def test_activation_is_the_one_that_the_file_names(read, name, known):
    said = words(policy_kwargs={"activation_fn": f"<class 'torch.nn.modules.activation.{name}'>"})
    assert read(said, DQN)[1]["activation"] == known


def test_what_is_not_certain_is_refused(refused):
    def options(**kwargs):
        return words(policy_kwargs=kwargs)

    refused("its activation is", options(activation_fn="<class 'mine.ReLU'>"))
    refused("its activation is", options(activation_fn=None))
    refused("the unknown entry features_extractor_class", options(features_extractor_class="mine"))
    refused("the unknown entry strange", options(strange=1))
    refused("no policy_kwargs", words(policy_kwargs="{}"))
    refused("gSDE", words(use_sde=True))
    refused("policy class is of mine", words(policy_class={"__module__": "mine"}))
    refused("policy class is of None", words(policy_class="stable_baselines3.dqn.policies"))
    refused("policy class is of", words(policy_class={"__module__": ["unhashable"]}))


def test_spaces_that_a_perceptron_does_not_read_as_they_are_are_refused(refused):
    for other in ({"dtype": "uint8"}, {":type:": "<class 'gymnasium.spaces.dict.Dict'>"}):
        refused("not a Box of float32", words(observation_space=BOX | other))
    for shape in (None, "6", [0, 6], [-2, -3], [True, 6], [2.0, 3]):
        refused("have no shape", words(observation_space=BOX | {"_shape": shape}))
    refused("not Discrete from 0", words(action_space=DISCRETE | {"start": "1"}))
    refused("not Discrete from 0", words(action_space=BOX))
    for count in ("many", "²", "-3", "9" * 5_000, None):
        refused("have no number", words(action_space=DISCRETE | {"n": count}))


def test_exploration_rate_must_be_a_share(refused):
    for rate in (1.5, -0.1, float("nan"), "0", True, None):
        refused("exploration_rate is not a share", words(exploration_rate=rate))


def test_policy_of_another_world_is_refused(refused):
    refused("takes 7 features and 3 actions", words(observation_space=BOX | {"_shape": [7]}))
    refused("takes 6 features and 4 actions", words(action_space=DISCRETE | {"n": "4"}))
    huge = BOX | {"_shape": [10**9, 10**9]}
    refused("features and 3 actions, the world has 6 and 3", words(observation_space=huge))


def test_tensors_must_be_those_of_a_perceptron(refused):
    def without(name):
        return {key: value for key, value in DQN.items() if key != name}

    refused(
        "holds the tensor features_extractor",
        arrays=DQN | {"features_extractor.0": RANDOM.random(3)},
    )
    refused("lacks the tensor q_net.q_net.0.bias", arrays=without("q_net.q_net.0.bias"))
    refused("holds the tensor|lacks the tensor", arrays=DQN | layer("q_net.q_net.3", 3, 3))
    refused("holds no layer", arrays=layer("q_net_target.q_net.0", 6, 3))
    refused("lacks the tensor action_net", words("common"), layer("value_net", 4, 1))
    refused("holds the tensor log_std", words("common"), ACTOR | {"log_std": np.zeros(3)})
    scripted = {"<script>alert(1)</script>": np.zeros(1)}
    refused("holds the tensor", arrays=DQN | scripted)


def test_sizes_must_follow_one_another(refused):
    refused("layer 1 of weights", arrays=DQN | layer("q_net.q_net.2", 4, 3))
    refused("layer 0 of weights", arrays=DQN | layer("q_net.q_net.0", 7, 5))
    refused("layer 0 of weights", arrays=DQN | {"q_net.q_net.0.bias": np.zeros(4)})
    refused("4 outputs for 3 actions", arrays=DQN | layer("q_net.q_net.2", 5, 4))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_weights_must_be_finite(refused, value):
    broken = DQN["q_net.q_net.2.weight"].copy()
    broken[1, 1] = value
    refused("NaN or infinity in layer 1", arrays=DQN | {"q_net.q_net.2.weight": broken})


@pytest.mark.parametrize("said", [b"", b"[]", b"\xff", b"[" * 100_000, b"{" * 10, b"9" * 10_000])
def test_data_that_is_no_json_object_is_refused(crafted, said):
    content = crafted.zipped({"data": said, "policy.pth": b""})
    with pytest.raises(UserError, match="its member data is not"):
        read_sb3(content, "some.zip", WORLD)


def test_pickles_in_the_words_are_never_decoded(read, monkeypatch):
    import base64

    monkeypatch.setattr(base64, "b64decode", lambda *_: pytest.fail("decoded"))
    bombs = {":serialized:": "gASVKAAAAAAAAACMBXBvc2l4lIwGc3lzdGVtlJOUjA10b3VjaCAvdG1wL3h4lIWUUpQu"}
    said = words(policy_kwargs=bombs, observation_space=BOX | bombs, lr_schedule=bombs)
    assert read(said, DQN)[1]["activation"] == "relu"


def test_other_members_are_never_opened(crafted):
    with zipfile.ZipFile(crafted.examples / "dqn_intersection.zip") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    for name in ("policy.optimizer.pth", "pytorch_variables.pth"):
        members[name] = b"cos\nsystem\n(X\x04\x00\x00\x00trueetR."
    policy, _ = read_sb3(crafted.zipped(members), "some.zip", Interface(70, 3))
    assert policy.predict(np.zeros(70, np.float32))[0] in (0, 1, 2)


def test_members_are_needed(crafted):
    with pytest.raises(UserError, match=r"has no member policy\.pth"):
        said = json.dumps(words()).encode()
        read_sb3(crafted.zipped({"data": said}), "some.zip", WORLD)


def test_names_of_older_spaces_are_read(read):
    """Gym before 0.22 wrote `shape`, and its discrete spaces had no start."""
    box = {":type:": "<class 'gym.spaces.box.Box'>", "dtype": "float32", "shape": [2, 3]}
    discrete = {":type:": "<class 'gym.spaces.discrete.Discrete'>", "n": 3, "shape": []}
    policy, _ = read(words(observation_space=box, action_space=discrete), DQN)
    expected, _ = read(words(), DQN)[0].predict(OBSERVATIONS)
    np.testing.assert_array_equal(policy.predict(OBSERVATIONS)[0], expected)


def test_shared_layers_come_first(read):
    shared = layer("mlp_extractor.shared_net.0", 6, 5) | layer("mlp_extractor.policy_net.0", 5, 4)
    arrays = shared | layer("action_net", 4, 3) | layer("value_net", 4, 1)
    policy, details = read(words("common"), arrays)
    value = np.tanh(
        OBSERVATIONS @ arrays["mlp_extractor.shared_net.0.weight"].T
        + arrays["mlp_extractor.shared_net.0.bias"]
    )
    value = np.tanh(
        value @ arrays["mlp_extractor.policy_net.0.weight"].T
        + arrays["mlp_extractor.policy_net.0.bias"]
    )
    value = value @ arrays["action_net.weight"].T + arrays["action_net.bias"]
    assert details["layers"] == [6, 5, 4, 3]
    np.testing.assert_array_equal(policy.predict(OBSERVATIONS)[0], value.argmax(axis=1))


def test_value_of_quantiles_is_their_mean(read):
    arrays = layer("quantile_net.quantile_net.0", 6, 5) | layer(
        "quantile_net.quantile_net.2", 5, 12
    )
    module = {"__module__": "sb3_contrib.qrdqn.policies"}
    policy, _ = read(words("dqn", policy_class=module), arrays)
    hidden = np.maximum(
        OBSERVATIONS @ arrays["quantile_net.quantile_net.0.weight"].T
        + arrays["quantile_net.quantile_net.0.bias"],
        0.0,
    )
    quantiles = hidden @ arrays["quantile_net.quantile_net.2.weight"].T
    quantiles = (quantiles + arrays["quantile_net.quantile_net.2.bias"]).reshape(-1, 4, 3)
    found, _ = policy.predict(OBSERVATIONS)
    np.testing.assert_array_equal(found, quantiles.mean(axis=1).argmax(axis=1))


@pytest.fixture
def with_statistics(crafted):
    def made(content, original=None):
        said = words("common", _last_original_obs=original)
        members = {"data": json.dumps(said).encode(), "policy.pth": crafted.pth(ACTOR)}
        if content is not None:
            members["vecnormalize.json"] = json.dumps(content).encode()
        return read_sb3(crafted.zipped(members), "some.zip", WORLD)

    return made


def test_policy_whose_statistics_are_elsewhere_is_refused(with_statistics, crafted):
    with pytest.raises(UserError, match=r"some\.zip was trained under VecNormalize, whose stat"):
        with_statistics(None, {":type:": "<class 'numpy.ndarray'>"})
    with_statistics({"norm_obs": False}, {":type:": "<class 'numpy.ndarray'>"})
    with_statistics(None)
    members = {"data": json.dumps(words()).encode(), "policy.pth": crafted.pth(DQN)}
    with pytest.raises(UserError, match=r"some\.zip lies beside vecnormalize\.pkl, whose stat"):
        read_sb3(crafted.zipped(members), "some.zip", WORLD, "vecnormalize.pkl")


PICKLE = b"\x80\x04\x95\x00\x8c.stable_baselines3.common.vec_env.vec_normalize\x94"
PLACES = {
    "dqn/Env_1/Env/vecnormalize.pkl": b"",
    "dqn/Env_1/vec_norm.pkl": b"",
    "dqn/vec_normalize.pkl": b"",
    "VecNormalize": b"",
    "dqn/Env_1/Env/statistics.pickle": PICKLE,
    "dqn/Env_1/kept/obs_rms.npz": b"",
}


@pytest.fixture
def in_the_zoo(tmp_path, crafted):
    """A zip that shows no normalisation, in the folders of the RL Zoo."""
    path = tmp_path / "dqn" / "Env_1" / "best_model.zip"
    path.parent.mkdir(parents=True)
    members = {"data": json.dumps(words()).encode(), "policy.pth": crafted.pth(DQN)}
    path.write_bytes(crafted.zipped(members))
    return path


def written(folder, name, content):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("place", PLACES)
def test_statistics_near_a_zip_refuse_it_until_it_has_its_own(in_the_zoo, tmp_path, place):
    assert load_policy(in_the_zoo, 6, 3).record.kind == "sb3"
    statistics = written(tmp_path, place, PLACES[place])
    relative = os.path.relpath(statistics, in_the_zoo.parent)
    with pytest.raises(UserError, match=f"lies beside {re.escape(relative)}, whose statistics"):
        load_policy(in_the_zoo, 6, 3)
    with zipfile.ZipFile(in_the_zoo, "a") as archive:
        archive.writestr("vecnormalize.json", '{"norm_obs": false}')
    assert load_policy(in_the_zoo, 6, 3).record.details["normalised"] is False


def test_statistics_are_found_from_the_folder_of_the_zip_and_through_a_link(
    in_the_zoo, tmp_path, monkeypatch
):
    written(tmp_path, "dqn/vecnormalize.pkl", b"")
    monkeypatch.chdir(in_the_zoo.parent)
    link = tmp_path / "elsewhere" / "a" / "b" / "policy.zip"
    link.parent.mkdir(parents=True)
    link.symlink_to(in_the_zoo)
    for path in (in_the_zoo.name, link):
        with pytest.raises(UserError, match=r"lies beside \.\./vecnormalize\.pkl"):
            load_policy(path, 6, 3)


def test_other_files_near_a_zip_are_not_statistics(in_the_zoo, tmp_path):
    for name, content in {
        "dqn/Env_1/replay_buffer.pkl": b"\x80\x04.",
        "dqn/Env_1/train_vecnormalize.py": b"",
        "dqn/Env_1/vecnormalize.zip": in_the_zoo.read_bytes(),
        "dqn/Env_2/vecnormalize.pkl": b"",
        "dqn/Env_1/Env/more/vecnormalize.pkl": b"",
    }.items():
        written(tmp_path, name, content)
    os.mkfifo(in_the_zoo.with_name("vecnormalize.pipe"))
    assert load_policy(in_the_zoo, 6, 3).record.kind == "sb3"
    assert load_policy(in_the_zoo.with_name("vecnormalize.zip"), 6, 3).record.kind == "sb3"


def test_search_for_statistics_is_bounded(in_the_zoo, tmp_path, monkeypatch):
    written(tmp_path, "dqn/Env_1/Env/vecnormalize.pkl", b"")
    with pytest.raises(UserError, match="lies beside"):
        load_policy(in_the_zoo, 6, 3)
    monkeypatch.setattr("socialiq.policies.sb3_load.MOST_FOLDERS", 0)
    assert load_policy(in_the_zoo, 6, 3).record.kind == "sb3"


def test_statistics_normalise_and_clip(with_statistics):
    mean, var = RANDOM.normal(size=6), RANDOM.random(6) + 0.1
    numbers = {"mean": mean.tolist(), "var": var.tolist(), "epsilon": 0.01, "clip_obs": 0.5}
    policy, details = with_statistics(numbers, {":type:": "<class 'numpy.ndarray'>"})
    plain, _ = with_statistics(None)
    scaled = np.clip((OBSERVATIONS - mean) / np.sqrt(var + 0.01), -0.5, 0.5)
    for found, expected in (
        (policy.predict(OBSERVATIONS)[0], plain.predict(scaled)[0]),
        (policy.predict(OBSERVATIONS[0])[0], plain.predict(scaled[0])[0]),
        (policy.probabilities(OBSERVATIONS), plain.probabilities(scaled)),
    ):
        np.testing.assert_array_equal(found, expected)
    assert details["normalised"] is True
    for bad in (OBSERVATIONS[:, :5], np.full((1, 6), np.nan)):
        with pytest.raises(UserError, match="observation"):
            policy.predict(bad)


@pytest.mark.parametrize(
    "numbers",
    [
        {},
        [],
        7,
        {"mean": [0.0] * 6},
        {"mean": [0.0] * 5, "var": [1.0] * 5},
        {"mean": [0.0] * 6, "var": [-1.0] * 6},
        {"mean": [0.0] * 6, "var": [0.0] * 6, "epsilon": 0.0},
        {"mean": [0.0] * 6, "var": [1.0] * 6, "clip_obs": 0.0},
        {"mean": [0.0] * 6, "var": [1.0] * 6, "clip_obs": "wide"},
        {"mean": [float("nan")] * 6, "var": [1.0] * 6},
        {"mean": [[0.0]] * 6, "var": [1.0] * 6},
        {"mean": "0", "var": "1"},
        {"norm_obs": True},
    ],
)
def test_numbers_that_are_no_statistics_are_refused(with_statistics, numbers):
    with pytest.raises(
        UserError, match=r"vecnormalize\.json is no object of mean and var, 6 finite"
    ):
        with_statistics(numbers)


def test_statistics_that_are_no_json_are_refused(crafted):
    members = {"data": json.dumps(words()).encode(), "policy.pth": crafted.pth(DQN)}
    for content in (b"", b"\x80\x04.", b"[" * 100_000):
        archive = crafted.zipped(members | {"vecnormalize.json": content})
        with pytest.raises(UserError, match="is no object of mean and var"):
            read_sb3(archive, "some.zip", WORLD)
