"""Policies in ONNX: checked field by field and operator by operator, then run by onnxruntime.

onnxruntime evaluates the graph because the policy's author tests with it. It gets the checked
model, serialised again, never the file itself.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from jaxtyping import Float32

from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.policies.interface import BatchPolicy, Interface
from socialiq.policies.onnx.fields import check_fields
from socialiq.policies.onnx.graph import (
    MOST_DIMENSION,
    MOST_NODES,
    GraphFault,
    Shape,
    Values,
    follow,
)

ROWS = 1_024
"""Observations of one call; larger batches are split, so that memory stays bounded."""

IR_VERSION = 10
"""Newest version of ONNX's file format that is passed to onnxruntime."""

_DOMAINS = ("", "ai.onnx")
_ACTIONS = "actions"


def read_onnx(content: bytes, source: str, world: Interface) -> tuple[BatchPolicy, dict[str, Any]]:
    """Load a policy from the bytes of an ONNX file.

    Its one input is float32, (batch, ...), with a free batch size; its output is a score for each
    action, of which the best is taken, or the action itself. Of several outputs the one named
    "actions" is used. It has no distribution, so it always takes its best action.

    Args:
        content: The file.
        source: Its name in messages.
        world: The interface that the policy must have.

    Returns:
        The policy, and details from the file.

    Raises:
        UserError: If the extra `onnx` is not installed; if the file is damaged, does more than the
            rules of `onnx.graph` allow, or is made for another world.
    """
    onnx, onnxruntime = (
        optional(name, "onnx", "ONNX policies") for name in ("onnx", "onnxruntime")
    )
    check_fields(content, source)
    try:
        model = onnx.ModelProto.FromString(content)
        seen, shape, operators = _checked(onnx, model)
    except GraphFault as fault:
        raise UserError(f"{source}: the graph {fault}; export a plain network") from fault
    # The libraries' exceptions have no common class.
    except Exception as error:
        raise UserError(f"{source} is damaged or not an ONNX file: export it again") from error
    n_features, output = math.prod(seen), model.graph.output[0]
    session = _session(onnxruntime, model, source)
    whole = session.get_outputs()[0].type in ("tensor(int64)", "tensor(int32)")
    if whole and shape not in ((), (1,)):
        raise UserError(f"{source} answers whole numbers of shape {shape}: it must be one action")
    if not whole and len(shape) != 1:
        raise UserError(f"{source} answers scores of shape {shape}: it must be one of each action")
    runner = _Runner(session, (model.graph.input[0].name, output.name), seen, source)
    if world.action_size:
        if whole:
            raise UserError(f"{source} answers whole numbers: this world takes continuous actions")
        interface = Interface(n_features, 0, shape[0])
        interface.check(source, world)
        details = {"operators": operators, "answers": "continuous actions"}
        return BatchPolicy(source, interface, runner.actions_of_floats), details
    if not whole and output.name == _ACTIONS:
        raise UserError(
            f"{source} answers continuous actions: this world's are discrete; an output of scores "
            f"has another name than {_ACTIONS}"
        )
    interface = Interface(n_features, world.n_actions if whole else shape[0])
    interface.check(source, world)
    details = {"operators": operators, "answers": "actions" if whole else "scores"}
    return BatchPolicy(source, interface, runner.actions if whole else runner.best), details


def _checked(onnx: Any, model: Any) -> tuple[Shape, Shape, list[str]]:
    """Return the shapes of input and output for one observation, and the operators used.

    Everything that was not checked is removed from the model, and all outputs but one.

    Raises:
        GraphFault: If the graph is not a policy.
    """
    graph, values = model.graph, Values()
    for used in model.opset_import:
        _check_domain(used.domain)
    for tensor in graph.initializer:
        values.add_constant(tensor.name, _array(onnx, tensor))
    free = [one for one in graph.input if one.name not in values.constants]
    if len(free) != 1:
        raise GraphFault(f"has {len(free)} inputs, not one")
    seen = _input_shape(onnx, free[0])
    values.add_row(free[0].name, seen)
    if len(graph.node) > MOST_NODES:
        raise GraphFault(f"has more than {MOST_NODES:,} nodes")
    for node in graph.node:
        _add(onnx, values, node)
    named = [one for one in graph.output if one.name == _ACTIONS or len(graph.output) == 1]
    if len(named) != 1:
        raise GraphFault(f"has {len(graph.output)} outputs and none is named {_ACTIONS}")
    shape = values.row(named[0].name)
    _keep(graph.input, free[0])
    _keep(graph.output, named[0])
    # Shapes that the file claims, and settings that onnxruntime could take from it, are not needed.
    del graph.value_info[:], model.metadata_props[:]
    # Versions of the file format add fields, and which fields there are is checked: an older
    # onnxruntime can read what is left.
    model.ir_version = min(model.ir_version, IR_VERSION)
    return seen, shape, sorted({node.op_type for node in graph.node})


def _keep(listed: Any, one: Any) -> None:
    kept = type(one)()
    kept.CopyFrom(one)
    del listed[:]
    listed.append(kept)


def _check_domain(domain: str) -> None:
    if domain not in _DOMAINS:
        raise GraphFault(f"uses operators of the domain {one_line(domain, 40)!r}")


def _add(onnx: Any, values: Values, node: Any) -> None:
    """Check a node of the graph and define its value."""
    _check_domain(node.domain)
    attributes = {one.name: onnx.helper.get_attribute_value(one) for one in node.attribute}
    if len(node.output) != 1 or len(attributes) != len(node.attribute):
        raise GraphFault(f"has a {one_line(node.op_type, 40)} of several outputs")
    if node.op_type != "Constant":
        values.add_row(node.output[0], follow(values, node.op_type, node.input, attributes))
        return
    if list(attributes) != ["value"] or node.attribute[0].type != onnx.AttributeProto.TENSOR:
        raise GraphFault("has a Constant that is not a tensor")
    values.add_constant(node.output[0], _array(onnx, attributes["value"]))


def _array(onnx: Any, tensor: Any) -> np.ndarray:
    """Return a constant's numbers; its shape is checked before they are unpacked."""
    kinds = (onnx.TensorProto.FLOAT, onnx.TensorProto.INT64, onnx.TensorProto.INT32)
    dims = tuple(tensor.dims)
    if tensor.data_type not in kinds:
        raise GraphFault("has a constant that is not float32, int64 or int32")
    if len(dims) > 2 or any(not 0 <= one <= MOST_DIMENSION for one in dims):
        raise GraphFault(f"has a constant of shape {one_line(str(dims), 60)}")
    return onnx.numpy_helper.to_array(tensor)


def _input_shape(onnx: Any, value: Any) -> Shape:
    kind = value.type.tensor_type
    dims = list(kind.shape.dim)
    if kind.elem_type != onnx.TensorProto.FLOAT or not 2 <= len(dims) <= 4:
        raise GraphFault("takes an input that is not float32 of shape (batch, features)")
    if dims[0].HasField("dim_value"):
        raise GraphFault(f"takes {dims[0].dim_value} observations at a time, not any number")
    shape = tuple(dim.dim_value for dim in dims[1:])
    if any(not 1 <= one <= MOST_DIMENSION for one in shape):
        raise GraphFault(f"takes observations of shape {shape}")
    return shape


def _session(onnxruntime: Any, model: Any, source: str) -> Any:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4  # what is wrong comes as an exception
    try:
        return onnxruntime.InferenceSession(
            model.SerializeToString(), options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:  # its exceptions have no common class
        raise UserError(
            f"{source} can't be run by onnxruntime: {one_line(str(error))}; export it again"
        ) from error


class _Runner:
    """A session that is called with at most `ROWS` observations at a time."""

    def __init__(self, session: Any, names: tuple[str, str], shape: Shape, source: str) -> None:
        self._session, self._shape, self._source = session, shape, source
        self._input, self._output = names

    def actions(self, batch: Float32[np.ndarray, "batch feature"], _best: bool) -> np.ndarray:
        """Return the actions of a network whose output is the action."""
        return self._outputs(batch).reshape(-1)

    def actions_of_floats(
        self, batch: Float32[np.ndarray, "batch feature"], _best: bool
    ) -> np.ndarray:
        """Return the actions of a network whose output is a continuous action."""
        return self._outputs(batch)

    def best(self, batch: Float32[np.ndarray, "batch feature"], _best: bool) -> np.ndarray:
        """Return the best action of a network whose output is scores; of equal ones the first."""
        scores = self._outputs(batch)
        if not np.isfinite(scores).all():
            raise UserError(f"{self._source} answered NaN or infinity: name a sound network")
        return scores.argmax(axis=1)

    def _outputs(self, batch: np.ndarray) -> np.ndarray:
        rows = batch.reshape(-1, *self._shape)
        parts = [rows[start : start + ROWS] for start in range(0, len(rows), ROWS)]
        try:
            made = [self._session.run([self._output], {self._input: part})[0] for part in parts]
            return np.concatenate(made)
        except Exception as error:  # its exceptions have no common class
            raise UserError(f"{self._source} failed: {one_line(str(error))}") from error
