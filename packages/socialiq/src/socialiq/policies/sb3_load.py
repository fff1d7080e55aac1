"""Policies of Stable-Baselines3, read from its zip without that library, torch or unpickling.

The zip holds `policy.pth`, the tensors (see `sb3_tensors`), and `data`, the rest. The members with
optimizer states are never opened.

Stable-Baselines3 writes values that JSON cannot hold twice: as a base64 pickle under
`:serialized:`, and as plain text beside it, "to have an idea what was being stored"
(`common/save_util.py`). Loading the pickle would run its author's code, so only the plain text is
read. If the two differ, an audit is of the policy that is read here, not of the one that
Stable-Baselines3 would load.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.policies.interface import Interface
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
_MODULES = {
    "stable_baselines3.dqn.policies": "DQN",
    "stable_baselines3.common.policies": "actor-critic",
    "stable_baselines3.sac.policies": "SAC",
    "stable_baselines3.td3.policies": "TD3",
}
"""Modules of the policies' classes; PPO and A2C share theirs, and TD3 and DDPG."""

_DEFAULT_ACTIVATIONS = {"DQN": "relu", "actor-critic": "tanh", "SAC": "relu", "TD3": "relu"}
_ACTIVATIONS = {
    "<class 'torch.nn.modules.activation.ReLU'>": "relu",
    "<class 'torch.nn.modules.activation.Tanh'>": "tanh",
    "<class 'torch.nn.modules.activation.ELU'>": "elu",
}

# These do not change the output of a trained network.
_HARMLESS = {
    "activation_fn",
    "net_arch",
    "optimizer_class",
    "optimizer_kwargs",
    "ortho_init",
    "share_features_extractor",
    "normalize_images",  # no image passes: see `_features`
    "log_std_init",  # of continuous actions
    "n_critics",
}
_FLOATS = ("float32", "float64")
MOST_NUMBERS = 1000
"""Numbers of a continuous action."""


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
    config = _config(archive.read("data", MOST_WORDS), source)
    config.interface.check(source, world)
    tensors = read_state_dict(archive.read("policy.pth", MOST_NETWORK), f"{source}, policy.pth")
    deviations = _take_deviations(tensors, config, source)
    layers = _layers(tensors, config, source)
    weights = tuple(tensors[f"{layer}.weight"] for layer in layers)
    biases = tuple(tensors[f"{layer}.bias"] for layer in layers)
    sizes = [config.interface.n_features, *(len(bias) for bias in biases)]
    details = {"algorithm": config.algorithm, "activation": config.activation, "layers": sizes}
    if config.interface.action_size:
        return _actor(weights, biases, deviations, config), details
    network = QPolicy(weights, biases, config.activation, 1.0)
    if config.algorithm == "DQN":
        return EpsilonGreedy(network, config.epsilon), details | {"epsilon": config.epsilon}
    return network, details


class _Config(NamedTuple):
    """Configuration of a network.

    Attributes:
        algorithm: "DQN", "actor-critic", "SAC" or "TD3".
        activation: Between the layers.
        interface: Length of its observations, flattened row by row, and number of actions.
        epsilon: Share of random actions, of a DQN that is not deterministic.
        bounds: Lower and upper bound of each number of a continuous action; only of an
            actor-critic, whose actions are in the environment's units.
    """

    algorithm: str
    activation: str
    interface: Interface
    epsilon: float
    bounds: tuple[tuple[float, ...], tuple[float, ...]] | None = None


def _config(content: bytes, source: str) -> _Config:
    """Read the member `data`; `UserError` if the network's output would be ambiguous."""
    try:
        data = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise _refusal(source, "its member data is not JSON") from error
    if not isinstance(data, dict):
        raise _refusal(source, "its member data is not a JSON object")
    module = _object(data, "policy_class").get("__module__")
    if not isinstance(module, str) or module not in _MODULES:
        raise _refusal(source, f"its policy class is of {one_line(str(module), 60)}")
    algorithm = _MODULES[module]
    space, bounds = _object(data, "action_space"), None
    if algorithm != "DQN" and _is_space(space, "Box"):
        shape = space.get("_shape")
        size = shape[0] if isinstance(shape, list) and len(shape) == 1 else 0
        possible = type(size) is int and 1 <= size <= MOST_NUMBERS
        if not possible or space.get("dtype") not in _FLOATS:
            raise _refusal(source, "its actions are not one vector of floats")
        interface = Interface(_features(data, source), 0, size)
        if algorithm == "actor-critic":
            bounds = (_bound(space, "low", size, source), _bound(space, "high", size, source))
            if not all(low < high for low, high in zip(*bounds, strict=True)):
                raise _refusal(source, "the bounds of its actions are in no order")
    elif algorithm in ("SAC", "TD3"):
        raise _refusal(source, "its actions are not a Box")
    else:
        count, start = str(space.get("n")), str(space.get("start", 0))
        features = _features(data, source)
        if not _is_space(space, "Discrete") or start != "0":
            raise _refusal(source, "its actions are not Discrete from 0")
        if not (count.isascii() and count.isdigit() and len(count) < 6):
            raise _refusal(source, "its actions have no number")
        interface = Interface(features, int(count))
    activation = _activation(data, algorithm, source)
    epsilon = data.get("exploration_rate", 0.0)
    number = isinstance(epsilon, int | float) and not isinstance(epsilon, bool)
    if not number or not 0.0 <= epsilon <= 1.0:
        raise _refusal(source, "its exploration_rate is not a share")
    return _Config(algorithm, activation, interface, float(epsilon), bounds)


def _refusal(source: str, fault: str) -> UserError:
    return UserError(
        f"{source}: {fault}; only DQN, PPO and A2C with an MLP, flat observations and discrete "
        "actions, and SAC, TD3 and PPO with a Box of them can be read, so export others to ONNX"
    )


def _object(data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    value = data.get(name)
    return value if isinstance(value, dict) else {}


def _is_space(space: Mapping[str, Any], kind: str) -> bool:
    libraries = ("gymnasium", "gym")
    names = [f"<class '{library}.spaces.{kind.lower()}.{kind}'>" for library in libraries]
    return space.get(":type:") in names


def _features(data: Mapping[str, Any], source: str) -> int:
    """Return the length of a flattened observation.

    Images are bytes, and Stable-Baselines3 divides those by 255; so only floats are certain to
    reach the network as they are.
    """
    space = _object(data, "observation_space")
    shape = space.get("_shape")
    if not _is_space(space, "Box") or space.get("dtype") not in _FLOATS:
        raise _refusal(source, "its observations are not a Box of float32 or float64")
    if not isinstance(shape, list) or any(type(size) is not int or size < 1 for size in shape):
        raise _refusal(source, "its observations have no shape")
    return math.prod(shape)


def _bound(space: Mapping[str, Any], name: str, size: int, source: str) -> tuple[float, ...]:
    """Return the bounds of an action, of the plain text of an array: long ones are cut short."""
    text = str(space.get(name)).strip("[]").split()
    try:
        numbers = tuple(map(float, text))
    except ValueError:
        numbers = ()
    if len(numbers) != size or not all(map(math.isfinite, numbers)):
        raise _refusal(source, f"the bounds of its actions ({name}) can't be read")
    return numbers


def _activation(data: Mapping[str, Any], algorithm: str, source: str) -> str:
    options = data.get("policy_kwargs")
    if not isinstance(options, dict):
        raise _refusal(source, "it has no policy_kwargs")
    if data.get("use_sde", False) is not False:
        raise _refusal(source, "it explores by gSDE")
    for name, value in options.items():
        plain = (
            name in _HARMLESS
            or (name == "use_sde" and value is False)
            or name in (":type:", ":serialized:")
        )
        flat = name == "features_extractor_class" and value == (
            "<class 'stable_baselines3.common.torch_layers.FlattenExtractor'>"
        )
        bare = name == "features_extractor_kwargs" and value in ({}, None)
        if not (plain or flat or bare):
            raise _refusal(source, f"its policy_kwargs have the unknown entry {one_line(name, 60)}")
    if "activation_fn" not in options:
        return _DEFAULT_ACTIVATIONS[algorithm]
    name = options["activation_fn"]
    if not isinstance(name, str) or name not in _ACTIVATIONS:
        raise _refusal(source, f"its activation is {one_line(str(name), 60)}")
    return _ACTIVATIONS[name]


def _layers(tensors: Mapping[str, np.ndarray], config: _Config, source: str) -> list[str]:
    """Return the names of the layers in order, numbered 0, 2, 4, ...; check their sizes."""
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
    inputs = config.interface.n_features
    for number, layer in enumerate(layers):
        weight, bias = tensors[f"{layer}.weight"], tensors[f"{layer}.bias"]
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
    outputs = config.interface.action_size or config.interface.n_actions
    if inputs != outputs:
        what = "numbers of an action" if config.interface.action_size else "actions"
        raise UserError(
            f"{source} has {inputs} outputs for {outputs} {what}: save the policy again"
        )
    return layers


def _take_deviations(
    tensors: dict[str, np.ndarray], config: _Config, source: str
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
    config: _Config,
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
        """Choose actions, as `types.Policy`; `UserError` for an observation that doesn't fit."""
        best, state = self.greedy.predict(observation, state, episode_start)
        if deterministic:
            return best, state
        explores = self.rng.random(best.shape) < self.epsilon
        random = self.rng.integers(self.greedy.n_actions, size=best.shape)
        return np.where(explores, random, best), state
