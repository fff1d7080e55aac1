import numpy as np
import pytest

from socialiq.policies.onnx_graph import (
    MOST_DIMENSION,
    MOST_PER_ROW,
    OPERATORS,
    GraphFault,
    Values,
    follow,
)


@pytest.fixture
def values():
    made = Values()
    made.add_row("x", (6,))
    made.add_row("image", (2, 3))
    made.add_row("number", ())
    for name, shape in {"w": (6, 4), "wt": (4, 6), "b": (4,), "c": (6,), "row": (1, 6)}.items():
        made.add_constant(name, np.ones(shape, np.float32))
    for name, target in {
        "flat": [-1, 6],
        "pair": [0, 3, 2],
        "one": [1, 6],
        "tall": [-1, 3],
    }.items():
        made.add_constant(name, np.array(target, np.int64))
    made.add_constant("places", np.array([5, 0, 5], np.int64))
    made.add_constant("beyond", np.array([0, 6], np.int64))
    made.add_constant("before", np.array([0, -1], np.int64))
    made.add_constant("none", np.zeros(0, np.int64))
    made.add_constant("many", np.ones((5, 6), np.float32))
    made.add_constant("scalar", np.array(2.0, np.float32))
    return made


@pytest.mark.parametrize(
    ("operator", "inputs", "attributes", "shape"),
    [
        ("Relu", ["image"], {}, (2, 3)),
        ("Cast", ["x"], {"to": 1}, (6,)),
        ("Softmax", ["x"], {"axis": 1}, (6,)),
        ("Softmax", ["x"], {}, (6,)),
        ("ArgMax", ["x"], {"axis": -1}, (1,)),
        ("ArgMax", ["x"], {"axis": 1, "keepdims": 0}, ()),
        ("Add", ["x", "c"], {}, (6,)),
        ("Div", ["row", "x"], {}, (6,)),
        ("Mul", ["scalar", "image"], {}, (2, 3)),
        ("Sub", ["x", "x"], {}, (6,)),
        ("MatMul", ["x", "w"], {}, (4,)),
        ("Gemm", ["x", "w", "b"], {}, (4,)),
        ("Gemm", ["x", "wt"], {"transB": 1}, (4,)),
        ("Flatten", ["image"], {}, (6,)),
        ("Reshape", ["image", "flat"], {}, (6,)),
        ("Reshape", ["image", "flat"], {"allowzero": 1}, (6,)),
        ("Reshape", ["x", "pair"], {}, (3, 2)),
        ("Max", ["x", "x"], {}, (6,)),
        ("Equal", ["x", "c"], {}, (6,)),
        ("Concat", ["x", "x", "x"], {"axis": 1}, (18,)),
        ("Concat", ["x"], {"axis": -1}, (6,)),
        ("Gather", ["x", "places"], {"axis": 1}, (3,)),
    ],
)
def test_shapes_are_followed(values, operator, inputs, attributes, shape):
    assert follow(values, operator, inputs, attributes) == shape


@pytest.mark.parametrize(
    ("operator", "inputs", "attributes", "match"),
    [
        ("Softmax", ["x"], {"axis": 0}, "across the observations"),
        ("ArgMax", ["x"], {}, "across the observations"),
        ("ArgMax", ["x"], {"axis": 0}, "across the observations"),
        ("Gemm", ["x", "w"], {"transA": 1}, "transposes the batch"),
        ("Flatten", ["x"], {"axis": 0}, "flattens the batch"),
        ("Flatten", ["x"], {"axis": 2}, "flattens the batch"),
        ("Reshape", ["x", "one"], {}, "reshapes the batch"),
        ("Reshape", ["x", "pair"], {"allowzero": 1}, "reshapes the batch"),
        ("Reshape", ["x", "tall"], {}, "reshapes"),
        ("Reshape", ["x", "c"], {}, "reshapes the batch"),
        ("Add", ["x", "many"], {}, "combines a constant of shape"),
        ("Add", ["number", "c"], {}, "combines a constant of shape"),
        ("Add", ["x", "b"], {}, "combines a constant of shape"),
        ("Add", ["x", "image"], {}, "combines values of shapes"),
        ("Add", ["c", "c"], {}, "with constants alone"),
        ("Max", ["x", "image"], {}, "combines values of shapes"),
        ("Equal", ["c", "c"], {}, "with constants alone"),
        ("Concat", ["x", "x"], {"axis": 0}, "puts the observations of a batch together"),
        ("Concat", ["x", "x"], {}, "puts the observations of a batch together"),
        ("Concat", ["x", "c"], {"axis": 1}, "where a value of the observation must be"),
        ("Concat", ["x", "image"], {"axis": 1}, "flattened"),
        ("Gather", ["x", "places"], {}, "picks among the observations"),
        ("Gather", ["x", "places"], {"axis": 0}, "picks among the observations"),
        ("Gather", ["x", "beyond"], {"axis": 1}, "picks number 6 or less"),
        ("Gather", ["x", "before"], {"axis": 1}, "less than 0 of 6"),
        ("Gather", ["x", "none"], {"axis": 1}, "not a list of integers"),
        ("Gather", ["x", "c"], {"axis": 1}, "not a list of integers"),
        ("Gather", ["x", "scalar"], {"axis": 1}, "not a list of integers"),
        ("Gather", ["x", "x"], {"axis": 1}, "where a constant must be"),
        ("Gather", ["w", "places"], {"axis": 1}, "where a value of the observation must be"),
        ("MatMul", ["x", "wt"], {}, "multiplies 6 numbers by weights"),
        ("MatMul", ["w", "x"], {}, "where a value of the observation must be"),
        ("MatMul", ["x", "x"], {}, "where a constant must be"),
        ("MatMul", ["image", "w"], {}, "needs image flattened"),
        ("Gemm", ["x", "w", "c"], {}, "combines a constant"),
        ("Relu", ["unknown"], {}, "reads 'unknown'"),
        ("Relu", ["x", "x"], {}, "gives Relu 2 inputs"),
        ("Relu", [], {}, "gives Relu 0 inputs"),
    ],
)
def test_what_would_mix_or_break_the_batch_is_refused(values, operator, inputs, attributes, match):
    with pytest.raises(GraphFault, match=match):
        follow(values, operator, inputs, attributes)


@pytest.mark.parametrize(
    "operator",
    ["If", "Loop", "Scan", "Expand", "Tile", "ConstantOfShape", "RandomNormal", "GatherND"],
)
def test_other_operators_are_refused(values, operator):
    with pytest.raises(GraphFault, match=f"uses the operator {operator}; known are Abs, Add"):
        follow(values, operator, ["x"], {})
    assert operator not in OPERATORS


@pytest.mark.parametrize("name", ["<script>", "a b", "", "x\n", "a'b", "\u202e", "x" * 201])
def test_names_are_plain(values, name):
    with pytest.raises(GraphFault, match="strange characters"):
        values.add_row(name, (1,))


def test_names_are_new(values):
    for name in ("x", "w"):
        with pytest.raises(GraphFault, match="twice"):
            values.add_row(name, (1,))
        with pytest.raises(GraphFault, match="twice"):
            values.add_constant(name, np.zeros(1))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_constants_are_finite(values, value):
    with pytest.raises(GraphFault, match="not a finite number"):
        values.add_constant("new", np.array([1.0, value]))


def test_constants_are_bounded(values):
    with pytest.raises(GraphFault, match="constant of shape"):
        values.add_constant("new", np.zeros((1, 1, 1)))
    with pytest.raises(GraphFault, match="constant of shape"):
        values.add_constant("new", np.zeros(MOST_DIMENSION + 1, np.int32))


def test_work_for_one_observation_is_bounded():
    values = Values()
    values.add_row("x", (MOST_DIMENSION,))
    values.add_constant("w", np.zeros((MOST_DIMENSION, 512), np.float32))
    for _ in range(2):
        follow(values, "MatMul", ["x", "w"], {})
    with pytest.raises(GraphFault, match="multiplications for one observation"):
        follow(values, "MatMul", ["x", "w"], {})


def test_memory_for_one_observation_is_bounded():
    values = Values()
    for number in range(MOST_PER_ROW // MOST_DIMENSION):
        values.add_row(f"x{number}", (MOST_DIMENSION,))
    with pytest.raises(GraphFault, match="numbers of one observation"):
        values.add_row("more", (1,))
