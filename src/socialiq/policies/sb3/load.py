"""Policies of Stable-Baselines3, read from its zip with neither it nor torch, unpickling nothing.

The zip holds `policy.pth`, the tensors (see `state_dict`), and `data`, the rest (see `sb3_words`).
The members with optimizer states are never opened.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.nn.q_policy import QPolicy
from socialiq.policies.interface import Interface
from socialiq.policies.sb3.archive import Archive
from socialiq.policies.sb3.config import Words, read_words
from socialiq.policies.sb3.state_dict import read_state_dict

MOST_WORDS = 8 * 1024 * 1024
MOST_NETWORK = 32 * 1024 * 1024

_HIDDEN = {"DQN": "q_net.q_net", "actor-critic": "mlp_extractor.policy_net"}
_LAST = "action_net"  # of an actor-critic; a DQN's is the last of its hidden ones
_UNUSED = {
    "DQN": re.compile(r"q_net_target\.q_net\.\d+\.(weight|bias)"),
    "actor-critic": re.compile(r"(mlp_extractor\.value_net\.\d+|value_net)\.(weight|bias)"),
}
"""Tensors that have no part in choosing an action."""


def read_sb3(
    content: bytes, source: str, world: Interface
) -> tuple[QPolicy | EpsilonGreedy, dict[str, Any]]:
    """A policy from the bytes of a zip.

    Deterministic, it takes the best action as Stable-Baselines3's `predict` does. Else a DQN
    explores with the rate that it had when it was saved, and PPO and A2C draw from the softmax
    over their outputs.

    Args:
        content: The file.
        source: How messages call it.
        world: What the policy has to fit.

    Returns:
        The policy, and what the file tells about it.

    Raises:
        UserError: If the file is damaged, holds another kind of policy, or one for another world.
    """
    archive = Archive(content, source)
    words = read_words(archive.read("data", MOST_WORDS), source)
    words.interface.check(source, world)
    tensors = read_state_dict(archive.read("policy.pth", MOST_NETWORK), f"{source}, policy.pth")
    layers = _layers(tensors, words, source)
    weights = tuple(tensors[f"{layer}.weight"] for layer in layers)
    biases = tuple(tensors[f"{layer}.bias"] for layer in layers)
    _check_sizes(weights, biases, words.interface, source)
    network = QPolicy(weights, biases, words.activation, 1.0)
    details = {
        "algorithm": words.algorithm,
        "activation": words.activation,
        "layers": [words.interface.n_features, *(len(bias) for bias in biases)],
    }
    if words.algorithm == "DQN":
        return EpsilonGreedy(network, words.epsilon), details | {"epsilon": words.epsilon}
    return network, details


def _layers(tensors: Mapping[str, np.ndarray], words: Words, source: str) -> list[str]:
    """Names of the layers in order; Stable-Baselines3 numbers them 0, 2, 4, between activations."""
    hidden, unused = _HIDDEN[words.algorithm], _UNUSED[words.algorithm]
    used = {name for name in tensors if not unused.fullmatch(name)}
    count = sum(name.startswith(f"{hidden}.") for name in used) // 2
    layers = [f"{hidden}.{2 * number}" for number in range(count)]
    layers += [_LAST] if words.algorithm == "actor-critic" else []
    expected = {f"{layer}.{part}" for layer in layers for part in ("weight", "bias")}
    for name in sorted(used ^ expected):
        fault = "holds" if name in used else "lacks"
        raise UserError(
            f"{source} {fault} the tensor {one_line(name, 60)}, so it is no plain MLP: export the "
            "policy to ONNX"
        )
    if not layers:
        raise UserError(f"{source} holds no layer: save the policy again")
    return layers


def _check_sizes(
    weights: Sequence[np.ndarray], biases: Sequence[np.ndarray], interface: Interface, source: str
) -> None:
    inputs = interface.n_features
    for number, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        if weight.ndim != 2 or bias.shape != weight.shape[:1] or weight.shape[1] != inputs:
            raise UserError(
                f"{source} has a layer {number} of weights {weight.shape} and biases {bias.shape} "
                f"over {inputs} inputs: save the policy again"
            )
        if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
            raise UserError(
                f"{source} has NaN or infinity in layer {number}: name a policy of a sound training"
            )
        inputs = len(bias)
    if inputs != interface.n_actions:
        raise UserError(
            f"{source} has {inputs} outputs for {interface.n_actions} actions: save the policy "
            "again"
        )


@dataclass(frozen=True)
class EpsilonGreedy:
    """The best action, or with probability ε one drawn evenly from all.

    Stable-Baselines3 throws one coin for all observations of a call; here every observation has
    its own, so that episodes don't depend on the batch. Of a single observation the distribution
    is the same.

    Attributes:
        greedy: Says what is best.
        epsilon: ε, in [0, 1].
        rng: Source of the draws.
    """

    greedy: QPolicy
    epsilon: float
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def probabilities(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Probability of each action."""
        best = self.greedy.q_values(observations).argmax(axis=1)
        n_actions = self.greedy.n_actions
        return (1.0 - self.epsilon) * np.eye(n_actions)[best] + self.epsilon / n_actions

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose actions for one observation, shape (features,), or a batch (batch, features).

        Raises:
            UserError: If an observation has another length or is not finite.
        """
        best, state = self.greedy.predict(observation, state, episode_start)
        if deterministic:
            return best, state
        explores = self.rng.random(best.shape) < self.epsilon
        drawn = self.rng.integers(self.greedy.n_actions, size=best.shape)
        return np.where(explores, drawn, best), state
