"""Policies of Stable-Baselines3, read from its zip without that library, torch or unpickling.

The zip holds `policy.pth`, the tensors (see `state_dict`), and `data`, the rest (see `config`).
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
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.policies.interface import Interface
from socialiq.policies.sb3_config import Sb3Config, read_config
from socialiq.policies.sb3_tensors import Archive, read_state_dict

MOST_WORDS = 8 * 1024 * 1024
MOST_NETWORK = 32 * 1024 * 1024

_HIDDEN = {
    "DQN": "q_net.q_net",
    "actor-critic": "mlp_extractor.policy_net",
    "SAC": "actor.latent_pi",
    "TD3": "actor.mu",
}
_LAST = {"actor-critic": "action_net", "SAC": "actor.mu"}  # a DQN's is the last of its hidden ones
_UNUSED = {
    "DQN": re.compile(r"q_net_target\.q_net\.\d+\.(weight|bias)"),
    "actor-critic": re.compile(r"(mlp_extractor\.value_net\.\d+|value_net)\.(weight|bias)"),
    "SAC": re.compile(r"(critic|critic_target)\.qf\d+\.\d+\.(weight|bias)"),
    "TD3": re.compile(r"((critic|critic_target)\.qf\d+|actor_target\.mu)\.\d+\.(weight|bias)"),
}
"""Tensors that are not used to choose an action."""


def read_sb3(
    content: bytes, source: str, world: Interface
) -> tuple[QPolicy | EpsilonGreedy | ActorPolicy, dict[str, Any]]:
    """Load a policy from the bytes of a zip.

    If deterministic, it takes the best action, as `predict` of Stable-Baselines3 does. Otherwise a
    DQN explores at the rate that it had when it was saved, and PPO and A2C draw from the softmax
    over their outputs. With continuous actions it draws from the policy's Gaussian, if it has one;
    actions are in [-1, 1], the ends being the bounds of the action space.

    Args:
        content: The file.
        source: Its name in messages.
        world: The interface that the policy must have.

    Returns:
        The policy, and details from the file.

    Raises:
        UserError: If the file is damaged, holds another kind of policy, or one for another world.
    """
    archive = Archive(content, source)
    config = read_config(archive.read("data", MOST_WORDS), source)
    config.interface.check(source, world)
    tensors = read_state_dict(archive.read("policy.pth", MOST_NETWORK), f"{source}, policy.pth")
    deviations = _take_deviations(tensors, config, source)
    layers = _layers(tensors, config, source)
    weights = tuple(tensors[f"{layer}.weight"] for layer in layers)
    biases = tuple(tensors[f"{layer}.bias"] for layer in layers)
    _check_sizes(weights, biases, config.interface, source)
    details = {
        "algorithm": config.algorithm,
        "activation": config.activation,
        "layers": [config.interface.n_features, *(len(bias) for bias in biases)],
    }
    if config.interface.action_size:
        return _actor(weights, biases, deviations, config), details
    network = QPolicy(weights, biases, config.activation, 1.0)
    if config.algorithm == "DQN":
        return EpsilonGreedy(network, config.epsilon), details | {"epsilon": config.epsilon}
    return network, details


def _layers(tensors: Mapping[str, np.ndarray], config: Sb3Config, source: str) -> list[str]:
    """Return the names of the layers in order; they are numbered 0, 2, 4, between activations."""
    hidden, unused = _HIDDEN[config.algorithm], _UNUSED[config.algorithm]
    used = {name for name in tensors if not unused.fullmatch(name)}
    count = sum(name.startswith(f"{hidden}.") for name in used) // 2
    layers = [f"{hidden}.{2 * number}" for number in range(count)]
    layers += [_LAST[config.algorithm]] if config.algorithm in _LAST else []
    expected = {f"{layer}.{kind}" for layer in layers for kind in ("weight", "bias")}
    for name in sorted(used ^ expected):
        fault = "holds" if name in used else "lacks"
        raise UserError(
            f"{source} {fault} the tensor {one_line(name, 60)}, so it is not a plain MLP: export "
            "the policy to ONNX"
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
                f"{source} has NaN or infinity in layer {number}: name a policy whose "
                "training was stable"
            )
        inputs = len(bias)
    outputs = interface.action_size or interface.n_actions
    if inputs != outputs:
        what = "numbers of an action" if interface.action_size else "actions"
        raise UserError(
            f"{source} has {inputs} outputs for {outputs} {what}: save the policy again"
        )


def _take_deviations(
    tensors: dict[str, np.ndarray], config: Sb3Config, source: str
) -> tuple[np.ndarray, np.ndarray] | None:
    """Remove the layer of log-deviations from the tensors of a continuous policy, and return it.

    PPO's are one number for each of an action's, whatever is observed: a layer of weights 0.
    """
    size = config.interface.action_size
    if not size or config.algorithm == "TD3":
        return None
    names = ["log_std"]
    if config.algorithm == "SAC":
        names = ["actor.log_std.weight", "actor.log_std.bias"]
    *weights, bias = (tensors.pop(name, np.zeros(0)) for name in names)
    if bias.shape != (size,) or not all(np.isfinite(array).all() for array in (*weights, bias)):
        raise UserError(f"{source} has no sound deviations of its actions: save the policy again")
    if weights:
        return weights[0], bias
    last = tensors.get("action_net.weight", np.zeros((size, 0)))
    return np.zeros((size, *last.shape[1:]), np.float32), bias


def _actor(
    weights: tuple[np.ndarray, ...],
    biases: tuple[np.ndarray, ...],
    deviations: tuple[np.ndarray, np.ndarray] | None,
    config: Sb3Config,
) -> ActorPolicy:
    """Return the policy of continuous actions; PPO's, in other units and clipped, are scaled."""
    mean, bias = weights[-1], biases[-1]
    if config.bounds is not None and deviations is not None:
        low, high = np.array(config.bounds, np.float32)
        half = (high - low) / 2.0
        mean, bias = mean / half[:, None], (bias - (high + low) / 2.0) / half
        deviations = deviations[0], deviations[1] - np.log(half)
    if deviations is not None:
        mean, bias = np.vstack([mean, deviations[0]]), np.append(bias, deviations[1])
    return ActorPolicy(
        (*weights[:-1], mean.astype(np.float32)),
        (*biases[:-1], bias.astype(np.float32)),
        config.activation,
        config.interface.action_size,
        squash="tanh" if config.bounds is None else "clip",
    )


@dataclass(frozen=True)
class EpsilonGreedy:
    """Policy that takes the best action, or with probability ε a uniformly random one.

    Stable-Baselines3 draws once for all observations of a call; here every observation has its own
    draw, so that episodes do not depend on the batch. For a single observation the distribution is
    the same.

    Attributes:
        greedy: Chooses the best action.
        epsilon: ε, in [0, 1].
        rng: Source of the draws.
    """

    greedy: QPolicy
    epsilon: float
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def probabilities(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Return the probability of each action."""
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
        random = self.rng.integers(self.greedy.n_actions, size=best.shape)
        return np.where(explores, random, best), state
