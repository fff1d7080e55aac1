"""ONNX policies act as onnxruntime has them act; crafted ones are refused before it sees them."""

import dataclasses
import hashlib
import json
import os
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("onnx", reason="extra `onnx` is not installed")
pytest.importorskip("onnxruntime", reason="extra `onnx` is not installed")

import onnxruntime
from onnx import TensorProto, helper, numpy_helper

from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.evaluation.episodes import episodes_of
from socialiq.policies.interface import MOST_BYTES
from socialiq.policies.load import load_policy
from socialiq.policies.onnx_load import ROWS
from socialiq.reading import sha256_of_file
from socialiq.worlds.intersection.world import Intersection

EXAMPLES = Path(__file__).parents[2] / "examples" / "policies"
RANDOM = np.random.default_rng(0)
OBSERVATIONS = RANDOM.normal(size=(10_000, 6)).astype(np.float32)
W, B = RANDOM.normal(size=(6, 3)).astype(np.float32), RANDOM.normal(size=3).astype(np.float32)
BIG = RANDOM.normal(size=(6, 256)).astype(np.float32)

Node = helper.make_node


def model(
    nodes, shape=("batch", 6), outputs=(("y", TensorProto.FLOAT, ["batch", 3]),), **constants
):
    arrays = {"w": W, "b": B} | constants
    return helper.make_model(
        helper.make_graph(
            nodes,
            "policy",
            [helper.make_tensor_value_info("x", TensorProto.FLOAT, shape)],
            [helper.make_tensor_value_info(*one) for one in outputs],
            [numpy_helper.from_array(array, name) for name, array in arrays.items()],
        ),
        opset_imports=[helper.make_opsetid("", 17)],
        ir_version=8,
    )


GEMM = Node("Gemm", ["x", "w", "b"], ["y"])
INT64, FLOAT = TensorProto.INT64, TensorProto.FLOAT
TARGET = numpy_helper.from_array(np.array([-1, 6]))
ACTIONS = (("y", INT64, ["batch"]),)
Z = (("z", INT64, ["batch"]),)


@pytest.fixture
def read(tmp_path):
    def loaded(made, n_features=6, n_actions=3):
        path = tmp_path / "p.onnx"
        path.write_bytes(made if isinstance(made, bytes) else made.SerializeToString())
        return load_policy(str(path), n_features, n_actions)

    return loaded


@pytest.fixture
def refused(read):
    def check(made, match, **world):
        with pytest.raises(UserError, match=match) as caught:
            read(made, **world)
        assert "\n" not in str(caught.value) and len(str(caught.value)) < 500

    return check


def outputs(made, observations):
    session = onnxruntime.InferenceSession(
        made.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    return np.asarray(session.run(["y"], {"x": observations})[0])


HIDDEN = [
    Node("MatMul", ["x", "big"], ["h"]),
    Node("Tanh", ["h"], ["a"]),
    Node("Gemm", ["a", "last", "b"], ["z"], transB=1, alpha=0.5),
]
LAST = {"big": BIG, "last": RANDOM.normal(size=(3, 256)).astype(np.float32)}


@pytest.mark.parametrize("end", ["Identity", "Softmax", "LogSoftmax", "Elu", "LeakyRelu"])
def test_actions_are_the_best_of_onnxruntimes_scores(read, end):
    made = model([*HIDDEN, Node(end, ["z"], ["y"])], **LAST)
    found, _ = read(made).policy.predict(OBSERVATIONS)
    np.testing.assert_array_equal(found, outputs(made, OBSERVATIONS).argmax(axis=1))
    assert len(np.unique(found)) == 3


@pytest.mark.parametrize("keepdims", [0, 1])
def test_network_may_answer_actions(read, keepdims):
    end = Node("ArgMax", ["z"], ["y"], axis=1, keepdims=keepdims)
    shape = ["batch", 1] if keepdims else ["batch"]
    made = model([*HIDDEN, end], outputs=(("y", INT64, shape),), **LAST)
    loaded = read(made)
    np.testing.assert_array_equal(
        loaded.policy.predict(OBSERVATIONS)[0], outputs(made, OBSERVATIONS).reshape(-1)
    )
    assert loaded.record.details["answers"] == "actions"


def test_file_names_its_sizes_itself(read):
    assert read(model([GEMM]), None, None).record == read(model([GEMM])).record
    gemm = Node("Gemm", ["x", "w", "b"], ["actions"])
    continuous = model([gemm], outputs=(("actions", FLOAT, ["batch", 3]),))
    assert read(continuous, None, None).record.interface[:3] == (6, 0, 3)
    integers = model([GEMM, Node("ArgMax", ["y"], ["z"], axis=1, keepdims=0)], outputs=Z)
    with pytest.raises(UserError, match="whole numbers, of any range: give n_features and n_act"):
        read(integers, None, None)


def test_tables_of_vehicles_are_flattened_by_the_graph(read):
    for nodes in (
        [Node("Flatten", ["x"], ["f"])],
        [Node("Constant", [], ["s"], value=TARGET), Node("Reshape", ["x", "s"], ["f"])],
        # As torch.onnx.export writes torch.nn.Flatten.
        [
            Node("Constant", [], ["s"], value=TARGET),
            Node("Reshape", ["x", "s"], ["f"], allowzero=1),
        ],
    ):
        made = model([*nodes, Node("Gemm", ["f", "w", "b"], ["y"])], shape=("batch", 2, 3))
        np.testing.assert_array_equal(
            read(made).policy.predict(OBSERVATIONS)[0],
            outputs(made, OBSERVATIONS.reshape(-1, 2, 3)).argmax(axis=1),
        )


def test_answer_does_not_depend_on_the_batch(read):
    policy = read(model([GEMM])).policy
    whole, _ = policy.predict(OBSERVATIONS[: 2 * ROWS + 1])
    single = [int(policy.predict(one)[0]) for one in OBSERVATIONS[:50]]
    assert whole[:50].tolist() == single and len(whole) == 2 * ROWS + 1


def test_of_several_outputs_the_one_named_actions_counts(read, refused):
    nodes = [GEMM, Node("ArgMax", ["y"], ["actions"], axis=1, keepdims=0)]
    both = (("y", FLOAT, ["batch", 3]), ("actions", INT64, ["batch"]))
    found, _ = read(model(nodes, outputs=both)).policy.predict(OBSERVATIONS)
    np.testing.assert_array_equal(found, outputs(model([GEMM]), OBSERVATIONS).argmax(axis=1))
    other = [GEMM, Node("Relu", ["y"], ["value"])]
    twice = (both[0], ("value", FLOAT, ["batch", 3]))
    refused(model(other, outputs=twice), "has 2 outputs and none is named actions")


def external(made, location="weights", **words):
    """The model with its first tensor's numbers in another file."""
    tensor = made.graph.initializer[0]
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    for key, value in {"location": str(location), **words}.items():
        entry = tensor.external_data.add()
        entry.key, entry.value = key, value
    return made


def test_weights_beside_the_file_are_read_and_hashed(read, tmp_path):
    weights = tmp_path / "weights"
    weights.write_bytes(bytes(8) + W.tobytes() + bytes(4))
    words = {"offset": "8", "length": str(W.nbytes)}
    loaded = read(external(model([GEMM]), **words))
    np.testing.assert_array_equal(
        loaded.policy.predict(OBSERVATIONS)[0], outputs(model([GEMM]), OBSERVATIONS).argmax(axis=1)
    )
    digests = "".join(f"{sha256_of_file(tmp_path / name)}\n" for name in ("p.onnx", "weights"))
    assert loaded.record.sha256 == hashlib.sha256(digests.encode()).hexdigest()
    assert loaded.record.covers == "the file's bytes, and those of weights"
    weights.rename(tmp_path / "kept")
    weights.symlink_to("kept")
    assert read(external(model([GEMM]), **words)).record.sha256 == loaded.record.sha256
    weights.write_bytes(bytes(8) + (-W).tobytes() + bytes(4))
    assert read(external(model([GEMM]), **words)).record.sha256 != loaded.record.sha256


def test_weights_of_a_constant_and_to_the_end_of_a_file_are_read(read, tmp_path):
    (tmp_path / "weights").write_bytes(W.tobytes())
    tensor = external(model([GEMM])).graph.initializer[0]
    nodes = [Node("Constant", [], ["c"], value=tensor), Node("Gemm", ["x", "c", "b"], ["y"])]
    np.testing.assert_array_equal(
        read(model(nodes)).policy.predict(OBSERVATIONS)[0],
        outputs(model([GEMM]), OBSERVATIONS).argmax(axis=1),
    )


@pytest.mark.parametrize(
    "location",
    ["/etc/passwd", "../weights", "folder/weights", "..", "", "c:weights", "a\nb", "x" * 300],
)
def test_weights_outside_of_the_folder_are_never_read(refused, tmp_path, location):
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "weights").write_bytes(W.tobytes())
    refused(external(model([GEMM]), location), "no file of its own folder.*external_data=False")


def test_weights_through_a_link_or_of_another_kind_of_file_are_never_read(refused, tmp_path):
    refused(external(model([GEMM])), "weights, which is not beside it.*external_data=False")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "weights").write_bytes(W.tobytes())
    (tmp_path / "weights").symlink_to("folder/weights")
    refused(external(model([GEMM])), "weights, a link that leaves its folder")
    os.mkfifo(tmp_path / "pipe")
    refused(external(model([GEMM]), "pipe"), "is not a regular file")


@pytest.mark.parametrize(
    "words",
    [
        {"length": "9" * 30},
        {"length": "71"},
        {"offset": "-1", "length": "72"},
        {"offset": "1", "length": "72"},
        {"offset": "1"},
        {"offset": "9" * 18, "length": "72"},
        {"offset": "0x0"},
    ],
)
def test_ranges_that_the_file_does_not_hold_are_refused(refused, tmp_path, words):
    (tmp_path / "weights").write_bytes(W.tobytes())
    refused(external(model([GEMM]), **words), "tensor of 72 bytes that weights does not hold")


def test_size_of_weights_beside_the_file_is_bounded(refused, tmp_path):
    (tmp_path / "weights").touch()
    os.truncate(tmp_path / "weights", MOST_BYTES + 1)
    refused(external(model([GEMM])), "weights is larger than 33,554,432 bytes")
    os.truncate(tmp_path / "weights", MOST_BYTES)
    made = model([GEMM])
    tensor = external(made, offset="0", length=str(MOST_BYTES)).graph.initializer[0]
    del tensor.dims[:]
    tensor.dims.extend([MOST_BYTES // 4])
    for number in range(100):  # all of one file's bytes, once more each
        made.graph.initializer.add().CopyFrom(tensor)
        made.graph.initializer[-1].name = f"w{number}"
    refused(made, "weights of more than 33,554,432 bytes")
    refused(external(model([GEMM]), basepath="/etc"), "external data with basepath")


def test_identity_of_a_constant_and_batch_normalisation_are_followed(read, refused):
    names = ("scale", "shift", "mean", "variance")
    constants = {name: RANDOM.random(6).astype(np.float32) + 0.5 for name in names}
    normal = Node("BatchNormalization", ["x", *names], ["n"], epsilon=0.1)
    nodes = [Node("Identity", ["w"], ["same"]), normal, Node("Gemm", ["n", "same", "b"], ["y"])]
    made = model(nodes, **constants)
    found, _ = read(made).policy.predict(OBSERVATIONS)
    np.testing.assert_array_equal(found, outputs(made, OBSERVATIONS).argmax(axis=1))
    assert len(np.unique(found)) == 3
    short = constants | {"mean": np.ones(1, np.float32)}
    refused(model(nodes, **short), "normalises 6 numbers by constants of another length")
    nodes[1] = Node("BatchNormalization", ["x", *names], ["n"], training_mode=1)
    refused(model(nodes, **constants), "the batch's own mean: call eval")


def test_sparse_initialisers_and_functions_are_refused(refused):
    made = model([GEMM])
    made.graph.sparse_initializer.add().dims.append(3)
    refused(made, "sparse initialisers")
    made = model([GEMM])
    made.functions.add().name = "f"
    refused(made, "functions")


def test_sub_graphs_and_custom_domains_are_refused(refused):
    inner = helper.make_graph([], "inner", [], [])
    both = {"then_branch": inner, "else_branch": inner}
    refused(model([Node("If", ["x"], ["y"], **both)]), "reads 'x' where a constant must be")
    yes = numpy_helper.from_array(np.array(True), "yes")
    constant = Node("Constant", [], ["yes"], value=yes)
    refused(model([constant, Node("If", ["yes"], ["y"], **both)]), "an If of several outputs")
    refused(model([Node("If", ["w"], ["y"], **both)]), "an If that depends on the observation")
    refused(model([Node("Scan", ["x"], ["y"], body=inner, num_scan_inputs=1)]), "sub-graph")
    refused(model([Node("Gemm", ["x", "w"], ["y"], domain="evil")]), "domain 'evil'")
    made = model([GEMM])
    made.opset_import.append(helper.make_opsetid("com.microsoft", 1))
    refused(made, "domain 'com.microsoft'")


def test_other_operators_and_wrong_uses_are_refused(refused):
    refused(model([Node("Sin", ["x"], ["y"])]), "uses the operator Sin")
    refused(model([Node("ArgMax", ["x"], ["y"], axis=0)], outputs=ACTIONS), "across the obs")
    refused(model([GEMM, GEMM]), "defines y twice")
    refused(model([Node("Relu", ["x"], ["<script>"])]), "strange characters")
    refused(model([Node("Split", ["x"], ["y", "z"])]), "several outputs")
    refused(model([Node("Constant", [], ["y"], value_float=1.0)]), "Constant that is not a tensor")
    refused(model([]), "reads 'y'")


def test_sizes_must_fit_the_world(refused):
    refused(model([GEMM]), "takes 6 features and 3 actions, the world has 70 and 3", n_features=70)
    refused(model([GEMM]), "the world has 6 and 4", n_actions=4)
    refused(model([Node("Gemm", ["x", "w"], ["y"])], w=W.T.copy()), "multiplies 6 numbers")
    narrow = model([Node("ArgMax", ["x"], ["z"], axis=1), Node("Cast", ["z"], ["y"], to=FLOAT)])
    refused(narrow, "the world has 6 and 3")
    grid = model([Node("Relu", ["x"], ["y"])], shape=("batch", 2, 3))
    refused(grid, r"scores of shape \(2, 3\)")
    vector = model([Node("Cast", ["x"], ["y"], to=INT64)], outputs=(("y", INT64, ["batch", 6]),))
    refused(vector, r"whole numbers of shape \(6,\)")


def test_inputs_must_be_observations(refused):
    refused(model([GEMM], shape=(2, 6)), "takes 2 observations at a time, neither one nor any")
    refused(model([GEMM], shape=(6,)), "not float32 of shape")
    refused(model([GEMM], shape=("batch", "features")), "takes observations of shape")
    refused(model([GEMM], shape=("batch", -6)), "takes observations of shape")
    refused(model([GEMM], shape=("batch", 2**40)), "takes observations of shape")
    made = model([GEMM])
    made.graph.input.append(helper.make_tensor_value_info("z", FLOAT, ["batch", 6]))
    refused(made, "has 2 inputs")
    made = model([GEMM])
    made.graph.input[0].type.tensor_type.elem_type = TensorProto.STRING
    refused(made, "not float32 of shape")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_weights_must_be_finite(refused, value):
    refused(model([GEMM], b=np.array([0, value, 0], np.float32)), "not a finite number")


def test_scores_must_be_finite(read):
    made = model([Node("Gemm", ["x", "w", "b"], ["z"]), Node("Mul", ["z", "z"], ["y"])])
    with pytest.raises(UserError, match="answered NaN or infinity"):
        read(made).policy.predict(np.full(6, 1e30, np.float32))


def test_absurd_dimensions_cost_nothing(refused):
    for dims in ([2**40, 2**40], [-6, 3], [2**31, 3], [6, 3, 1]):
        made = model([GEMM])
        made.graph.initializer[0].dims[:] = dims
        refused(made, "has a constant of shape")
    made = model([GEMM])
    made.graph.initializer[0].dims[:] = [6, 4_000]
    refused(made, "is damaged")


def test_truncated_and_foreign_files_are_refused(refused):
    whole = model([GEMM]).SerializeToString()
    for content in (b"", whole[:-1], whole[:40], b"\x00" * 100, b"ORTM" * 10):
        refused(content, "damaged|has field|inputs")


def test_types_that_do_not_go_together_are_refused_by_onnxruntime(refused):
    refused(model([GEMM], b=np.array([1, 2, 3], np.int64)), "can't be run by onnxruntime")


def test_what_a_file_claims_about_its_values_is_not_believed(read):
    made = model([*HIDDEN, Node("Identity", ["z"], ["y"])], **LAST)
    made.graph.value_info.append(helper.make_tensor_value_info("h", FLOAT, [1, 2**40]))
    made.metadata_props.add(key="ort_config", value='{"session_options": {"enable_profiling": 1}}')
    found, _ = read(made).policy.predict(OBSERVATIONS[:20])
    assert found.shape == (20,)


def test_example_is_the_network_of_the_other_example(tmp_path, monkeypatch):
    onnx_policy = load_policy(str(EXAMPLES / "dqn_intersection.onnx"), 70, 3).policy
    zip_policy = load_policy(str(EXAMPLES / "dqn_intersection.zip"), 70, 3).policy
    seen = RANDOM.normal(size=(10_000, 70)).astype(np.float32)
    np.testing.assert_array_equal(onnx_policy.predict(seen)[0], zip_policy.predict(seen)[0])
    paths = [str(EXAMPLES / "dqn_intersection.zip"), str(tmp_path / "p.onnx")]
    monkeypatch.setattr(sys, "argv", ["to_onnx.py", *paths])
    runpy.run_path(str(EXAMPLES / "to_onnx.py"), run_name="__main__")
    made = load_policy(paths[1], 70, 3).policy
    np.testing.assert_array_equal(made.predict(seen)[0], onnx_policy.predict(seen)[0])


def test_an_audit_of_the_intersection_asks_for_hundreds_of_actions_at_once():
    policy = load_policy(str(EXAMPLES / "dqn_intersection.onnx"), 70, 3).policy
    asked = []

    def counted(observations, *more):
        asked.append(len(observations))
        return policy.decide(observations, *more)

    counting = dataclasses.replace(policy, decide=counted)
    episodes = episodes_of(Intersection().batch(512), counting, np.arange(5_000))
    assert np.mean(asked) > 256
    assert len(episodes.ending) == 5_000 and (episodes.ending > 0).all()


@pytest.mark.parametrize("part", range(5))
def test_files_with_changed_bytes_are_read_or_refused(read, part):
    content = model([*HIDDEN, Node("Identity", ["z"], ["y"])], **LAST).SerializeToString()
    structure = [place for place in range(len(content)) if not 400 < place < len(content) - 400]
    refused = 0
    for seed in range(part * 60, part * 60 + 60):
        random, made = np.random.default_rng(seed), bytearray(content)
        for place in random.choice(structure, 2):
            made[place] = random.integers(256)
        try:
            read(bytes(made)).policy.predict(OBSERVATIONS[:3])
        except UserError as error:
            refused += 1
            assert "\n" not in str(error)
    assert refused


def agrees(read, made, single=False):
    loaded = read(made)
    rows = OBSERVATIONS[:500]
    pieces = np.split(rows, len(rows)) if single else [rows]
    expected = np.concatenate([outputs(made, piece) for piece in pieces]).argmax(axis=1)
    np.testing.assert_array_equal(loaded.policy.predict(rows)[0], expected)
    assert len(np.unique(expected)) > 1


def test_batch_of_one_is_asked_one_by_one(read):
    y = (("y", FLOAT, [1, 3]),)
    agrees(read, model([GEMM], (1, 6), y), single=True)
    target = np.array([1, -1])
    nodes = [Node("Reshape", ["x", "t"], ["z"]), Node("Gemm", ["z", "w", "b"], ["y"])]
    loaded = read(model(nodes, (1, 2, 3), y, t=target))
    expected = (OBSERVATIONS[:9] @ W + B).argmax(axis=1)
    np.testing.assert_array_equal(loaded.policy.predict(OBSERVATIONS[:9])[0], expected)


def test_rest_of_a_shape_is_inferred(read, refused):
    nodes = [Node("Reshape", ["x", "t"], ["z"]), Node("Gemm", ["z", "w", "b"], ["y"])]
    shape = ("batch", 2, 3)
    read(model(nodes, shape, t=np.array([0, -1])))
    refused(model(nodes, shape, t=np.array([1, -1])), "reshapes the batch")
    refused(model(nodes, shape, t=np.array([0, -1, -1])), "reshapes the batch")
    refused(model(nodes, shape, t=np.array([0, 4, -1])), "reshapes")


def test_clip_min_and_max_are_read(read, refused):
    low, high = np.array(-0.5, np.float32), np.array(0.7, np.float32)
    for bounds in (["z", "low", "high"], ["z", "", "high"], ["z", "low"], ["z"]):
        nodes = [Node("Clip", ["x", *bounds[1:]], ["z"]), Node("Gemm", ["z", "w", "b"], ["y"])]
        agrees(read, model(nodes, low=low, high=high))
    for operator in ("Min", "Max"):
        nodes = [Node("Gemm", ["x", "w", "b"], ["z"]), Node("Gemm", ["x", "v", "b"], ["u"])]
        agrees(read, model([*nodes, Node(operator, ["z", "u", "b"], ["y"])], v=-W))
    refused(model([Node("Clip", ["x", "b"], ["y"])]), "bounds that are not one number each")


def test_layer_normalisation_is_read(read, refused):
    scale, bias = RANDOM.normal(size=(2, 6)).astype(np.float32)
    constants = {"s": scale, "c": bias}
    for inputs in (["x", "s", "c"], ["x", "s"]):
        nodes = [Node("LayerNormalization", inputs, ["z"], axis=-1)]
        agrees(read, model([*nodes, Node("Gemm", ["z", "w", "b"], ["y"])], **constants))
    across = [Node("LayerNormalization", ["x", "s"], ["y"], axis=0)]
    refused(model(across, **constants), "normalises across the observations")


def test_dueling_heads_are_read(read, refused):
    heads = [
        Node("Gemm", ["x", "v", "one"], ["value"]),
        Node("Gemm", ["x", "w", "b"], ["advantage"]),
        Node("ReduceMean", ["advantage"], ["mean"], axes=[1], keepdims=1),
        Node("Sub", ["advantage", "mean"], ["beside"]),
        Node("Add", ["value", "beside"], ["y"]),
    ]
    constants = {"v": W[:, :1].copy(), "one": B[:1].copy()}
    agrees(read, model(heads, **constants))
    heads[2] = Node("ReduceMean", ["advantage"], ["mean"], axes=[0], keepdims=1)
    refused(model(heads, **constants), "reduces more than a vector's numbers")
    heads[2] = Node("ReduceMean", ["advantage"], ["mean"], axes=[1], keepdims=0)
    refused(model(heads, **constants), "keep their dimension")


@pytest.mark.parametrize("taken", [True, False])
def test_branch_that_is_never_taken_is_removed(read, taken):
    result = [helper.make_tensor_value_info("z", FLOAT, None)]
    good = helper.make_graph([Node("Gemm", ["x", "w", "c"], ["z"])], "good", [], result)
    good.initializer.append(numpy_helper.from_array(B, "c"))
    other = [helper.make_tensor_value_info("q", FLOAT, None)]
    bad = helper.make_graph([Node("Sin", ["x"], ["q"])], "bad", [], other)
    branches = (good, bad) if taken else (bad, good)
    condition = numpy_helper.from_array(np.array(taken), "yes")
    made = model(
        [
            Node("Constant", [], ["yes"], value=condition),
            Node("If", ["yes"], ["y"], then_branch=branches[0], else_branch=branches[1]),
        ]
    )
    loaded = read(made)
    expected = (OBSERVATIONS @ W + B).argmax(axis=1)
    np.testing.assert_array_equal(loaded.policy.predict(OBSERVATIONS)[0], expected)
    assert loaded.record.details["operators"] == ["Constant", "Gemm", "Identity"]


def test_evaluate_gives_an_example_as_zip_and_as_onnx_the_same_row(capsys):
    rows = []
    for kind in ("zip", "onnx"):
        words = [str(EXAMPLES / f"dqn_intersection.{kind}"), "--world", "intersection"]
        assert main(["evaluate", *words, "--episodes", "6", "--json"]) == 0
        rows.append(json.loads(capsys.readouterr().out))
    assert rows[0] == rows[1]
