"""Export of policies as ONNX: the graph is written node by node, without a tracing library.

Only operators of `policies.onnx.graph` are used, so `policies.load` reads the files. All vehicles
of a pooled view share one set of weights in the file.
"""

from __future__ import annotations

import importlib.metadata
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from socialiq.foreign import optional
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.ensemble import EnsemblePolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.view import ALONG, BESIDE, PER_SECOND, ROW, SECONDS, OneHot, View, row_width

OPSET = 17
IR_VERSION = 8
INPUT, SCORES, ACTIONS = "observation", "q_values", "actions"
"""Names of the input and of the two outputs."""

# Places in a row of (x, y) of position, velocity and heading; and of the same as (y, x).
_TURNS = {"along": (1, 2, 3, 4, 5, 6), "across": (2, 1, 4, 3, 6, 5)}
_ACTIVATIONS = {"relu": "Relu", "elu": "Elu", "tanh": "Tanh"}


def to_onnx(policy: QPolicy | EnsemblePolicy | ActorPolicy) -> bytes:
    """Return a policy as the bytes of an ONNX file.

    It takes float32 (batch, features) and has two outputs: `q_values`, float32 (batch, actions),
    and `actions`, int64 (batch,), the best action, of equal ones the first, as `QPolicy.predict`.
    An actor has one output, `actions`, float32 (batch, size): its deterministic action in [-1, 1].

    Args:
        policy: Any policy or ensemble; of a dial, `DialPolicy.at` gives the policy at an angle.

    Raises:
        UserError: If the extra `onnx` is not installed.
    """
    onnx = optional("onnx", "onnx", "ONNX files")
    graph = _Graph(onnx)
    if isinstance(policy, ActorPolicy):
        graph.actor(policy)
        return _model(onnx, graph, policy)
    if isinstance(policy, EnsemblePolicy):
        graph.mean(policy.members)
    else:
        graph.network(policy)
    graph.add("ArgMax", [SCORES], ACTIONS, axis=1, keepdims=0)
    return _model(onnx, graph, policy)


def _outputs(onnx: Any, policy: QPolicy | EnsemblePolicy | ActorPolicy) -> list[Any]:
    info, kinds = onnx.helper.make_tensor_value_info, onnx.TensorProto
    if isinstance(policy, ActorPolicy):
        return [info(ACTIONS, kinds.FLOAT, ["batch", policy.action_size])]
    scores = info(SCORES, kinds.FLOAT, ["batch", policy.n_actions])
    return [scores, info(ACTIONS, kinds.INT64, ["batch"])]


def _model(onnx: Any, graph: _Graph, policy: QPolicy | EnsemblePolicy | ActorPolicy) -> bytes:
    helper, kinds = onnx.helper, onnx.TensorProto
    seen = helper.make_tensor_value_info(INPUT, kinds.FLOAT, ["batch", policy.n_features])
    made = _outputs(onnx, policy)
    constants = [
        onnx.numpy_helper.from_array(array, name) for name, array in graph.constants.items()
    ]
    model = helper.make_model(
        helper.make_graph(graph.nodes, "policy", [seen], made, constants),
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="socialiq",
        producer_version=importlib.metadata.version("socialiq"),
    )
    entries = {
        "socialiq.policy_sha256": policy.sha256,
        "socialiq.temperature": (
            "" if isinstance(policy, ActorPolicy) else repr(policy.temperature)
        ),
        "socialiq.provenance": json.dumps(dict(policy.provenance)),
    }
    helper.set_model_props(model, {name: text for name, text in entries.items() if text})
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString()


class _Graph:
    """Nodes and constants of a graph, added from the observation onwards."""

    def __init__(self, onnx: Any) -> None:
        self._onnx = onnx
        self.nodes: list[Any] = []
        self.constants: dict[str, np.ndarray] = {}

    def add(self, operator: str, inputs: list[str], name: str, **attributes: Any) -> str:
        """Add a node with one output of the same name; return the name."""
        node = self._onnx.helper.make_node(operator, inputs, [name], name=name, **attributes)
        self.nodes.append(node)
        return name

    def constant(self, name: str, array: np.ndarray) -> str:
        """Add a constant unless it exists; return its name."""
        self.constants.setdefault(name, array)
        return name

    def affine(
        self, value: str, weight: np.ndarray, bias: np.ndarray, name: str, output: str = ""
    ) -> str:
        """Add an affine layer; layers of one name share weights, so their outputs need names."""
        inputs = [
            value,
            self.constant(f"{name}.weight", np.asarray(weight, np.float32)),
            self.constant(f"{name}.bias", np.asarray(bias, np.float32)),
        ]
        return self.add("Gemm", inputs, output or name, transB=1)

    def gather(self, places: list[int], name: str, value: str = INPUT) -> str:
        """Add the selection of some elements of a value, in the given order."""
        index = self.constant(f"{name}.places", np.array(places, np.int64))
        return self.add("Gather", [value, index], name, axis=1)

    def scaled(self, value: str, scales: list[float], name: str) -> str:
        """Add the product of a value and constants."""
        factor = self.constant(f"{name}.factor", np.array(scales, np.float32))
        return self.add("Mul", [value, factor], name)

    def network(self, policy: QPolicy) -> None:
        """Add a network, from the observation to its values."""
        value = self.seen(policy)
        for number, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
            if number:
                value = self.add(_ACTIVATIONS[policy.activation], [value], f"activation_{number}")
            last = number == len(policy.weights) - 1
            value = self.affine(value, weight, bias, f"layer_{number}", SCORES if last else "")

    def actor(self, policy: ActorPolicy) -> None:
        """Add an actor, from the observation to the deterministic action."""
        size, value = policy.action_size, self.seen(policy)
        for number, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
            if number:
                value = self.add(_ACTIVATIONS[policy.activation], [value], f"activation_{number}")
            if number == len(policy.weights) - 1:
                weight, bias = weight[:size], bias[:size]  # the means, without deviations
            value = self.affine(value, weight, bias, f"layer_{number}")
        if policy.squash == "tanh":
            self.add("Tanh", [value], ACTIONS)
            return
        # Within ±1 as relu(u + 1) - relu(u - 1) - 1, by operators that are read again.
        one = self.constant("one", np.ones(size, np.float32))
        above = self.add("Relu", [self.add("Add", [value, one], "raised")], "above")
        beyond = self.add("Relu", [self.add("Sub", [value, one], "lowered")], "beyond")
        self.add("Sub", [self.add("Sub", [above, beyond], "within"), one], ACTIONS)

    def mean(self, members: Sequence[QPolicy]) -> None:
        """Add several networks and the mean of their values, in the order of `EnsemblePolicy`."""
        total = ""
        for number, member in enumerate(members):
            part = _Graph(self._onnx)
            part.network(member)
            value = self._take(part, f"member_{number}.")
            total = self.add("Add", [total, value], f"sum_{number}") if number else value
        count = self.constant("members", np.array([len(members)], np.float32))
        self.add("Div", [total, count], SCORES)

    def _take(self, part: _Graph, prefix: str) -> str:
        """Add all of another graph under names with a prefix; return the name of its values."""
        for node in part.nodes:
            inputs = [name if name == INPUT else prefix + name for name in node.input]
            node.name = prefix + node.output[0]
            node.input[:], node.output[:] = inputs, [node.name]
        self.nodes += part.nodes
        self.constants |= {prefix + name: array for name, array in part.constants.items()}
        return prefix + SCORES

    def seen(self, policy: QPolicy | ActorPolicy) -> str:
        """Add the view of a policy; return the name of the first layer's input."""
        if isinstance(policy.view, OneHot):
            return self._one_hot(policy.view)
        return INPUT if policy.view is None else self._view(policy.view)

    def _one_hot(self, view: OneHot) -> str:
        places = np.repeat(np.arange(view.n_features), view.sizes).tolist()
        values = [
            low + step
            for low, size in zip(view.lows, view.sizes, strict=True)
            for step in range(size)
        ]
        wanted = self.constant("one_hot.values", np.array(values, np.float32))
        equal = self.add("Equal", [self.gather(places, "one_hot.read"), wanted], "one_hot.equal")
        return self.add("Cast", [equal], "one_hot", to=self._onnx.TensorProto.FLOAT)

    def _view(self, view: View) -> str:
        """Add the ego's row and the other vehicles: encoded, summed and maximised, or listed."""
        scale = view.choice.scale
        own = self.gather(list(range(1, ROW)), "own.read")
        own = self.scaled(own, [scale] * 4 + [1.0] * 2, "own")
        if view.choice.relative:
            self._ego()
        others = range(1, view.n_features // ROW)
        rows = [self._vehicle(view, number) for number in others]
        first = [self._time(view), own] if view.times else [own]
        if not view.choice.pooled:
            return self.add("Concat", [*first, *rows], "view", axis=1)
        total = most = rows[0]
        for number, row in zip(others[1:], rows[1:], strict=True):
            total = self.add("Add", [total, row], f"sum_{number}")
            most = self.add("Max", [most, row], f"most_{number}")
        return self.add("Concat", [*first, total, most], "view", axis=1)

    def _time(self, view: View) -> str:
        """Add the time, the last feature, one place for each value."""
        read = self.gather([view.n_features - 1] * view.times, "time.read")
        values = self.constant("time.values", np.arange(view.times, dtype=np.float32))
        equal = self.add("Equal", [read, values], "time.equal")
        return self.add("Cast", [equal], "time", to=self._onnx.TensorProto.FLOAT)

    def _vehicle(self, view: View, number: int) -> str:
        """Add another vehicle as the view lists or encodes it; all zeros where there is none."""
        name, first, scale = f"vehicle_{number}", number * ROW, view.choice.scale
        row = self.gather(list(range(first, first + ROW)), f"{name}.read")
        parts = [self.scaled(row, [1.0] + [scale] * 4 + [1.0] * 2, f"{name}.absolute")]
        if view.choice.relative:
            turned = self._turned(name, first)
            parts.append(self.scaled(turned, [scale] * 4 + [1.0] * 2, f"{name}.relative"))
            if view.choice.ahead:
                parts.append(self._closeness(name, turned))
        value = parts[0]
        if len(parts) > 1:
            value = self.add("Concat", parts, f"{name}.told", axis=1)
        width = row_width(view.choice)
        value = self._where_present(value, first, width, f"{name}.shown")
        for layer, (weight, bias) in enumerate(zip(view.weights, view.biases, strict=True)):
            value = self.affine(value, weight, bias, f"encoder_{layer}", f"{name}.layer_{layer}")
            value = self.add("Relu", [value], f"{name}.relu_{layer}")
            width = len(bias)
        if not view.weights:
            return value
        return self._where_present(value, first, width, f"{name}.counted")

    def _where_present(self, value: str, first: int, width: int, made: str) -> str:
        return self.add("Mul", [value, self.gather([first] * width, f"{made}.presence")], made)

    def _turned(self, name: str, first: int) -> str:
        """Add position, velocity and heading along the ego's heading and to its left.

        A vector (x, y) turned by the heading (cos, sin) is (x cos + y sin, y cos - x sin).
        """
        turned = []
        for label, places in _TURNS.items():
            read = self.gather([first + place for place in places], f"{name}.{label}.read")
            offset = self.add("Sub", [read, f"ego.{label}"], f"{name}.{label}.offset")
            turned.append(self.add("Mul", [offset, f"ego.{label}.heading"], f"{name}.{label}"))
        return self.add("Add", turned, f"{name}.turned")

    def _closeness(self, name: str, turned: str) -> str:
        """Add `nn.view.closeness`; a hat is relu(1 - relu(u) - relu(-u))."""
        one = self.constant("closeness.one", np.ones(len(SECONDS), np.float32))
        moved, hats = [], []
        for place, (label, unit) in enumerate((("ahead", ALONG), ("beside", BESIDE))):
            weight = np.zeros((len(SECONDS), 6))
            weight[:, place], weight[:, 2 + place] = 1 / unit, PER_SECOND / unit * np.array(SECONDS)
            both = []
            for sign, side in ((1.0, "plus"), (-1.0, "minus")):
                shared, made = f"closeness.{label}.{side}", f"{name}.{label}.{side}"
                value = self.affine(turned, sign * weight, np.zeros(len(SECONDS)), shared, made)
                both.append(self.add("Relu", [value], f"{made}.part"))
            moved.append(f"{name}.{label}.plus")
            left = self.add("Sub", [one, both[0]], f"{name}.{label}.left")
            left = self.add("Sub", [left, both[1]], f"{name}.{label}.rest")
            hats.append(self.add("Relu", [left], f"{name}.{label}.hat"))
        close = self.add("Mul", hats, f"{name}.close")
        parts = [close, self.add("Mul", [close, moved[0]], f"{name}.close_ahead")]
        return self.add("Concat", parts, f"{name}.closeness", axis=1)

    def _ego(self) -> None:
        """Add the reference for the relative view; headings are rotated, but not shifted."""
        for label, places in _TURNS.items():
            read = self.gather(list(places), f"ego.{label}.read")
            self.scaled(read, [1.0] * 4 + [0.0] * 2, f"ego.{label}")
            cos = label == "along"
            heading = self.gather([5 if cos else 6] * 6, f"ego.{label}.heading.read")
            signs = [1.0, 1.0 if cos else -1.0] * 3
            self.scaled(heading, signs, f"ego.{label}.heading")
