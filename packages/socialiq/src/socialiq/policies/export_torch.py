"""Export of policies as PyTorch modules, and of their weights under PyTorch's names."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import safetensors.numpy

from socialiq.foreign import optional
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.ensemble import EnsemblePolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.view import View

Exported = QPolicy | EnsemblePolicy | ActorPolicy
"""Policies that are exported."""


def as_torch_module(policy: Exported) -> Any:
    """Return the policy's network as a `torch.nn.Module` of (batch, features), float32.

    It gives Q values, whose greedy action is `argmax(dim=1)`; of an actor the deterministic action
    in [-1, 1]. Its weights are copies and can be trained.

    Args:
        policy: Any policy or ensemble; of a dial, `DialPolicy.at` gives the policy at an angle.

    Raises:
        UserError: If PyTorch is not installed.
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

    Args:
        policy: Any policy or ensemble.
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
