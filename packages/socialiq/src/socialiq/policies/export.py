"""Exports of policies: ONNX graphs, PyTorch modules, and weights under PyTorch's names.

A graph is written node by node, without a tracing library. Only operators of `policies.onnx_graph`
are used, so `policies.load` reads the files. All vehicles of a pooled view share one set of weights
in the file.
"""

import importlib.metadata
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import safetensors.numpy

from socialiq.errors import UserError
from socialiq.foreign import optional
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.ensemble import EnsemblePolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.unlikeness import Unlikeness
from socialiq.nn.view import ALONG, BESIDE, PER_SECOND, ROW, SECONDS, OneHot, View, row_width
from socialiq.policies.front_end import MEMORY, NEXT, SENSED, Node, Nodes
from socialiq.worlds.highway.perception import FrontEnd

Exported = QPolicy | EnsemblePolicy | ActorPolicy
"""Policies that are exported; of a dial, `at` gives the policy at an angle."""

OPSET = 17
IR_VERSION = 8
INPUT = "observation"
SCORES = "q_values"
ACTIONS = "actions"
UNLIKENESS = "unlikeness"
"""Names of the input and of the outputs."""

# Places in a row of (x, y) of position, velocity and heading; and of the same as (y, x).
_TURNS = {"along": (1, 2, 3, 4, 5, 6), "across": (2, 1, 4, 3, 6, 5)}
_ACTIVATIONS = {"relu": "Relu", "elu": "Elu", "tanh": "Tanh"}


def to_onnx(policy: Exported, front_end: FrontEnd | None = None) -> bytes:
    """Return a policy as the bytes of an ONNX file.

    It takes float32 (batch, features) and has two outputs: `q_values`, float32 (batch, actions),
    and `actions`, int64 (batch,), the best action, of equal ones the first, as `QPolicy.predict`.
    An actor has one output, `actions`, float32 (batch, size): its deterministic action in [-1, 1].

    A score of unlikeness is a further output, `unlikeness`, float32 (batch, 1), above 1 where it
    raises an alarm at the usual rate.

    With a front end the inputs are what the sensors show, `sensed`, and `memory`, zeros where an
    episode begins; the further output `memory_after` is the memory of the next decision.

    Args:
        policy: The policy.
        front_end: Front end of the policy's road, with its ego; None for no front end.

    Raises:
        UserError: If the extra `onnx` is not installed, or a front end is of another road.
    """
    onnx = optional("onnx", "onnx", "ONNX files")
    helper = onnx.helper
    kinds = onnx.TensorProto
    info = onnx.helper.make_tensor_value_info
    graph = _Graph(onnx)
    temperature = ""
    if isinstance(policy, ActorPolicy):
        graph.actor(policy)
        outputs = [info(ACTIONS, kinds.FLOAT, ["batch", policy.action_size])]
    else:
        if isinstance(policy, EnsemblePolicy):
            graph.mean(policy.members)
        else:
            graph.layers(policy, policy.weights, policy.biases)
        graph.add("ArgMax", [SCORES], ACTIONS, axis=1, keepdims=0)
        temperature = repr(policy.temperature)
        scores = info(SCORES, kinds.FLOAT, ["batch", policy.n_actions])
        outputs = [scores, info(ACTIONS, kinds.INT64, ["batch"])]
        if isinstance(policy, QPolicy) and policy.unlikeness is not None:
            outputs.append(info(graph.unlikeness(policy.unlikeness), kinds.FLOAT, ["batch", 1]))
    inputs = [info(INPUT, kinds.FLOAT, ["batch", policy.n_features])]
    if front_end is not None:
        width = graph.sense(policy, front_end)
        names = ((SENSED, policy.n_features), (MEMORY, width), (NEXT, width))
        *inputs, after = (info(name, kinds.FLOAT, ["batch", size]) for name, size in names)
        outputs.append(after)
    constants = [
        onnx.numpy_helper.from_array(array, name) for name, array in graph.constants.items()
    ]
    model = helper.make_model(
        helper.make_graph(graph.nodes, "policy", inputs, outputs, constants),
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="socialiq",
        producer_version=importlib.metadata.version("socialiq"),
    )
    entries = {
        "socialiq.policy_sha256": policy.sha256,
        "socialiq.temperature": temperature,
        "socialiq.provenance": json.dumps(dict(policy.provenance)),
    }
    helper.set_model_props(model, {name: text for name, text in entries.items() if text})
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString()


class _Graph:
    """Nodes and constants of a graph, added from the observation onwards."""

    def __init__(self, onnx: Any) -> None:
        self._onnx = onnx
        self._hidden = INPUT
        self.nodes: list[Any] = []
        self.constants: dict[str, np.ndarray] = {}

    def add(
        self, operator: str, inputs: list[str], name: str, *further: str, **attributes: Any
    ) -> str:
        """Add a node whose first output has the node's name.

        Args:
            operator: Name of the ONNX operator.
            inputs: Names of its inputs.
            name: Name of the node and of its first output.
            *further: Names of its further outputs.
            **attributes: Attributes of the operator.

        Returns:
            The name.
        """
        outputs = [name, *further]
        node = self._onnx.helper.make_node(operator, inputs, outputs, name=name, **attributes)
        self.nodes.append(node)
        return name

    def sense(self, policy: Exported, front_end: FrontEnd) -> int:
        """Put a front end before the policy's nodes and behind them; return its memory's length."""
        n_features = policy.n_features
        counts = policy.n_actions, front_end.ego.n_actions
        if counts[0] != counts[1]:
            own, of_road = (f"{count or 'continuous'} actions" for count in counts)
            raise UserError(
                f"the policy has {own}, the front end's road {of_road}: name its road by --world, "
                "as merge or intersection,control=continuous"
            )
        if n_features < 2 * ROW or n_features % ROW > 1:
            raise UserError("a front end is of rows of vehicles: leave out --front-end")
        sensed = n_features - n_features % ROW
        nodes = self.nodes
        self.nodes = []
        xp = Nodes(self)
        estimate, memory = front_end.see(Node(self, SENSED), Node(self, MEMORY), sensed, xp=xp)
        self.add("Identity", [estimate.name], INPUT)
        self.nodes += nodes
        actions = Node(self, ACTIONS)
        if policy.n_actions:
            number = Node(self, self.add("Cast", [ACTIONS], "chosen", to=1))
            actions = xp.shaped(number, 1)
        after = front_end.decided(memory, actions, sensed, xp)
        self.add("Identity", [after.name], NEXT)
        return front_end.memory(1, sensed).shape[1]

    def constant(self, name: str, array: np.ndarray) -> str:
        """Add a constant unless there is one of that name.

        Args:
            name: Name of the constant.
            array: Its values.

        Returns:
            The name.
        """
        self.constants.setdefault(name, array)
        return name

    def affine(
        self, value: str, weight: np.ndarray, bias: np.ndarray, name: str, output: str = ""
    ) -> str:
        """Add an affine layer.

        Args:
            value: Name of the input, (batch, in).
            weight: Weights, (out, in).
            bias: Biases, (out,).
            name: Name of the layer; layers of one name share their weights.
            output: Name of the output; "" for the layer's name.

        Returns:
            The name of the output, (batch, out).
        """
        inputs = [
            value,
            self.constant(f"{name}.weight", np.asarray(weight, np.float32)),
            self.constant(f"{name}.bias", np.asarray(bias, np.float32)),
        ]
        return self.add("Gemm", inputs, output or name, transB=1)

    def gather(self, places: list[int], name: str) -> str:
        """Add the selection of some elements of the observation.

        Args:
            places: Indices of the elements, in the order of the result.
            name: Name of the result.

        Returns:
            The name.
        """
        index = self.constant(f"{name}.places", np.array(places, np.int64))
        return self.add("Gather", [INPUT, index], name, axis=1)

    def scaled(self, value: str, scales: list[float], name: str) -> str:
        """Add the product of a value and constants.

        Args:
            value: Name of the value, (batch, n).
            scales: The n constants.
            name: Name of the product.

        Returns:
            The name of the product.
        """
        factor = self.constant(f"{name}.factor", np.array(scales, np.float32))
        return self.add("Mul", [value, factor], name)

    def layers(
        self, policy: QPolicy | ActorPolicy, weights: Any, biases: Any, name: str = SCORES
    ) -> str:
        """Add the view of a policy, and layers with its activation between them.

        Args:
            policy: The policy, whose view and activation are used.
            weights: Weights of each layer, (out, in).
            biases: Biases of each layer, (out,).
            name: Name of the last layer's output; "" for the layer's own name.

        Returns:
            The name of the output.
        """
        value = INPUT
        view = policy.view
        if isinstance(view, OneHot):
            places = np.repeat(np.arange(view.n_features), view.sizes).tolist()
            starts = zip(view.lows, view.sizes, strict=True)
            steps = [low + step for low, size in starts for step in range(size)]
            self.constant("one_hot.values", np.array(steps, np.float32))
            value = self._places(self.gather(places, "one_hot.read"), steps, "one_hot")
        elif view is not None:
            value = self._view(view)
        for number, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
            if number:
                value = self.add(_ACTIVATIONS[policy.activation], [value], f"activation_{number}")
            self._hidden = value
            output = name if number == len(weights) - 1 else ""
            value = self.affine(value, weight, bias, f"layer_{number}", output)
        return value

    def unlikeness(self, score: Unlikeness) -> str:
        """Add the score of a policy's last hidden layer; return its name."""
        arrays = vars(score) | {"axis": np.array([1])}
        mean, factor, axis = (
            self.constant(f"{UNLIKENESS}.{name}", arrays[name])
            for name in ("mean", "factor", "axis")
        )
        centred = self.add("Sub", [self._hidden, mean], f"{UNLIKENESS}.centred")
        white = self.add("MatMul", [centred, factor], f"{UNLIKENESS}.white")
        squares = self.add("Mul", [white, white], f"{UNLIKENESS}.squares")
        return self.add("ReduceSum", [squares, axis], UNLIKENESS)

    def _places(self, read: str, values: list[int], name: str) -> str:
        """Add the comparison of read features with values, 1 where they are equal."""
        constant = self.constant(f"{name}.values", np.array(values, np.float32))
        equal = self.add("Equal", [read, constant], f"{name}.equal")
        return self.add("Cast", [equal], name, to=self._onnx.TensorProto.FLOAT)

    def actor(self, policy: ActorPolicy) -> None:
        """Add an actor, from the observation to the deterministic action."""
        size = policy.action_size
        *weights, weight = policy.weights
        *biases, bias = policy.biases
        means = [*weights, weight[:size]], [*biases, bias[:size]]  # without deviations
        value = self.layers(policy, *means, "")
        if policy.squash == "tanh":
            self.add("Tanh", [value], ACTIONS)
            return
        # Within ±1 as relu(u + 1) - relu(u - 1) - 1, by operators that are read again.
        ones = self.constant("one", np.ones(size, np.float32))
        above = self.add("Relu", [self.add("Add", [value, ones], "raised")], "above")
        beyond = self.add("Relu", [self.add("Sub", [value, ones], "lowered")], "beyond")
        self.add("Sub", [self.add("Sub", [above, beyond], "within"), ones], ACTIONS)

    def mean(self, members: Sequence[QPolicy]) -> None:
        """Add several networks and the mean of their values, in the order of `EnsemblePolicy`."""
        total = ""
        for number, member in enumerate(members):
            graph = _Graph(self._onnx)
            prefix = f"member_{number}."
            graph.layers(member, member.weights, member.biases)
            for node in graph.nodes:
                inputs = [name if name == INPUT else prefix + name for name in node.input]
                node.name = prefix + node.output[0]
                node.output[:] = [node.name]
                node.input[:] = inputs
            self.nodes += graph.nodes
            self.constants |= {prefix + name: array for name, array in graph.constants.items()}
            value = prefix + SCORES
            total = self.add("Add", [total, value], f"sum_{number}") if number else value
        count = self.constant("members", np.array([len(members)], np.float32))
        self.add("Div", [total, count], SCORES)

    def _view(self, view: View) -> str:
        """Add the rows of the ego and other vehicles: encoded, summed and maximised, or listed."""
        of_ego, of_user = view.choice.layout
        if view.choice.is_of_rows:
            ego = self._ego_row(view)
        else:
            ego = self.gather(list(range(of_ego)), "own.read")
        numbers = range(1, 1 + (view.n_features - of_ego) // of_user)
        rows = [self._vehicle(view, number) for number in numbers]
        first = [ego]
        if view.times:  # the last feature, one place for each value
            read = self.gather([view.n_features - 1] * view.times, "time.read")
            first = [self._places(read, list(range(view.times)), "time"), ego]
        if not view.choice.pooled:
            return self.add("Concat", [*first, *rows], "view", axis=1)
        total = most = rows[0]
        for number, row in zip(numbers[1:], rows[1:], strict=True):
            total = self.add("Add", [total, row], f"sum_{number}")
            most = self.add("Max", [most, row], f"most_{number}")
        return self.add("Concat", [*first, total, most], "view", axis=1)

    def _ego_row(self, view: View) -> str:
        """Add the ego's row, and what rows of vehicles are relative to."""
        scale = view.choice.scale
        ego = self.gather(list(range(1, ROW)), "own.read")
        ego = self.scaled(ego, [scale] * 4 + [1.0] * 2, "own")
        # The reference for the relative view: headings are rotated, but not shifted.
        for label, places in _TURNS.items() if view.choice.relative else ():
            read = self.gather(list(places), f"ego.{label}.read")
            self.scaled(read, [1.0] * 4 + [0.0] * 2, f"ego.{label}")
            cos = label == "along"
            heading = self.gather([5 if cos else 6] * 6, f"ego.{label}.heading.read")
            signs = [1.0, 1.0 if cos else -1.0] * 3
            self.scaled(heading, signs, f"ego.{label}.heading")
        return ego

    def _vehicle(self, view: View, number: int) -> str:
        """Add another vehicle as the view lists or encodes it; all zeros where there is none."""
        name = f"vehicle_{number}"
        of_ego, of_user = view.choice.layout
        first = of_ego + (number - 1) * of_user
        scale = view.choice.scale
        row = self.gather(list(range(first, first + of_user)), f"{name}.read")
        columns = [row]
        if view.choice.is_of_rows:
            columns = [self.scaled(row, [1.0] + [scale] * 4 + [1.0] * 2, f"{name}.absolute")]
        if view.choice.is_of_rows and view.choice.relative:
            turned = self._turned(name, first)
            columns.append(self.scaled(turned, [scale] * 4 + [1.0] * 2, f"{name}.relative"))
            if view.choice.ahead:
                columns.append(self._closeness(name, turned))
        value = columns[0]
        if len(columns) > 1:
            value = self.add("Concat", columns, f"{name}.told", axis=1)
        width = row_width(view.choice)
        value = self._where_present(value, first, width, f"{name}.shown")
        for layer, (weight, bias) in enumerate(zip(view.weights, view.biases, strict=True)):
            value = self.affine(value, weight, bias, f"encoder_{layer}", f"{name}.layer_{layer}")
            value = self.add("Relu", [value], f"{name}.relu_{layer}")
            width = len(bias)
        if not view.weights:
            return value
        return self._where_present(value, first, width, f"{name}.counted")

    def _where_present(self, value: str, first: int, width: int, name: str) -> str:
        return self.add("Mul", [value, self.gather([first] * width, f"{name}.presence")], name)

    def _turned(self, name: str, first: int) -> str:
        """Add vectors along the ego's heading and to its left, (x cos + y sin, y cos - x sin)."""
        turned = []
        for label, places in _TURNS.items():
            read = self.gather([first + index for index in places], f"{name}.{label}.read")
            offset = self.add("Sub", [read, f"ego.{label}"], f"{name}.{label}.offset")
            turned.append(self.add("Mul", [offset, f"ego.{label}.heading"], f"{name}.{label}"))
        return self.add("Add", turned, f"{name}.turned")

    def _closeness(self, name: str, turned: str) -> str:
        """Add `nn.view.closeness`; a hat is relu(1 - relu(u) - relu(-u))."""
        ones = self.constant("closeness.one", np.ones(len(SECONDS), np.float32))
        hats = []
        seconds = np.array(SECONDS)
        for axis, (label, unit) in enumerate((("ahead", ALONG), ("beside", BESIDE))):
            weight = np.zeros((len(SECONDS), 6))
            value = ones
            weight[:, axis] = 1 / unit
            weight[:, 2 + axis] = PER_SECOND / unit * seconds
            for sign, side, name_left in ((1.0, "plus", "left"), (-1.0, "minus", "rest")):
                shared = f"closeness.{label}.{side}"
                output = f"{name}.{label}.{side}"
                bias = np.zeros(len(SECONDS))
                distance = self.affine(turned, sign * weight, bias, shared, output)
                slope = self.add("Relu", [distance], f"{output}.part")
                value = self.add("Sub", [value, slope], f"{name}.{label}.{name_left}")
            hats.append(self.add("Relu", [value], f"{name}.{label}.hat"))
        close = self.add("Mul", hats, f"{name}.close")
        ahead = self.add("Mul", [close, f"{name}.ahead.plus"], f"{name}.close_ahead")
        return self.add("Concat", [close, ahead], f"{name}.closeness", axis=1)


def as_torch_module(policy: Exported) -> Any:
    """Return the policy's network as a `torch.nn.Module` of (batch, features), float32.

    It gives Q values, whose greedy action is `argmax(dim=1)`; of an actor the deterministic action
    in [-1, 1]. Its weights are copies and can be trained.
    """
    torch = optional("torch", "torch", "PyTorch modules")
    from socialiq.policies.torch_network import module_of

    module = module_of(policy)
    module.load_state_dict(
        {name: torch.from_numpy(array.copy()) for name, array in state_dict(policy).items()}
    )
    return module


def state_dict(policy: Exported) -> dict[str, np.ndarray]:
    """Return the weights under the module's names, float32; needs no PyTorch."""
    if isinstance(policy, EnsemblePolicy):
        return {
            f"members.{number}.{name}": array
            for number, member in enumerate(policy.members)
            for name, array in state_dict(member).items()
        }
    arrays = _named("layers", policy.weights, policy.biases)
    if isinstance(policy.view, View):
        arrays |= _named("view.layers", policy.view.weights, policy.view.biases)
    return arrays


def to_safetensors(policy: Exported) -> bytes:
    """Return `state_dict` as a plain safetensors file, for `safetensors.torch.load_file`.

    Its metadata hold the activation, the view and the provenance, as JSON.
    """
    _, header = policy.content()
    metadata = {"format": "pt", "policy_sha256": policy.sha256, "policy": json.dumps(header)}
    return safetensors.numpy.save(state_dict(policy), metadata=metadata)


def _named(prefix: str, weights: Any, biases: Any) -> dict[str, np.ndarray]:
    pairs = enumerate(zip(weights, biases, strict=True))
    return {
        f"{prefix}.{number}.{kind}": np.ascontiguousarray(array, np.float32)
        for number, pair in pairs
        for kind, array in zip(("weight", "bias"), pair, strict=True)
    }
