"""Configuration in the `data` member of a Stable-Baselines3 zip.

Stable-Baselines3 writes values that JSON cannot hold twice: as a base64 pickle under
`:serialized:`, and as plain text beside it, "to have an idea what was being stored"
(`common/save_util.py`). Loading the pickle would run its author's code, so only the plain text is
read. If the two differ, an audit is of the policy that is read here, not of the one that
Stable-Baselines3 would load.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.policies.interface import Interface

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


class Sb3Config(NamedTuple):
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


def read_config(content: bytes, source: str) -> Sb3Config:
    """Read the member `data`.

    Args:
        content: The member.
        source: The file's name in messages.

    Raises:
        UserError: If the network's output would be ambiguous.
    """
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
    return Sb3Config(algorithm, activation, interface, float(epsilon), bounds)


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
