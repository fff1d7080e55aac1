"""A policy behind a perception front end: in Python, and as nodes of an ONNX graph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from socialiq.nn.q_policy import checked_batch, numbers_of
from socialiq.types import Policy
from socialiq.worlds.highway.perception import ROW, Arrays, FrontEnd

SENSED = "sensed"
MEMORY = "memory"
NEXT = "memory_after"
"""Names of a graph's inputs, and of the output that is the memory of the next decision."""


@dataclass(frozen=True)
class FrontEndPolicy:
    """A policy of a road behind a front end.

    Its state is the memory, float32 (batch, values), zeros where an episode begins.
    """

    policy: Policy
    front_end: FrontEnd
    n_features: int  # of the policy: an odd one behind whole rows of vehicles is the time
    remembers: ClassVar[bool] = True  # its memory is of each row of a batch

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose an action for an observation or each of a batch, as `types.Policy`.

        Raises:
            UserError: If an observation is nested, has another length or is not finite.
        """
        rows = checked_batch(np.atleast_2d(numbers_of(observation)), self.n_features)
        features = self.features
        memory = self.front_end.memory(len(rows), features) if state is None else state
        if episode_start is not None:
            memory = np.where(np.reshape(episode_start, (-1, 1)), np.float32(0.0), memory)
        estimate, memory = self.front_end.see(rows, memory, features)
        actions, _ = self.policy.predict(estimate, deterministic=deterministic)
        decided = np.reshape(actions, (len(rows), -1)).astype(np.float32)
        memory = self.front_end.decided(memory, decided, features)
        return (actions if np.ndim(observation) == 2 else actions.squeeze(axis=0)), memory

    @property
    def features(self) -> int:
        """Length of an observation without the time."""
        return self.n_features - self.n_features % ROW


def _arithmetic(operator: str, order: int = 1) -> Callable[[Any, Any], Node]:
    """Return the method of an operator; with the order -1 of its operand on the left."""

    def method(self: Node, operand: Any) -> Node:
        names = [self.name, name_of(self.graph, operand)]
        return node(self.graph, operator, names[::order])

    return method


class Node:
    """Value of a graph; arithmetic with it adds nodes."""

    __array_ufunc__ = None  # so that NumPy leaves arithmetic to this class

    def __init__(self, graph: Any, name: str) -> None:
        self.graph = graph
        self.name = name

    __add__ = __radd__ = _arithmetic("Add")
    __mul__ = __rmul__ = _arithmetic("Mul")
    __sub__ = _arithmetic("Sub")
    __rsub__ = _arithmetic("Sub", -1)
    __truediv__ = _arithmetic("Div")


def node(graph: Any, operator: str, inputs: Sequence[str], **attributes: Any) -> Node:
    """Add a node with a name that no other node has.

    Args:
        graph: The graph.
        operator: Name of the ONNX operator.
        inputs: Names of its inputs.
        **attributes: Attributes of the operator.

    Returns:
        The value of the node.
    """
    name = f"front_end.{len(graph.nodes)}"
    return Node(graph, graph.add(operator, list(inputs), name, **attributes))


def name_of(graph: Any, value: Any) -> str:
    """Return the name of a value in a graph.

    Args:
        graph: The graph.
        value: A value of the graph; or numbers, which are added as a constant. An array of integers
            keeps its type; all other numbers become float32.
    """
    if isinstance(value, Node):
        return value.name
    array = np.asarray(value)
    array = array if array.dtype.kind == "i" and array.ndim else array.astype(np.float32)
    return graph.constant(f"front_end.{array.dtype}.{array.shape}.{array.tobytes().hex()}", array)


class Nodes(Arrays):
    """The operations of a front end as nodes of a graph, `policies.export`'s."""

    def __init__(self, graph: Any) -> None:
        self._graph = graph

    def _add(self, operator: str, *inputs: Any, **attributes: Any) -> Node:
        names = [name_of(self._graph, value) for value in inputs]
        return node(self._graph, operator, names, **attributes)

    def part(self, array: Any, first: int, last: int) -> Node:
        """Return columns of the last axis.

        Args:
            array: The array.
            first: First column.
            last: Column after the last one.
        """
        ends = (np.array([value]) for value in (first, last, -1))
        return self._add("Slice", array, *ends)

    def joined(self, arrays: Sequence[Any], axis: int = -1) -> Node:
        """Return arrays end to end.

        Args:
            arrays: The arrays.
            axis: Axis along which they are joined.
        """
        return self._add("Concat", *arrays, axis=axis)

    def shaped(self, array: Any, *shape: int) -> Node:
        """Return an array with another shape.

        Args:
            array: The array.
            *shape: Lengths of the axes behind the axis for the batch.
        """
        return self._add("Reshape", array, np.array([-1, *shape]))

    def least(self, array: Any, axis: int) -> Node:
        """Return the minimum along an axis.

        Args:
            array: The array.
            axis: The axis, which stays with length 1.
        """
        return self._add("ReduceMin", array, axes=[axis], keepdims=1)

    def total(self, array: Any, axis: int) -> Node:
        """Return the sum along an axis.

        Args:
            array: The array.
            axis: The axis, which stays with length 1.
        """
        return self._add("ReduceSum", array, np.array([axis]), keepdims=1)

    def product(self, left: Any, right: Any) -> Node:
        """Return the product of matrices, the first of them transposed.

        Args:
            left: (batch, k, m).
            right: (batch, k, n).

        Returns:
            (batch, m, n).
        """
        return self._add("MatMul", self._add("Transpose", left, perm=[0, 2, 1]), right)

    def at_most(self, left: Any, right: Any) -> Node:
        """Return 1 where an array is at most another one, else 0, as float32.

        Args:
            left: The array.
            right: The array that limits it.
        """
        return self._add("Cast", self._add("LessOrEqual", left, right), to=1)

    def limited(self, array: Any, low: float, high: float) -> Node:
        """Return an array within limits.

        Args:
            array: The array.
            low: Lower limit.
            high: Upper limit.
        """
        return self._add("Clip", array, low, high)

    def rounded(self, array: Any) -> Node:
        """Return the nearest whole numbers, halves to the even one."""
        return self._add("Round", array)

    def root(self, array: Any) -> Node:
        """Return the square root."""
        return self._add("Sqrt", array)

    def first(self, rows: Any, keys: Any, count: int) -> Node:
        """Return the rows of a batch with the smallest keys.

        Args:
            rows: (batch, row, value).
            keys: Key of each row, (batch, row).
            count: Number of rows to return.

        Returns:
            (batch, count, value), in the order of rising keys.
        """
        names = [name_of(self._graph, value) for value in (keys, np.array([count]))]
        number = f"front_end.{len(self._graph.nodes)}"
        self._graph.add("TopK", names, f"{number}.keys", f"{number}.order", largest=0)
        order = self._add("Unsqueeze", Node(self._graph, f"{number}.order"), np.array([2]))
        width = self._add("Shape", rows, start=2, end=3)
        ones = np.array([1, 1])
        order = self._add("Tile", order, self._add("Concat", ones, width, axis=0))
        return self._add("GatherElements", rows, order, axis=1)
