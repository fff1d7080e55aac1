"""Exported policies choose what the policy itself chooses, in onnxruntime and in PyTorch."""

import dataclasses
import json

import jax
import numpy as np
import pytest
import safetensors
import safetensors.numpy

pytest.importorskip("onnx", reason="extra `onnx` is not installed")
pytest.importorskip("onnxruntime", reason="extra `onnx` is not installed")
pytest.importorskip("torch", reason="extra `torch` is not installed")

import onnx
import onnxruntime
import torch

import socialiq
from socialiq.audit.request import SHIPPED_DIAL
from socialiq.cli.main import main
from socialiq.evaluation.episodes import episodes_of
from socialiq.nn.actor import Actor
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.ensemble import EnsemblePolicy
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.unlikeness import Unlikeness
from socialiq.nn.view import CHOICES
from socialiq.policies.export import as_torch_module, state_dict, to_onnx, to_safetensors
from socialiq.policies.front_end import FrontEndPolicy
from socialiq.policies.load import load_policy
from socialiq.storage import packaged_results
from socialiq.worlds import grammar
from socialiq.worlds.highway.perception import FrontEnd
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.world import Intersection

DECISIONS = 10_000


@pytest.fixture(scope="module")
def intersection():
    """Observations of the atlas' egoist: 10,000 of real episodes."""
    batch, seen = Intersection().batch(128), []

    class Watched:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            seen.append(np.array(observation))
            return policy.predict(observation, state, episode_start, deterministic)

    policy = atlas.load("set_egoistic")
    for first in range(0, 100_000, 1_000):
        episodes_of(batch, Watched(), np.arange(first, first + 256))
        if sum(map(len, seen)) >= DECISIONS:
            break
    return np.concatenate(seen)[:DECISIONS]


@pytest.fixture(scope="module")
def grid(table7):
    """Every state of the 7x7 world at some times, cut or repeated to 10,000."""
    seen = table7.observe(np.arange(table7.mdp.n_states), np.zeros(table7.mdp.n_states, int))
    return np.resize(seen, (DECISIONS, seen.shape[1])).astype(np.float32)


def network(
    n_features, view="flat", one_hot=(), activation="relu", hidden=(32, 16), seed=0, n_actions=3
):
    made = QNetwork.initialise(
        jax.random.key(seed), n_features, hidden, n_actions, activation, view, one_hot
    )
    return QPolicy.of(made, 0.5, {"learner": "none", "numbers": {"angle": 45.0}})


def in_onnxruntime(content, observations):
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    return session.run(["q_values", "actions"], {"observation": observations})


def tolerance(values):
    """Tolerance of float32 sums in another order."""
    return 1e-5 * max(1.0, np.abs(values).max())


def gaps(values):
    """Distance of the best two values of each row."""
    top = np.sort(values, axis=1)
    return top[:, -1] - top[:, -2]


def assert_same(policy, observations, tmp_path):
    """Values are near and actions equal: in onnxruntime, through our own door, and in PyTorch."""
    assert len(observations) == DECISIONS
    expected, values = policy.predict(observations)[0], policy.q_values(observations)
    content = to_onnx(policy)
    path = tmp_path / "p.onnx"
    path.write_bytes(content)
    scores, actions = in_onnxruntime(content, observations)
    # No two values may be so near that rounding decides, or equality would be luck.
    assert gaps(values).min() > 2 * tolerance(values)
    np.testing.assert_allclose(scores, values, atol=tolerance(values), rtol=0)
    np.testing.assert_array_equal(actions, expected)
    through = load_policy(str(path), policy.n_features, policy.n_actions).policy
    np.testing.assert_array_equal(through.predict(observations)[0], expected)
    with torch.no_grad():
        told = as_torch_module(policy)(torch.from_numpy(observations)).numpy()
    np.testing.assert_allclose(told, values, atol=tolerance(values), rtol=0)
    np.testing.assert_array_equal(told.argmax(axis=1), expected)
    assert len(np.unique(expected)) > 1


def apart(policy, observations):
    """Observations at which no two values are near a tie, repeated to 10,000."""
    values = policy.q_values(observations)
    clear = observations[gaps(values) > 2 * tolerance(values)]
    assert len(clear) > 0.97 * len(observations)
    return np.resize(clear, (DECISIONS, observations.shape[1]))


@pytest.mark.parametrize("name", ["prosocial", "expert_egoistic", "set_egoistic", "set_altruistic"])
def test_policies_of_the_atlas(name, intersection, tmp_path):
    policy = atlas.load(name)
    assert_same(policy, apart(policy, intersection), tmp_path)


@pytest.mark.parametrize("view", list(CHOICES))
@pytest.mark.parametrize("activation", ["relu", "elu"])
def test_every_view(view, activation, intersection, tmp_path):
    policy = network(70, view, activation=activation)
    assert_same(policy, apart(policy, intersection), tmp_path)


@pytest.mark.parametrize(("view", "seed"), [("set", 3), ("flat_relative_scaled", 0)])
def test_views_of_the_route(view, seed, tmp_path):
    batch = socialiq.world("merge,observation=route").batch(40)
    batch.reset(seeds=0)
    rng = np.random.default_rng(1)
    observations = []
    for _ in range(10):
        observations.append(batch.observation)
        batch.step(rng.integers(batch.n_actions, size=batch.size))
    observations = np.concatenate(observations)
    policy = network(observations.shape[1], view, n_actions=batch.n_actions, seed=seed)
    assert_same(policy, apart(policy, observations), tmp_path)


@pytest.mark.parametrize("hidden", [(), (8,)])
def test_one_place_for_each_value(hidden, grid, table7, tmp_path):
    values = tuple((feature.low, feature.size) for feature in table7.world.observed)
    policy = network(grid.shape[1], one_hot=values, hidden=hidden)
    assert_same(policy, apart(policy, grid), tmp_path)
    beyond = np.array([[-9.0] * grid.shape[1], [0.5] * grid.shape[1]], np.float32)
    scores, _ = in_onnxruntime(to_onnx(policy), beyond)
    np.testing.assert_allclose(scores, policy.q_values(beyond), atol=1e-6)


def test_imported_activations_and_one_layer(tmp_path):
    seen = np.random.default_rng(0).normal(size=(DECISIONS, 6)).astype(np.float32)
    for policy in (network(6, hidden=()), network(6)):
        policy = QPolicy(policy.weights, policy.biases, "tanh", 1.0)
        assert_same(policy, apart(policy, seen), tmp_path)


def test_a_dial_at_an_angle(tmp_path):
    made = DialNetwork.initialise(jax.random.key(1), 70, (16,), 3, view="set")
    dial = DialPolicy.of(made, 1.0, 0.0, 90.0, {"learner": "dial"})
    dial.save(tmp_path / "dial.safetensors")
    out = tmp_path / "at.onnx"
    seen = np.random.default_rng(0).normal(size=(DECISIONS, 70)).astype(np.float32)
    command = ["export", str(tmp_path / "dial.safetensors"), "--format", "onnx"]
    assert main([*command, "--angle", "30", "--out", str(out)]) == 0
    policy = dial.at(30.0)
    clear = apart(policy, seen)
    assert_same(policy, clear, tmp_path)
    np.testing.assert_array_equal(
        in_onnxruntime(out.read_bytes(), clear)[1], policy.predict(clear)[0]
    )


@pytest.mark.parametrize("view", ["set", "flat_scaled"])
def test_a_dial_with_a_clock_and_pairs(view, intersection, tmp_path):
    made = DialNetwork.initialise(jax.random.key(1), 71, (16,), 3, view=view, times=20, pairs=True)
    policy = DialPolicy.of(made, 1.0, 0.0, 90.0, {"learner": "dial"}).at(30.0)
    time = np.random.default_rng(0).integers(21, size=len(intersection))
    seen = np.column_stack([intersection, time]).astype(np.float32)
    assert_same(policy, apart(policy, seen), tmp_path)


@pytest.mark.parametrize(("view", "times"), [("set", 20), ("set_scaled", 0), ("flat", 0)])
def test_an_actor_with_a_view(view, times, intersection):
    seen = intersection[:200]
    if times:
        seen = np.column_stack([seen, np.arange(200) % times]).astype(np.float32)
    shape = (jax.random.key(0), seen.shape[1], (32, 16), 1)
    policy = ActorPolicy.of(Actor.initialise(*shape, view=view, times=times), {})
    chosen = policy.predict(seen)[0]
    session = onnxruntime.InferenceSession(to_onnx(policy), providers=["CPUExecutionProvider"])
    (found,) = session.run(["actions"], {"observation": seen})
    np.testing.assert_allclose(found, chosen, atol=1e-5)
    with torch.no_grad():
        module = as_torch_module(policy)(torch.from_numpy(seen)).numpy()
    np.testing.assert_allclose(module, chosen, atol=1e-5)


def test_an_ensemble_of_unlike_networks(intersection, tmp_path):
    policy = EnsemblePolicy.of([atlas.load("set_egoistic"), atlas.load("expert_egoistic")])
    assert_same(policy, apart(policy, intersection), tmp_path)


def test_of_equal_values_the_first_is_taken_everywhere():
    policy = network(6)
    last = policy.weights[-1].copy()
    last[1:] = last[0]
    tied = QPolicy(
        (*policy.weights[:-1], last), (*policy.biases[:-1], np.zeros(3, np.float32)), "relu", 1.0
    )
    seen = np.random.default_rng(0).normal(size=(1_000, 6)).astype(np.float32)
    assert not gaps(tied.q_values(seen)).any()
    scores, actions = in_onnxruntime(to_onnx(tied), seen)
    assert not gaps(scores).any() and not actions.any() and not tied.predict(seen)[0].any()


def test_the_batch_is_free():
    content = to_onnx(network(70, "set"))
    seen = np.random.default_rng(0).normal(size=(7, 70)).astype(np.float32)
    whole, _ = in_onnxruntime(content, seen)
    single = np.concatenate([in_onnxruntime(content, one[None])[0] for one in seen])
    np.testing.assert_allclose(whole, single, atol=1e-6)


def test_the_file_tells_where_it_comes_from(tmp_path):
    out = tmp_path / "p.onnx"
    assert main(["export", "set_prosocial", "--format", "onnx", "--out", str(out)]) == 0
    model = onnx.load(str(out))
    told = {one.key: one.value for one in model.metadata_props}
    policy = atlas.load("set_prosocial")
    assert told["socialiq.policy_sha256"] == policy.sha256
    assert json.loads(told["socialiq.provenance"]) == dict(policy.provenance)
    assert [one.name for one in model.graph.output] == ["q_values", "actions"]
    # One set of weights, however many vehicles there are.
    assert [one.name for one in model.graph.initializer if one.name.startswith("encoder")] == [
        "encoder_0.weight",
        "encoder_0.bias",
        "encoder_1.weight",
        "encoder_1.bias",
    ]


def test_torch_modules_train_and_their_weights_are_the_files(tmp_path):
    policy = network(70, "set")
    module = as_torch_module(policy)
    named = {name: tensor.numpy() for name, tensor in module.state_dict().items()}
    assert {k: v.tolist() for k, v in named.items()} == {
        k: v.tolist() for k, v in state_dict(policy).items()
    }
    path = tmp_path / "weights.safetensors"
    path.write_bytes(to_safetensors(policy))
    module.load_state_dict(
        {k: torch.from_numpy(v) for k, v in safetensors.numpy.load_file(path).items()}
    )
    with safetensors.safe_open(path, framework="numpy") as file:
        about = json.loads(file.metadata()["policy"])
    assert about["provenance"]["numbers"] == {"angle": 45.0} and about["view"]["pooled"]
    seen = torch.ones(4, 70)
    module(seen).sum().backward()
    assert all(one.grad is not None for one in module.parameters())
    module.layers[0].weight.data += 1.0
    assert policy.weights[0].max() < 1.0  # copies


def test_exported_weights_are_no_policy_file(tmp_path, capsys):
    out = tmp_path / "weights.safetensors"
    assert main(["export", "prosocial", "--format", "torch", "--out", str(out)]) == 0
    assert main(["evaluate", str(out)]) == 2
    assert "not a socialiq file" in capsys.readouterr().err


def test_unlikeness_in_the_graph_is_that_of_python(intersection, tmp_path):
    """On 10,000 rows, of which those of the usual rate and more raise an alarm."""
    dial = DialPolicy.load(packaged_results() / SHIPPED_DIAL).at(45.0)
    seen = np.column_stack([intersection, np.arange(DECISIONS) % 13]).astype(np.float32)
    score = Unlikeness.fit(dial.features(seen[:3000]), dial.features(seen[3000:6000]))
    policy = dataclasses.replace(dial, unlikeness=score)
    path = tmp_path / "scored.onnx"
    path.write_bytes(to_onnx(policy))
    session = onnxruntime.InferenceSession(path.read_bytes(), providers=["CPUExecutionProvider"])
    actions, unlikeness = session.run(["actions", "unlikeness"], {"observation": seen})
    np.testing.assert_allclose(unlikeness[:, 0], score(dial.features(seen)), rtol=1e-4)
    alarms = policy.alarm()(seen)
    assert np.mean((unlikeness[:, 0] > 1.0) == alarms) > 0.9995
    assert 0.005 < alarms.mean() < 0.1
    np.testing.assert_array_equal(actions, dial.predict(seen)[0])
    through = load_policy(str(path), 71, 3).policy
    np.testing.assert_array_equal(through.predict(seen)[0], actions)
    sensed = onnx.load_from_string(to_onnx(policy, FrontEnd(latency=1)))
    names = ["q_values", "actions", "unlikeness", "memory_after"]
    assert [output.name for output in sensed.graph.output] == names


@pytest.mark.parametrize("text", ["latency=1,track=3,noise=1", "latency=2", "noise=3", "track=3"])
def test_a_front_end_in_the_graph_chooses_and_remembers_as_in_python(text, tmp_path, capsys):
    """On 10,000 rows of late, noisy episodes with unseen vehicles, from the graph's own memory."""
    dial, path = packaged_results() / SHIPPED_DIAL, tmp_path / "sensed.onnx"
    words = ["--angle", "45", "--format", "onnx", "--front-end", text, "--out", str(path)]
    assert main(["export", str(dial), *words]) == 0
    session = onnxruntime.InferenceSession(path.read_bytes(), providers=["CPUExecutionProvider"])
    front_end = FrontEnd.of(text)
    policy = FrontEndPolicy(DialPolicy.load(dial).at(45.0), front_end, 71)
    batch, rows, started = Intersection().shifted("late,unseen=.3,noise=1").batch(500), 0, None
    batch.reset(0)
    state, memory = None, front_end.memory(500, 70)
    while rows < DECISIONS:
        sensed = np.column_stack([batch.observation, batch.time])
        expected, state = policy.predict(sensed, state, started)
        memory = memory if started is None else np.where(started[:, None], 0, memory)
        inputs = {"sensed": sensed, "memory": memory.astype(np.float32)}
        actions, memory = session.run(["actions", "memory_after"], inputs)
        np.testing.assert_array_equal(actions, expected)
        np.testing.assert_allclose(memory, state, atol=1e-5)
        started, rows = batch.step(expected).ending != 0, rows + len(actions)


@pytest.mark.parametrize(
    ("road", "squash"),
    [
        ("intersection,control=continuous", "tanh"),
        ("intersection,control=steering", "clip"),
        ("merge,control=continuous", "tanh"),
        ("roundabout,control=steering", "tanh"),
        ("road,seed=3,control=steering", "clip"),
    ],
)
@pytest.mark.parametrize("text", ["latency=2,track=3,noise=1", "latency=1", "track=3"])
def test_a_front_end_of_continuous_actions_is_in_the_graph(road, squash, text, tmp_path, capsys):
    """Actions and memories of random episodes are those of Python, from the graph's own memory."""
    world = grammar.build(f"{road},late,unseen=.3,noise=1")
    shape = (jax.random.key(0), world.n_features + 1, (16,), world.action_size)
    policy = ActorPolicy.of(Actor.initialise(*shape), {})
    policy = dataclasses.replace(policy, squash=squash)
    policy.save(tmp_path / "actor.safetensors")
    path = tmp_path / "sensed.onnx"
    words = ["--format", "onnx", "--front-end", text, "--world", road, "--out", str(path)]
    assert main(["export", str(tmp_path / "actor.safetensors"), *words]) == 0
    session = onnxruntime.InferenceSession(path.read_bytes(), providers=["CPUExecutionProvider"])
    front_end = dataclasses.replace(FrontEnd.of(text), ego=grammar.build(road).ego)
    behind = FrontEndPolicy(policy, front_end, world.n_features + 1)
    batch = world.batch(100)
    batch.reset(0)
    rng = np.random.default_rng(0)
    state = None
    started = None
    memory = front_end.memory(100, world.n_features)
    for _ in range(25):
        sensed = np.column_stack([batch.observation, batch.time])
        expected, state = behind.predict(sensed, state, started)
        memory = memory if started is None else np.where(started[:, None], 0, memory)
        inputs = {"sensed": sensed, "memory": memory.astype(np.float32)}
        actions, memory = session.run(["actions", "memory_after"], inputs)
        np.testing.assert_allclose(actions, expected, atol=1e-5)
        np.testing.assert_allclose(memory, state, atol=1e-5)
        driven = rng.uniform(-1.0, 1.0, expected.shape).astype(np.float32)
        started = batch.step(driven).ending != 0
    assert expected.std(axis=0).min() > 1e-3


def test_a_front_end_of_a_road_with_actions_of_another_kind_is_refused(tmp_path, capsys):
    shape = (jax.random.key(0), 70, (4,), 1)
    actor = tmp_path / "actor.safetensors"
    ActorPolicy.of(Actor.initialise(*shape), {}).save(actor)
    words = ["--format", "onnx", "--front-end", "latency=1", "--out", str(tmp_path / "p.onnx")]
    assert main(["export", str(actor), *words]) == 2
    said = "the policy has continuous actions, the front end's road 3 actions"
    assert said in capsys.readouterr().err
    words += ["--world", "intersection,control=continuous"]
    assert main(["export", "prosocial", *words]) == 2
    said = "the policy has 3 actions, the front end's road continuous actions"
    assert said in capsys.readouterr().err
    assert not (tmp_path / "p.onnx").exists()
