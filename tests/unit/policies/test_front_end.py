"""A policy behind a front end, without ONNX: as the world shows it, from its own memory."""

import numpy as np
import pytest

from socialiq import UserError
from socialiq.policies.front_end import FrontEndPolicy, Node, Nodes
from socialiq.worlds import grammar
from socialiq.worlds.highway.perception import FrontEnd
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.world import Intersection

FRONT_END = FrontEnd(latency=1, track=3, noise=1.0)


class Eager:
    """Graph that computes each node at once, in NumPy, as ONNX defines its operators."""

    def __init__(self, **inputs):
        self.values, self.nodes = dict(inputs), []

    def constant(self, name, array):
        self.values[name] = array
        return name

    def add(self, operator, inputs, name, *further, **attributes):
        self.nodes.append(name)
        given = [self.values[word] for word in inputs]
        made = getattr(self, f"of_{operator.lower()}", None) or OPERATORS[operator]
        made = made(*given, **attributes)
        for word, value in zip((name, *further), made if further else [made], strict=True):
            assert value.dtype in (np.float32, np.int64, bool)
            self.values[word] = value
        return name

    def of_topk(self, keys, count, largest):
        order = np.argsort(keys, axis=-1, kind="stable")[:, : int(count[0])]
        return np.take_along_axis(keys, order, -1), order


def sliced(array, first, last, axis):
    return array.take(np.arange(first[0], min(last[0], array.shape[axis[0]])), axis=axis[0])


OPERATORS = {
    "Add": np.add,
    "Sub": np.subtract,
    "Mul": np.multiply,
    "Div": np.divide,
    "Slice": sliced,
    "Concat": lambda *arrays, axis: np.concatenate(arrays, axis=axis),
    "Reshape": lambda array, shape: array.reshape(shape),
    "ReduceMin": lambda array, axes, keepdims: array.min(axis=tuple(axes), keepdims=True),
    "ReduceSum": lambda array, axes, keepdims: array.sum(axis=tuple(axes), keepdims=True),
    "Transpose": lambda array, perm: array.transpose(perm),
    "MatMul": np.matmul,
    "LessOrEqual": np.less_equal,
    "Cast": lambda array, to: array.astype(np.float32),
    "Clip": lambda array, low, high: array.clip(low, high),
    "Round": np.round,
    "Sqrt": np.sqrt,
    "Unsqueeze": lambda array, axis: np.expand_dims(array, tuple(axis)),
    "Shape": lambda array, start, end: np.array(array.shape[start:end]),
    "Tile": np.tile,
    "GatherElements": lambda array, order, axis: np.take_along_axis(array, order, axis),
}


@pytest.mark.parametrize(
    "name",
    [
        "intersection",
        "merge",
        "roundabout",
        "two_way",
        "road,seed=3",
        "intersection,control=continuous",
        "merge,control=steering",
    ],
)
def test_its_graph_computes_the_same_on_every_road(name):
    world = grammar.build(f"{name},late,unseen=.3,noise=1,front_end=known")
    front, features = world.front_end, world.n_features
    bare = grammar.build(f"{name},late,unseen=.3,noise=1").batch(20)
    bare.reset(0)
    memory = front.memory(20, features)
    for _ in range(4):
        shown = np.column_stack([bare.observation, bare.time])
        graph = Eager(sensed=shown, memory=memory)
        xp = Nodes(graph)
        ends = front.see(Node(graph, "sensed"), Node(graph, "memory"), features, xp=xp)
        estimate, memory = front.see(shown, memory, features)
        for node, array in zip(ends, (estimate, memory), strict=True):
            np.testing.assert_allclose(graph.values[node.name], array, atol=1e-6)
        if world.action_size:
            actions = np.linspace(-1.0, 1.0, 20 * world.action_size, dtype=np.float32)
            actions = actions.reshape(20, -1)
        else:
            actions = np.arange(20) % world.n_actions
        decided = actions.reshape(20, -1).astype(np.float32)
        graph.values["decided"] = decided
        after = front.decided(ends[1], Node(graph, "decided"), features, xp)
        memory = front.decided(memory, decided, features)
        np.testing.assert_allclose(graph.values[after.name], memory, atol=1e-6)
        bare.step(actions)


def test_it_acts_as_the_policy_in_a_world_with_the_front_end():
    shift, rule = "late,unseen=.3,noise=1", policies.policy("gap_3s")
    bare = Intersection().shifted(shift).batch(6)
    fronted = Intersection().shifted(shift, "latency=1,track=3,noise=1").batch(6)
    policy, state, started = FrontEndPolicy(rule, FRONT_END, 70), None, None
    bare.reset(50), fronted.reset(50)
    for _ in range(25):  # into next episodes
        chosen, state = policy.predict(bare.observation, state, started)
        np.testing.assert_array_equal(chosen, rule.predict(fronted.observation)[0])
        started = bare.step(chosen).ending != 0
        fronted.step(chosen)


def test_a_single_observation_and_one_of_another_length():
    policy = FrontEndPolicy(policies.policy("go"), FRONT_END, 70)
    action, state = policy.predict(np.zeros(70, np.float32))
    assert action.shape == () and state.shape == (1, 9 * 10 + 2)
    with pytest.raises(UserError, match=r"shape \(71,\): this policy takes \(70,\)"):
        policy.predict(np.zeros(71, np.float32))
    with pytest.raises(UserError, match="holds NaN or infinity"):
        policy.predict(np.full(70, np.nan, np.float32))
