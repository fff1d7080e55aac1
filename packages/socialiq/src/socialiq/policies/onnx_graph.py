"""Rules for ONNX graphs of policies: each observation is processed alone, in bounded memory.

Every value of the graph is either constant or one array for each observation. The rules below
follow the arrays' shapes from operator to operator, so that no operator can mix the observations of
a batch, and no value can grow beyond bounds. The last value is known to be actions or a score of
each.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from socialiq.foreign import one_line

MOST_NODES = 5_000
MOST_DIMENSION = 16_384
MOST_PER_ROW = 131_072
"""Numbers that all values of one observation have together."""
MOST_PRODUCTS = 16_777_216
"""Multiplications for one observation."""

_NAME = re.compile(r"[A-Za-z0-9_./:\-]{1,200}")

Shape = tuple[int, ...]


class GraphFault(Exception):
    """Fault of a graph, in words that follow "the graph"."""


@dataclass
class Values:
    """Values of a graph that have been defined."""

    constants: dict[str, np.ndarray] = field(default_factory=dict)  # by name
    rows: dict[str, Shape] = field(default_factory=dict)  # shape for one observation, by name
    products: int = 0  # multiplications so far, for one observation
    single: bool = False  # whether the graph takes one observation at a time

    def name(self, name: str) -> str:
        """Return a name after a check that it is new and has usual characters."""
        if not _NAME.fullmatch(name):
            raise GraphFault(f"has a name with strange characters, {one_line(name, 40)!r}")
        if name in self.constants or name in self.rows:
            raise GraphFault(f"defines {name} twice")
        return name

    def row(self, name: str) -> Shape:
        """Return the shape of a value for one observation."""
        if name not in self.rows:
            raise GraphFault(
                f"reads {one_line(name, 40)!r} where a value of the observation must be"
            )
        return self.rows[name]

    def vector(self, name: str) -> int:
        """Return the length of a value that is a vector for one observation."""
        shape = self.row(name)
        if len(shape) != 1:
            raise GraphFault(f"needs {name} flattened, but it has shape {shape}")
        return shape[0]

    def constant(self, name: str) -> np.ndarray:
        """Return a constant."""
        if name not in self.constants:
            raise GraphFault(f"reads {one_line(name, 40)!r} where a constant must be")
        return self.constants[name]

    def add_constant(self, name: str, value: np.ndarray) -> None:
        """Define a constant.

        Args:
            name: Its name.
            value: Finite numbers, of at most two axes.

        Raises:
            GraphFault: If the name is taken or unusual, or the value is not such an array.
        """
        if value.ndim > 2 or max(value.shape, default=0) > MOST_DIMENSION:
            raise GraphFault(f"has a constant of shape {value.shape}")
        if value.dtype.kind not in "fib" or not np.isfinite(value).all():
            raise GraphFault("has a constant that is not a finite number")
        self.constants[self.name(name)] = value

    def add_row(self, name: str, shape: Shape) -> None:
        """Define a value that depends on the observation.

        Args:
            name: Its name.
            shape: Its shape for one observation.

        Raises:
            GraphFault: If the name is taken or unusual, or the values are more than `MOST_PER_ROW`
                numbers.
        """
        self.rows[self.name(name)] = shape
        if sum(map(math.prod, self.rows.values())) > MOST_PER_ROW:
            raise GraphFault(f"makes more than {MOST_PER_ROW:,} numbers of one observation")


Attributes = Mapping[str, Any]
Rule = Callable[[Values, Sequence[str], Attributes], Shape]


def follow(values: Values, operator: str, inputs: Sequence[str], attributes: Attributes) -> Shape:
    """Return the shape of an operator's output for one observation.

    Args:
        values: Values of the graph so far; the number of multiplications is added up in them.
        operator: Name of the operator.
        inputs: Names of its inputs.
        attributes: Attributes of the operator.

    Raises:
        GraphFault: If the operator is unknown, or its inputs or attributes break its rule.
    """
    if operator not in OPERATORS:
        raise GraphFault(
            f"uses the operator {one_line(operator, 40)}; known are {', '.join(sorted(OPERATORS))}"
        )
    rule, least, most = OPERATORS[operator]
    if not least <= len(inputs) <= most:
        raise GraphFault(f"gives {operator} {len(inputs)} inputs")
    return rule(values, inputs, attributes)


def _same(values: Values, inputs: Sequence[str], _attributes: Attributes) -> Shape:
    return values.row(inputs[0])


def _along(values: Values, inputs: Sequence[str], attributes: Attributes) -> Shape:
    """Return the shape of an operator along a vector; the default axis differs by version."""
    length = values.vector(inputs[0])
    if attributes.get("axis", 1) not in (1, -1):
        raise GraphFault("works across the observations of a batch")
    return (length,)


def _arg_max(values: Values, inputs: Sequence[str], attributes: Attributes) -> Shape:
    values.vector(inputs[0])
    if attributes.get("axis", 0) not in (1, -1):
        raise GraphFault("takes ArgMax across the observations of a batch")
    return (1,) if attributes.get("keepdims", 1) else ()


def _elementwise(values: Values, inputs: Sequence[str], _attributes: Attributes) -> Shape:
    shapes = [values.rows[name] for name in inputs if name in values.rows]
    if not shapes:
        raise GraphFault("computes with constants alone: let the exporter fold them")
    shape = max(shapes)
    for other in shapes:  # one number of each observation may go with its vector
        if other not in (shape, (1,) * len(shape)):
            raise GraphFault(f"combines values of shapes {other} and {shape}")
    for name in inputs:
        if name not in values.rows:
            _check_broadcast(values.constant(name).shape, shape)
    return shape


def _clip(values: Values, inputs: Sequence[str], _attributes: Attributes) -> Shape:
    """Return the shape of values between two numbers, either of which may be left out."""
    if any(values.constant(name).size != 1 for name in inputs[1:] if name):
        raise GraphFault("clips by bounds that are not one number each")
    return values.row(inputs[0])


def _normalise(values: Values, inputs: Sequence[str], attributes: Attributes) -> Shape:
    shape = (values.vector(inputs[0]),)
    if attributes.get("axis", -1) not in (1, -1):
        raise GraphFault("normalises across the observations of a batch")
    for name in inputs[1:]:
        _check_broadcast(values.constant(name).shape, shape)
    return shape


def _batch_normalise(values: Values, inputs: Sequence[str], attributes: Attributes) -> Shape:
    """Return the shape of a vector that is normalised by constants, as after training."""
    shape = (values.vector(inputs[0]),)
    if attributes.get("training_mode", 0):
        raise GraphFault("normalises by the batch's own mean: call eval() before the export")
    if any(values.constant(name).shape != shape for name in inputs[1:]):
        raise GraphFault(f"normalises {shape[0]} numbers by constants of another length")
    return shape


def _reduce(values: Values, inputs: Sequence[str], attributes: Attributes) -> Shape:
    """Return the shape of one number of each vector; the axis is an attribute, or an input."""
    values.vector(inputs[0])
    axes = list(attributes.get("axes", []))
    axes += values.constant(inputs[1]).ravel().tolist() if inputs[1:] else []
    if axes not in ([1], [-1]) or not attributes.get("keepdims", 1):
        raise GraphFault("reduces more than a vector's numbers to one: keep their dimension")
    return (1,)


def _check_broadcast(constant: Shape, row: Shape) -> None:
    """Refuse a constant that changes the shape; along the batch it may only repeat."""
    padded = (1,) * (len(row) + 1 - len(constant)) + constant
    fits = len(padded) == len(row) + 1 and padded[0] == 1
    if not fits or any(a not in (1, b) for a, b in zip(padded[1:], row, strict=True)):
        raise GraphFault(f"combines a constant of shape {constant} with values of {row}")


def _mat_mul(values: Values, inputs: Sequence[str], _attributes: Attributes) -> Shape:
    return _product(values, values.vector(inputs[0]), values.constant(inputs[1]))


def _gemm(values: Values, inputs: Sequence[str], attributes: Attributes) -> Shape:
    if attributes.get("transA", 0):
        raise GraphFault("transposes the batch")
    weight = values.constant(inputs[1])
    weight = weight.T if attributes.get("transB", 0) else weight
    shape = _product(values, values.vector(inputs[0]), weight)
    if len(inputs) == 3:
        _check_broadcast(values.constant(inputs[2]).shape, shape)
    return shape


def _product(values: Values, length: int, weight: np.ndarray) -> Shape:
    if weight.ndim != 2 or weight.shape[0] != length:
        raise GraphFault(f"multiplies {length} numbers by weights of shape {weight.shape}")
    values.products += weight.size
    if values.products > MOST_PRODUCTS:
        raise GraphFault(f"takes more than {MOST_PRODUCTS:,} multiplications for one observation")
    return (weight.shape[1],)


def _concat(values: Values, inputs: Sequence[str], attributes: Attributes) -> Shape:
    if attributes.get("axis") not in (1, -1):
        raise GraphFault("puts the observations of a batch together")
    return (sum(values.vector(name) for name in inputs),)


def _gather(values: Values, inputs: Sequence[str], attributes: Attributes) -> Shape:
    length = values.vector(inputs[0])
    places = values.constant(inputs[1])
    if attributes.get("axis", 0) not in (1, -1):
        raise GraphFault("picks among the observations of a batch")
    if places.ndim != 1 or places.dtype.kind != "i" or not len(places):
        raise GraphFault("picks by numbers that are not a list of integers")
    if places.min() < 0 or places.max() >= length:
        raise GraphFault(f"picks number {places.max()} or less than 0 of {length}")
    return (len(places),)


def _flatten(values: Values, inputs: Sequence[str], attributes: Attributes) -> Shape:
    if attributes.get("axis", 1) != 1:
        raise GraphFault("flattens the batch")
    return (math.prod(values.row(inputs[0])),)


def _reshape(values: Values, inputs: Sequence[str], attributes: Attributes) -> Shape:
    row = values.row(inputs[0])
    target = values.constant(inputs[1])
    shape = tuple(target.ravel().tolist()[1:])
    if shape.count(-1) == 1 and target[0] != -1:  # the rest of one observation
        size = math.prod(row) // max(-math.prod(shape), 1)
        shape = tuple(size if length == -1 else length for length in shape)
    # A 0 stands for the batch only where zeros aren't meant as such; -1 always does, since the
    # other dimensions are checked to hold one observation.
    batch = (-1,) if attributes.get("allowzero", 0) else (-1, 0)
    batch = (*batch, 1) if values.single else batch
    free = target.ndim == 1 and len(target) > 0 and target[0] in batch
    if not free or any(size < 1 for size in shape):
        raise GraphFault("reshapes the batch: its first new dimension must be -1 or 0")
    if len(shape) > 3 or math.prod(shape) != math.prod(row):
        raise GraphFault(f"reshapes {row} to {shape}")
    return shape


OPERATORS: Mapping[str, tuple[Rule, int, int]] = {
    **dict.fromkeys(("Relu", "Tanh", "Elu", "Sigmoid", "LeakyRelu"), (_same, 1, 1)),
    **dict.fromkeys(("Selu", "Celu", "Softplus", "Softsign", "Erf", "Gelu"), (_same, 1, 1)),
    **dict.fromkeys(("HardSigmoid", "HardSwish", "Mish"), (_same, 1, 1)),
    **dict.fromkeys(("Identity", "Cast", "Abs", "Neg", "Exp", "Sqrt"), (_same, 1, 1)),
    **dict.fromkeys(("Softmax", "LogSoftmax"), (_along, 1, 1)),
    **dict.fromkeys(("Add", "Sub", "Mul", "Div"), (_elementwise, 2, 2)),
    **dict.fromkeys(("Equal", "Pow"), (_elementwise, 2, 2)),
    **dict.fromkeys(("Max", "Min"), (_elementwise, 1, MOST_NODES)),
    **dict.fromkeys(("ReduceMean", "ReduceMax", "ReduceSum"), (_reduce, 1, 2)),
    "Clip": (_clip, 1, 3),
    "BatchNormalization": (_batch_normalise, 5, 5),
    "LayerNormalization": (_normalise, 2, 3),
    "ArgMax": (_arg_max, 1, 1),
    "Concat": (_concat, 1, MOST_NODES),
    "Gather": (_gather, 2, 2),
    "MatMul": (_mat_mul, 2, 2),
    "Gemm": (_gemm, 2, 3),
    "Flatten": (_flatten, 1, 1),
    "Reshape": (_reshape, 2, 2),
}
"""Rule, fewest and most inputs of every operator that a policy may use, beside Constant."""
