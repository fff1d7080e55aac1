"""The public names take what a user passes, or say in one line what they take."""

import contextlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import socialiq

OFFLINE = {"updates": 2, "hidden": (4,), "batch_size": 4, "online": False}


@pytest.fixture(autouse=True)
def as_a_user(as_a_user_runs_it, monkeypatch, tmp_path):
    """The tests' own checker of types would refuse wrong ones before the library does."""
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


def test_demonstrations_and_rollouts_print_one_line(data):
    assert re.fullmatch(r"Demonstrations\(6 episodes, \d+ transitions \(.*\)\)", repr(data))
    waits = socialiq.QPolicy((np.zeros((3, 6), np.float32),), (np.eye(3)[0],), "relu", 1.0)
    driven = socialiq.rollout_env(socialiq.make_environment("crossing7"), waits, 50, seed=0)
    assert repr(driven) == f"Rollout({driven.transitions!r})" and "\n" not in repr(driven)


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


WORLD, NUMBERS = socialiq.make("crossing5"), socialiq.Hyperparameters()
STATIC, PAIR = socialiq.StaticConfig(**OFFLINE, value_term="v0"), socialiq.RewardPair(1.0, 2.0)


@pytest.mark.parametrize(
    ("name", "arguments", "says"),
    [
        ("rollout_env", ("crossing5", None, 2, 0), "env is of the type str: pass Env"),
        ("rollout_env", (gymnasium.make("CartPole-v1"), "q.zip", 2, 0), "policy is of the type"),
        ("score", (45.0, PAIR), "weights is of the type float: pass RewardPair"),
        ("weights", ("45",), "angle is of the type str: pass float"),
        pytest.param(
            "to_onnx",
            ("q.safetensors",),
            "policy is of the type str: pass QPolicy or",
            marks=pytest.mark.slow,  # it needs an extra, which `make test` lacks
        ),
        ("action_table", ("q.safetensors", WORLD, "greedy"), "policy is of the type str"),
        ("evaluate_exactly", (WORLD, np.eye(3)), "table is of the type GridWorld: pass Table"),
        ("acting_in", ("crossing5", STATIC, [NUMBERS], 20), "make is of the type str"),
        ("acting_in", (WORLD, STATIC, NUMBERS, 20), "make is of the type GridWorld"),
        ("expert_datasets", (WORLD, 0, 1), "table is of the type GridWorld"),
        ("equal_trajectories", ([1], 1, 0), "pools is of the type list: pass Mapping"),
        ("make_environment", (WORLD,), "name is of the type GridWorld: pass str"),
        ("save_demonstrations", ("x.safetensors", "data"), "demonstrations is of the type str"),
        ("train", (NUMBERS, STATIC, []), "learner is of the type IQLearnHyperparameters"),
        ("train_dial", ("settings", NUMBERS), "static is of the type str: pass DialConfig"),
        ("estimate_angle", (np.ones(2), np.ones(1), 0), "give as many of each"),
        ("StaticConfig", (), "--set updates can't be '5'"),
        ("make", ("crossing7",), "spawn_probability of crossing7 is a text, '0.3'"),
    ],
)
def test_an_argument_of_a_wrong_type_is_one_line(name, arguments, says):
    named = {"StaticConfig": {"updates": "5"}, "make": {"spawn_probability": "0.3"}}.get(name, {})
    with pytest.raises(socialiq.UserError) as caught:
        getattr(socialiq, name)(*arguments, **named)
    assert says in str(caught.value) and "\n" not in str(caught.value)


LAYER = ((np.zeros((3, 8), np.float32),), (np.zeros(3, np.float32),), "relu", 1.0)
VALUES, MARGIN = socialiq.QPolicy(*LAYER), socialiq.Margin(1.0)
DIAL = socialiq.DialPolicy(VALUES, 0.0, 90.0)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda _: socialiq.Optimum("crossing5"), "Optimum: table is of the type str: pass Table"),
        (lambda _: socialiq.Margin("1"), "Margin: regret is of the type str: pass float"),
        (lambda _: socialiq.Callbacks("print"), "Callbacks: on_report is of the type str: pass"),
        (lambda _: socialiq.DialPolicy(VALUES, "0", 90.0), "DialPolicy: low is of the type str"),
        (lambda _: DIAL.at("45"), "DialPolicy.at: angle is of the type str: pass float"),
        (lambda _: DIAL.at(None), "DialPolicy.at: angle is of the type NoneType: pass float"),
        (lambda _: DIAL.at(float("nan")), "angle nan is outside this dial's range"),
        (lambda _: DIAL.q_values_at("a", "b"), "DialPolicy.q_values_at: observations is of the"),
        (lambda _: VALUES.q_values("a"), "QPolicy.q_values: observations is of the type str"),
        (lambda data: data.subsample("2"), "Demonstrations.subsample: every is of the type str"),
        (lambda data: data.select(3), "Demonstrations.select: episodes is of the type int"),
        (lambda data: data.one_of_each_block(2, "0"), "seed is of the type str: pass int"),
        (lambda data: data.with_mode_names(3), "mode_names is of the type int: pass tuple"),
        (lambda _: PAIR.of_step(1.0, None), "RewardPair.of_step: info is of the type NoneType"),
    ],
)
def test_constructors_and_methods_refuse_a_wrong_type_in_one_line(call, says, data):
    with pytest.raises(socialiq.UserError) as caught:
        call(data)
    assert says in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "name", [n for n in socialiq.__all__ if isinstance(getattr(socialiq, n), type)]
)
def test_no_public_method_ends_in_an_error_of_pythons_own(name, data):
    samples = {"DialPolicy": DIAL, "QPolicy": VALUES, "Demonstrations": data, "RewardPair": PAIR}
    samples |= {"Hyperparameters": NUMBERS, "StaticConfig": STATIC, "Margin": MARGIN}
    sample = samples.get(name, getattr(socialiq, name))
    for method in (m for m in dir(sample) if not m.startswith("_") and m not in ("of", "save")):
        function = getattr(sample, method)
        if inspect.ismethod(function) and "socialiq" in function.__module__:
            given = inspect.signature(function).parameters.values()
            positional = inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD
            needed = [p for p in given if p.default is p.empty and p.kind in positional]
            with contextlib.suppress(socialiq.UserError):
                function(*[object()] * len(needed))


def test_a_wrong_number_of_arguments_is_pythons_own_error():
    with pytest.raises(TypeError, match="missing 1 required positional argument"):
        socialiq.weights()


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
