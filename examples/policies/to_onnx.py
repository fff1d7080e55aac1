"""Writes a policy of this package, or one that it reads, as ONNX: one Gemm for each layer.

    pip install 'socialiq[onnx]'
    python examples/policies/to_onnx.py dqn_intersection.zip dqn_intersection.onnx

Networks of other libraries have exporters of their own; `torch.onnx.export` with a free batch and
`torch.flatten` before the first layer makes a file that the audit reads.
"""

from __future__ import annotations

import sys
from pathlib import Path

import onnx
from onnx import TensorProto, helper, numpy_helper

from socialiq.nn.q_policy import QPolicy
from socialiq.policies.load import load_policy
from socialiq.policies.sb3_load import EpsilonGreedy

N_FEATURES, N_ACTIONS = 70, 3  # of the intersection
OPERATORS = {"relu": "Relu", "elu": "Elu", "tanh": "Tanh"}
OPSET = 17


def to_onnx(policy: QPolicy) -> bytes:
    """The network that scores the actions; without a view, which would need more operators."""
    assert policy.view is None
    nodes, constants, value = [], [], "observation"
    for number, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
        if number:
            nodes.append(helper.make_node(OPERATORS[policy.activation], [value], [f"a{number}"]))
            value = f"a{number}"
        constants.append(numpy_helper.from_array(weight, f"weight{number}"))
        constants.append(numpy_helper.from_array(bias, f"bias{number}"))
        inputs = [value, f"weight{number}", f"bias{number}"]
        nodes.append(helper.make_node("Gemm", inputs, [f"z{number}"], transB=1))
        value = f"z{number}"
    seen = helper.make_tensor_value_info(
        "observation", TensorProto.FLOAT, ["batch", policy.n_features]
    )
    scores = helper.make_tensor_value_info(value, TensorProto.FLOAT, ["batch", policy.n_actions])
    graph = helper.make_graph(nodes, "policy", [seen], [scores], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8)
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString()


def main(source: str, target: str) -> None:
    """Read a policy of the intersection and write it."""
    policy = load_policy(source, N_FEATURES, N_ACTIONS).policy
    network = policy.greedy if isinstance(policy, EpsilonGreedy) else policy
    assert isinstance(network, QPolicy)
    Path(target).write_bytes(to_onnx(network))


if __name__ == "__main__":
    main(*sys.argv[1:])
