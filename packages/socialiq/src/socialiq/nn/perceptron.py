"""Multi-layer perceptron of a saved policy, in NumPy."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

ACTIVATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "relu": lambda x: np.maximum(x, 0.0),
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))),
    "tanh": np.tanh,  # for imported policies; this project's networks are trained with the others
}
"""Activations of a policy, by name."""


def perceptron(
    weights: Sequence[np.ndarray], biases: Sequence[np.ndarray], activation: str, value: np.ndarray
) -> np.ndarray:
    """Return the outputs of a batch, with the activation between the layers.

    Args:
        weights: Weight matrix of each layer, (outputs, inputs).
        biases: Bias of each layer.
        activation: Key of `ACTIVATIONS`.
        value: Inputs, (batch, inputs).
    """
    for number, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        if number:
            value = ACTIVATIONS[activation](value)
        value = value @ weight.T + bias
    return value
