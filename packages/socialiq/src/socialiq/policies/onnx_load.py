"""Policies in ONNX: checked field by field and operator by operator, then run by onnxruntime.

In Protocol Buffers, messages of two bytes each can ask for millions of objects, so fields are
counted on the wire before any library parses the file. onnxruntime evaluates the graph because the
policy's author tests with it. It gets the checked model, serialised again, never the file itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.policies import onnx_graph
from socialiq.policies.interface import BatchPolicy, Interface
from socialiq.policies.onnx_data import DATA_FILES, sha256_of_parts, with_data
from socialiq.policies.onnx_graph import GraphFault, Shape, Values

ROWS = 1_024
"""Observations of one call; larger batches are split, so that memory stays bounded."""

MOST_FIELDS = 20_000
"""Fields of a file, nested ones too."""

IR_VERSION = 10
"""Newest version of ONNX's file format that is passed to onnxruntime."""

_NEEDED_BY = "ONNX policies"
_DOMAINS = ("", "ai.onnx")
_ACTIONS = "actions"


def read_onnx(
    content: bytes, source: str, world: Interface | None, folder: Path
) -> tuple[BatchPolicy, dict[str, Any], str]:
    """Return a policy from the bytes of an ONNX file, details, and the hash of what was read.

    Its input is float32, (batch, ...), the batch free or 1. Its output is a score for each action,
    of which it always takes the best, or the action itself. Of several outputs the one named
    "actions" is read.

    Args:
        content: Bytes of the file.
        source: Name of the file in messages.
        world: Interface of the world; None for the one that the file names.
        folder: Folder of the file, where files with weights may lie.

    Returns:
        The policy; its operators, the kind of its answers, and the names of further files; the
        SHA-256 of all files (`onnx_data.sha256_of_parts`).

    Raises:
        UserError: If the file is damaged, does more than `onnx_graph` allows, or is made for
            another world, or the extra `onnx` is missing.
    """
    onnx, onnxruntime = (optional(name, "onnx", _NEEDED_BY) for name in ("onnx", "onnxruntime"))
    check_fields(content, source)
    try:
        model = onnx.ModelProto.FromString(content)
        data = with_data(onnx, model, folder, source)
        inputs, shape, operators = _checked(onnx, model)
    except UserError:
        raise
    except GraphFault as fault:
        raise UserError(f"{source}: the graph {fault}; export a plain network") from fault
    except Exception as error:  # the libraries' exceptions have no common class
        raise UserError(f"{source} is damaged or not an ONNX file: export it again") from error
    n_features = math.prod(inputs)
    output = model.graph.output[0]
    session = _session(onnxruntime, model, source)
    integers = session.get_outputs()[0].type in ("tensor(int64)", "tensor(int32)")
    if integers and shape not in ((), (1,)):
        raise UserError(f"{source} answers whole numbers of shape {shape}: it must be one action")
    if not integers and len(shape) != 1:
        raise UserError(f"{source} answers scores of shape {shape}: it must be one of each action")
    if world is None:
        world = _named_interface(source, n_features, shape, output.name, integers)
    if world.action_size and integers:
        raise UserError(f"{source} answers whole numbers: this world takes continuous actions")
    if not world.action_size and not integers and output.name == _ACTIONS:
        raise UserError(
            f"{source} answers continuous actions: this world's are discrete; an output of scores "
            f"has another name than {_ACTIONS}"
        )
    answers = "scores"
    sizes = shape[0] if shape else 0, 0
    if world.action_size:
        answers = "continuous actions"
        sizes = 0, shape[0]
    elif integers:
        answers = "actions"
        sizes = world.n_actions, 0
    interface = Interface(n_features, *sizes)
    interface.check(source, world)
    names = [model.graph.input[0].name, output.name]
    at_once = 1 if model.graph.input[0].type.tensor_type.shape.dim[0].dim_value else ROWS

    def decide(batch: Float32[np.ndarray, "batch feature"], _deterministic: bool) -> np.ndarray:
        outputs = _run(session, names, batch.reshape(-1, *inputs), at_once, source)
        if answers != "scores":
            return outputs.reshape(-1) if integers else outputs
        if not np.isfinite(outputs).all():
            raise UserError(f"{source} answered NaN or infinity: name a sound network")
        return outputs.argmax(axis=1)  # of equal ones the first

    details: dict[str, Any] = {"operators": operators, "answers": answers}
    details |= {DATA_FILES: list(data)} if data else {}
    return BatchPolicy(source, interface, decide), details, sha256_of_parts(content, data)


def _named_interface(
    source: str, n_features: int, shape: tuple[int, ...], output: str, integers: bool
) -> Interface:
    """Return the interface of a world that fits the file: scores, or continuous actions."""
    if integers:
        raise UserError(
            f"{source} answers whole numbers, of any range: give n_features and n_actions"
        )
    continuous = output == _ACTIONS
    return Interface(n_features, *((0, shape[0]) if continuous else (shape[0], 0)))


def _checked(onnx: Any, model: Any) -> tuple[Shape, Shape, list[str]]:
    """Return the shapes of input and output for one observation, and the operators used."""
    graph = model.graph
    values = Values()
    for used in model.opset_import:
        _check_domain(used.domain)
    for tensor in graph.initializer:
        values.add_constant(tensor.name, _array(onnx, tensor))
    free = [value for value in graph.input if value.name not in values.constants]
    if len(free) != 1:
        raise GraphFault(f"has {len(free)} inputs, not one")
    kind = free[0].type.tensor_type
    dims = list(kind.shape.dim)
    if kind.elem_type != onnx.TensorProto.FLOAT or not 2 <= len(dims) <= 4:
        raise GraphFault("takes an input that is not float32 of shape (batch, features)")
    values.single = dims[0].HasField("dim_value")
    if values.single and dims[0].dim_value != 1:
        raise GraphFault(
            f"takes {dims[0].dim_value} observations at a time, neither one nor any number"
        )
    inputs = tuple(dim.dim_value for dim in dims[1:])
    if any(not 1 <= size <= onnx_graph.MOST_DIMENSION for size in inputs):
        raise GraphFault(f"takes observations of shape {inputs}")
    values.add_row(free[0].name, inputs)
    _check_nodes(onnx, graph, values)
    outputs = [value for value in graph.output if value.name == _ACTIONS or len(graph.output) == 1]
    if len(outputs) != 1:
        raise GraphFault(f"has {len(graph.output)} outputs and none is named {_ACTIONS}")
    shape = values.row(outputs[0].name)
    for listed, value in ((graph.input, free[0]), (graph.output, outputs[0])):
        copy = type(value)()
        copy.CopyFrom(value)
        del listed[:]
        listed.append(copy)
    # Shapes that the file claims, and settings that onnxruntime could take from it, are not needed.
    del graph.value_info[:], model.metadata_props[:]
    # Versions of the file format add fields, and which fields there are is checked: an older
    # onnxruntime can read what is left.
    model.ir_version = min(model.ir_version, IR_VERSION)
    return inputs, shape, sorted({node.op_type for node in graph.node})


def _check_nodes(onnx: Any, graph: Any, values: Values) -> None:
    """Follow the values from node to node; an If is replaced by its branch."""
    nodes: list[Any] = []
    waiting = list(reversed(graph.node))
    while waiting:
        node = waiting.pop()
        nodes.append(node)
        if len(nodes) > onnx_graph.MOST_NODES:
            raise GraphFault(f"has more than {onnx_graph.MOST_NODES:,} nodes")
        _check_domain(node.domain)
        get = onnx.helper.get_attribute_value
        attributes = {attribute.name: get(attribute) for attribute in node.attribute}
        if len(node.output) != 1 or len(attributes) != len(node.attribute):
            raise GraphFault(f"has a {one_line(node.op_type, 40)} of several outputs")
        if node.op_type == "If":
            waiting += _branch(onnx, graph, values, nodes.pop(), attributes)
        elif node.op_type == "Identity" and node.input[:1] and node.input[0] in values.constants:
            values.add_constant(node.output[0], values.constants[node.input[0]])
        elif any(attribute.HasField("g") for attribute in node.attribute):
            raise GraphFault(f"has a sub-graph in a {one_line(node.op_type, 40)}")
        elif node.op_type != "Constant":
            shape = onnx_graph.follow(values, node.op_type, node.input, attributes)
            values.add_row(node.output[0], shape)
        elif list(attributes) != ["value"] or node.attribute[0].type != onnx.AttributeProto.TENSOR:
            raise GraphFault("has a Constant that is not a tensor")
        else:
            values.add_constant(node.output[0], _array(onnx, attributes["value"]))
    checked = type(graph)(node=nodes)
    del graph.node[:]
    graph.node.extend(checked.node)


def _branch(
    onnx: Any, graph: Any, values: Values, node: Any, attributes: Mapping[str, Any]
) -> list[Any]:
    """Return the nodes of the branch of an If that its constant takes, the first one last."""
    condition = values.constant(node.input[0]) if node.input else np.zeros(0)
    if condition.dtype.kind != "b" or condition.size != 1:
        raise GraphFault("has an If that depends on the observation")
    branch = attributes["then_branch" if condition.item() else "else_branch"]
    if len(branch.output) != 1 or branch.input:
        raise GraphFault("has an If of several outputs")
    for tensor in branch.initializer:
        values.add_constant(tensor.name, _array(onnx, tensor))
        graph.initializer.append(tensor)
    end = onnx.helper.make_node("Identity", [branch.output[0].name], list(node.output))
    return [end, *reversed(branch.node)]


def _check_domain(domain: str) -> None:
    if domain not in _DOMAINS:
        raise GraphFault(f"uses operators of the domain {one_line(domain, 40)!r}")


def _array(onnx: Any, tensor: Any) -> np.ndarray:
    """Return a constant's numbers; its shape is checked before they are unpacked."""
    numbers = (onnx.TensorProto.FLOAT, onnx.TensorProto.INT64, onnx.TensorProto.INT32)
    kinds = (*numbers, onnx.TensorProto.BOOL)
    dims = tuple(tensor.dims)
    if tensor.data_type not in kinds:
        raise GraphFault("has a constant that is not float32, int64, int32 or bool")
    if len(dims) > 2 or any(not 0 <= size <= onnx_graph.MOST_DIMENSION for size in dims):
        raise GraphFault(f"has a constant of shape {one_line(str(dims), 60)}")
    return onnx.numpy_helper.to_array(tensor)


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


def _run(session: Any, names: list[str], rows: np.ndarray, size: int, source: str) -> np.ndarray:
    """Return a session's outputs, of a limited number of observations at a time."""
    pieces = [rows[start : start + size] for start in range(0, len(rows), size)]
    try:
        return np.concatenate([session.run(names[1:], {names[0]: piece})[0] for piece in pieces])
    except Exception as error:  # its exceptions have no common class
        raise UserError(f"{source} failed: {one_line(str(error))}") from error


# Fields that a policy may have, by their numbers in onnx.proto. Any other (sparse initialisers,
# functions, sub-graphs) refuses the file.
_LEAF = None
_Message = Mapping[int, "_Message | None"]

_ENTRY: _Message = {1: _LEAF, 2: _LEAF}  # StringStringEntryProto, OperatorSetIdProto
_DIMENSION: _Message = {1: _LEAF, 2: _LEAF, 3: _LEAF}
_TENSOR_TYPE: _Message = {1: _LEAF, 2: {1: _DIMENSION}}
_TYPE: _Message = {1: _TENSOR_TYPE, 6: _LEAF}
_VALUE: _Message = {1: _LEAF, 2: _TYPE, 3: _LEAF, 4: _ENTRY}
_TENSOR: _Message = dict.fromkeys((1, 2, 4, 5, 7, 8, 9, 10, 12, 14), _LEAF) | {13: _ENTRY}
_ATTRIBUTE: dict[int, _Message | None] = {
    **dict.fromkeys((1, 2, 3, 4, 7, 8, 13, 20), _LEAF),
    5: _TENSOR,
}
_NODE: _Message = dict.fromkeys((1, 2, 3, 4, 6, 7), _LEAF) | {5: _ATTRIBUTE, 9: _ENTRY}
_GRAPH: dict[int, _Message | None] = {
    1: _NODE,
    2: _LEAF,
    5: _TENSOR,
    10: _LEAF,
    16: _ENTRY,
    **dict.fromkeys((11, 12, 13), _VALUE),
}
_ATTRIBUTE[6] = _GRAPH  # of an If whose branch is known
_MODEL: _Message = dict.fromkeys(range(1, 7), _LEAF) | {7: _GRAPH, 8: _ENTRY, 14: _ENTRY}

_REFUSED = {
    ("graph", 15): "sparse initialisers",
    ("attribute", 11): "sub-graphs",
    ("attribute", 22): "sparse tensors",
    ("model", 20): "training steps",
    ("model", 25): "functions",
}
_NAMES = {id(_TENSOR): "tensor", id(_GRAPH): "graph", id(_ATTRIBUTE): "attribute"}
_NAMES |= {id(_MODEL): "model", id(_NODE): "node"}


def check_fields(content: bytes, source: str) -> None:
    """Refuse a damaged file, and one with unknown or too many fields; cheap in time and memory.

    Raises:
        UserError: At the first such field, or where the file is damaged.
    """
    try:
        count = 0
        waiting = [(_MODEL, 0, len(content))]
        while waiting:
            message, position, end = waiting.pop()
            while position < end:
                key, begin = _varint(content, position)
                kind = key & 7
                if kind == 0:
                    _, after = _varint(content, begin)
                elif kind == 2:
                    length, begin = _varint(content, begin)
                    after = begin + length
                elif kind in (1, 5):
                    after = begin + (8 if kind == 1 else 4)
                else:
                    raise ValueError("group")
                if after > end:
                    raise ValueError("beyond the message")
                number = key >> 3
                position = after
                count += 1
                if count > MOST_FIELDS:
                    raise UserError(f"{source} has more than {MOST_FIELDS} fields: simplify it")
                if number not in message:
                    name = _NAMES.get(id(message), "type")
                    what = _REFUSED.get((name, number), f"field {number} of a {name}")
                    raise UserError(
                        f"{source} has {what}: export a plain network that holds its own weights"
                    )
                inner = message[number]
                if inner is not None:
                    waiting.append((inner, begin, position))
    except (IndexError, ValueError) as error:
        raise UserError(f"{source} is damaged or not an ONNX file: export it again") from error


def _varint(content: bytes, position: int) -> tuple[int, int]:
    """Return a number of at most ten bytes, and the position after it."""
    number = 0
    for count in range(10):
        byte = content[position + count]
        number |= (byte & 127) << (7 * count)
        if byte < 128:
            return number, position + count + 1
    raise ValueError("number of more than ten bytes")
