"""Configuration of a policy of Stable-Baselines3: the member `data` of its zip.

Stable-Baselines3 writes values that JSON cannot hold twice: as a base64 pickle under
`:serialized:`, and as plain text next to it, "to have an idea what was being stored"
(`common/save_util.py`). Loading the pickle would run its author's code, so only the plain text is
read. If the two differ, an audit judges the policy that is read here, not the one that
Stable-Baselines3 would load.
"""

import json
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.policies.interface import Interface


class Kind(NamedTuple):
    """Names of an algorithm's tensors, and its default activation."""

    hidden: tuple[str, ...]  # prefixes of the hidden layers, in order
    last: tuple[str, ...]  # layers after them; a DQN's last layer is the last of its hidden ones
    unused: str  # tensors that are not used to choose a deterministic action
    activation: str  # between the layers


KINDS = {
    "DQN": Kind(("q_net.q_net",), (), r"q_net_target\.q_net\.\d+", "relu"),
    "QR-DQN": Kind(
        ("quantile_net.quantile_net",), (), r"quantile_net_target\.quantile_net\.\d+", "relu"
    ),
    "actor-critic": Kind(
        ("mlp_extractor.shared_net", "mlp_extractor.policy_net"),
        ("action_net",),
        r"(mlp_extractor\.value_net\.\d+|value_net)",
        "tanh",
    ),
    "SAC": Kind(("actor.latent_pi",), ("actor.mu",), r"(critic|critic_target)\.qf\d+\.\d+", "relu"),
    "TD3": Kind(
        ("actor.mu",), (), r"((critic|critic_target)\.qf\d+|actor_target\.mu)\.\d+", "relu"
    ),
}
_MODULES = {
    "stable_baselines3.dqn.policies": "DQN",
    "sb3_contrib.qrdqn.policies": "QR-DQN",
    "stable_baselines3.common.policies": "actor-critic",
    "stable_baselines3.sac.policies": "SAC",
    "sb3_contrib.tqc.policies": "SAC",
    "stable_baselines3.td3.policies": "TD3",
}
"""Modules of the policies' classes; PPO, A2C and TRPO share theirs, and TD3 and DDPG."""

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
    "full_std",
    "use_expln",
    "n_critics",
    "n_quantiles",  # the number of outputs says it too
    "top_quantiles_to_drop_per_net",
    "device",
    "use_sde",
    ":type:",
    ":serialized:",
}
_FLOATS = ("float32", "float64")
MOST_NUMBERS = 1000
"""Numbers of a continuous action."""


class Config(NamedTuple):
    """Configuration of a network."""

    algorithm: str  # one of `KINDS`
    activation: str  # between the layers
    interface: Interface  # length of its observations, flattened row by row, and number of actions
    epsilon: float  # share of random actions, of a DQN that is not deterministic
    # lower and upper bound of each number of a continuous action; only of an actor-critic, whose
    # actions are in the environment's units
    bounds: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    explores_by_state: bool = False  # whether its noise depends on the state (gSDE)


def data_of(content: bytes, source: str) -> dict[str, Any]:
    """Return the object of the member `data`.

    Args:
        content: Bytes of the member.
        source: Name of the file in messages.

    Raises:
        UserError: If it is not a JSON object.
    """
    try:
        data = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise _refusal(source, "its member data is not JSON") from error
    if not isinstance(data, dict):
        raise _refusal(source, "its member data is not a JSON object")
    return data


def config_of(data: Mapping[str, Any], source: str) -> Config:
    """Return the configuration of a policy.

    Args:
        data: Object of the member `data`.
        source: Name of the file in messages.

    Raises:
        UserError: If the network's output would be ambiguous.
    """
    module = _object(data, "policy_class").get("__module__")
    if not isinstance(module, str) or module not in _MODULES:
        raise _refusal(source, f"its policy class is of {one_line(str(module), 60)}")
    algorithm = _MODULES[module]
    space = _object(data, "action_space")
    bounds = None
    if algorithm not in ("DQN", "QR-DQN") and _is_space(space, "Box"):
        shape = _shape(space)
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
        count = str(space.get("n"))
        start = str(space.get("start", 0))
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
    by_state = [data.get("use_sde", False), _object(data, "policy_kwargs").get("use_sde", False)]
    if not all(value is False or (value is True and interface.action_size) for value in by_state):
        raise _refusal(source, "its gSDE is not of continuous actions")
    return Config(algorithm, activation, interface, float(epsilon), bounds, any(by_state))


def _refusal(source: str, fault: str) -> UserError:
    return UserError(
        f"{source}: {fault}; read are MLPs over one flat observation, of DQN, QR-DQN, PPO, A2C, "
        "TRPO, SAC, TQC, TD3 and DDPG, so export others to ONNX"
    )


def _object(data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    value = data.get(name)
    return value if isinstance(value, dict) else {}


def _is_space(space: Mapping[str, Any], kind: str) -> bool:
    libraries = ("gymnasium", "gym")
    names = [f"<class '{library}.spaces.{kind.lower()}.{kind}'>" for library in libraries]
    return space.get(":type:") in names


def _shape(space: Mapping[str, Any]) -> Any:
    """Return the shape of a space; Gym before 0.22 wrote it by the name `shape`."""
    return space.get("_shape", space.get("shape"))


def _features(data: Mapping[str, Any], source: str) -> int:
    """Return the length of a flattened observation of floats; bytes, as images have, are scaled."""
    space = _object(data, "observation_space")
    shape = _shape(space)
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
    for name, value in options.items():
        flat = name == "features_extractor_class" and value == (
            "<class 'stable_baselines3.common.torch_layers.FlattenExtractor'>"
        )
        bare = name == "features_extractor_kwargs" and value in ({}, None)
        if not (name in _HARMLESS or flat or bare):
            raise _refusal(source, f"its policy_kwargs have the unknown entry {one_line(name, 60)}")
    if "activation_fn" not in options:
        return KINDS[algorithm].activation
    name = options["activation_fn"]
    if not isinstance(name, str) or name not in _ACTIVATIONS:
        raise _refusal(source, f"its activation is {one_line(str(name), 60)}")
    return _ACTIVATIONS[name]
