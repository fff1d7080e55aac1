"""Whether a saved policy's header agrees with its arrays.

A file's checksum detects damage; it is not a signature, and anyone can make it again. So the
header is checked against the arrays before it is used.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from socialiq.nn.view import ROW, OneHot, row_width

MOST_LAYERS = 100
MOST_TIMES = 10_000
"""Values of the time that a view may tell apart."""

FAULTS = (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError)
"""Exceptions of a header that doesn't fit its arrays, when a policy is made of them."""


def fault_before(arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]) -> str:
    """Return what is wrong with a file's content before a policy is made of it, or "".

    Args:
        arrays: Arrays of the file.
        header: Its header.
    """
    layers = header.get("layers")
    if type(layers) is not int or not 1 <= layers <= MOST_LAYERS:
        return f"must have 1 to {MOST_LAYERS} layers"
    for array in arrays.values():
        if array.dtype.kind != "f" or not np.isfinite(array).all():
            return "has a weight that is not a finite number"
    return ""


def fault_of(policy: Any, activations: tuple[str, ...], extra: int) -> str:
    """Return what is wrong with a policy made of a file's content, or "".

    Args:
        policy: A `QPolicy`.
        activations: Known activations.
        extra: Inputs of the first layer that are not part of the observation.
    """
    known = policy.activation in activations and isinstance(policy.provenance, dict)
    temperature = policy.temperature
    warm = isinstance(temperature, float) and 0.0 < temperature < float("inf")
    consistent = known and warm and view_is_possible(policy.view)
    # Before anything is computed with them: widths that a header claims could be of any size.
    if consistent:
        width = policy.view.width if policy.view else policy.weights[0].shape[1] - extra
        consistent = width > 0 and chained(policy.weights, policy.biases, width + extra)
    return "" if consistent else "has layers that don't follow one another"


def view_is_possible(view: Any) -> bool:
    """Whether a view's numbers are ones that `View` and `OneHot` produce."""
    if view is None:
        return True
    if isinstance(view, OneHot):
        return len(view.lows) == len(view.sizes) and all(
            type(low) is int and type(size) is int and size > 0
            for low, size in zip(view.lows, view.sizes, strict=True)
        )
    pooled, relative, scale, ahead = view.choice
    plain = isinstance(scale, float) and all(type(one) is bool for one in (pooled, relative, ahead))
    plain = plain and (relative or not ahead)
    if not (type(view.n_features) is int and type(view.times) is int):
        return False
    listed = view.n_features - bool(view.times)
    rows = listed % ROW == 0 and listed > ROW and 0 <= view.times <= MOST_TIMES
    if not (plain and rows and np.isfinite(scale) and pooled == bool(view.weights)):
        return False
    inputs = row_width(view.choice)
    encoded = (view.width - view.times - (ROW - 1)) // 2 if pooled else 0
    return not pooled or (
        chained(view.weights, view.biases, inputs) and len(view.biases[-1]) == encoded
    )


def chained(weights: tuple[Any, ...], biases: tuple[Any, ...], inputs: int) -> bool:
    """Return whether each layer takes what the one before it gives, the first so many inputs."""
    for weight, bias in zip(weights, biases, strict=True):
        if weight.ndim != 2 or bias.shape != weight.shape[:1] or weight.shape[1] != inputs:
            return False
        inputs = len(bias)
    return inputs > 0
