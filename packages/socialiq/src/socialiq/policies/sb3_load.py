"""Policies of Stable-Baselines3, read from its zip without that library, torch or unpickling.

The zip holds `policy.pth`, the tensors (see `sb3_tensors`), and `data`, the rest (see
`sb3_config`). The members with optimizer states are never opened.
"""

from __future__ import annotations

import itertools
import json
import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from socialiq.errors import UserError
from socialiq.evaluation.simulate import SoftPolicy
from socialiq.foreign import one_line
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.q_policy import QPolicy, checked_batch, numbers_of
from socialiq.policies.interface import BatchPolicy, Interface
from socialiq.policies.sb3_config import KINDS, Config, config_of, data_of
from socialiq.policies.sb3_tensors import Archive, read_state_dict
from socialiq.types import Memoryless, Policy

MOST_WORDS = 8 * 1024 * 1024
MOST_NETWORK = 32 * 1024 * 1024

_CLIP_MEAN = 2.0
"""Largest mean of SAC's and TQC's gSDE before the tangent is taken, their default."""

STATISTICS = "vecnormalize.json"
"""Member of the zip with the statistics of `VecNormalize`, which its owner adds."""

MOST_FOLDERS = 100
MOST_ENTRIES = 10_000
"""Folders in the folder of a zip, and entries of each folder, that are searched for statistics."""

_STATISTICS_NAME = re.compile(r"vec.*norm|obs_?rms", re.IGNORECASE)
_STATISTICS_CLASS = b"stable_baselines3.common.vec_env.vec_normalize"
_PICKLES = ("", ".p", ".pickle", ".pk", ".pkl", ".pth")
_OTHER_FILES = (".ipynb", ".md", ".onnx", ".py", ".pyc", ".zip")
"""Endings of files that are no statistics, whatever their name is."""

Batch = Float[np.ndarray, "batch feature"]
Chances = Float[np.ndarray, "batch action"]


def read_sb3(
    content: bytes, source: str, world: Interface, statistics_beside: str = ""
) -> tuple[Policy, dict[str, Any]]:
    """Return a policy from the bytes of a zip, and details.

    If deterministic, it takes the best action, as `predict` of Stable-Baselines3 does. Otherwise a
    DQN explores at its saved rate, PPO and A2C draw from the softmax over their outputs, and
    continuous actions are drawn from the policy's Gaussian, if it has one, which with gSDE it has
    not. Continuous actions are in [-1, 1], the ends being the bounds of the action space.
    Statistics of `VecNormalize` are numbers in the member vecnormalize.json.

    Args:
        content: Bytes of the zip.
        source: Name of the file in messages.
        world: Interface of the world.
        statistics_beside: Path of a file of statistics from the zip's folder (`statistics_near`),
            for which a zip without its own is refused; "" if there is none.

    Raises:
        UserError: If the file is damaged, holds another kind of policy, or one for another world.
    """
    archive = Archive(content, source)
    data = data_of(archive.read("data", MOST_WORDS), source)
    config = config_of(data, source)
    config.interface.check(source, world)
    tensors = read_state_dict(archive.read("policy.pth", MOST_NETWORK), f"{source}, policy.pth")
    deviations = _take_deviations(tensors, config, source)
    layers = _layers(tensors, config, source)
    weights = tuple(tensors[f"{layer}.weight"] for layer in layers)
    biases = tuple(tensors[f"{layer}.bias"] for layer in layers)
    sizes = [config.interface.n_features, *(len(bias) for bias in biases)]
    details: dict[str, Any] = {"algorithm": config.algorithm, "activation": config.activation}
    policy: Policy = QPolicy(weights, biases, config.activation, 1.0)
    if config.interface.action_size:
        policy = _actor(weights, biases, deviations, config, source)
    elif config.algorithm in ("DQN", "QR-DQN"):
        policy = EpsilonGreedy(policy, config.epsilon)
        details["epsilon"] = config.epsilon
    if STATISTICS in archive.names:
        policy = normalised(policy, archive.read(STATISTICS, MOST_WORDS), sizes[0], source)
        details["normalised"] = isinstance(policy, Normalised)
    elif data.get("_last_original_obs") is not None and config.algorithm == "actor-critic":
        raise _outside(source, "was trained under VecNormalize")
    elif statistics_beside:
        raise _outside(source, f"lies beside {one_line(statistics_beside, 80)}")
    return policy, details | {"layers": sizes}


def interface_of(content: bytes, source: str) -> Interface:
    """Return the interface that a zip names.

    Args:
        content: Bytes of the zip.
        source: Name of the file in messages.

    Raises:
        UserError: If the file is damaged or holds another kind of policy.
    """
    data = data_of(Archive(content, source).read("data", MOST_WORDS), source)
    return config_of(data, source).interface


def statistics_near(path: Path) -> str:
    """Return where a file of `VecNormalize` statistics lies near a zip, "" if there is none.

    Callbacks and the RL Zoo keep it in the zip's folder, in one of the folders in it, or up to two
    levels above. A file is known by its name, or by the class that its pickle names first, which is
    read as bytes. A link is followed, so that the folder of the zip itself is searched too.

    Args:
        path: Path of the zip.

    Returns:
        The path of the statistics from the folder of the zip.
    """
    for place in dict.fromkeys((path.absolute().parent, path.resolve().parent)):
        inside = (Path(entry) for entry in _entries(place) if entry.is_dir())
        for folder in (place, *itertools.islice(inside, MOST_FOLDERS), *place.parents[:2]):
            for entry in _entries(folder):
                if _is_statistics(entry):
                    return os.path.relpath(entry, place)
    return ""


def _entries(folder: Path) -> list[os.DirEntry[str]]:
    """Return the first entries of a folder; none of a folder that can't be read."""
    try:
        with os.scandir(folder) as entries:
            return list(itertools.islice(entries, MOST_ENTRIES))
    except OSError:
        return []


def _is_statistics(entry: os.DirEntry[str]) -> bool:
    """Whether a file has the name of statistics, or begins as a pickle of them."""
    suffix = Path(entry.name).suffix.lower()
    if suffix in _OTHER_FILES or not entry.is_file():
        return False
    if _STATISTICS_NAME.search(entry.name):
        return True
    if suffix not in _PICKLES:
        return False
    try:
        with Path(entry).open("rb") as file:
            return _STATISTICS_CLASS in file.read(256)
    except OSError:
        return False


def _outside(source: str, sign: str) -> UserError:
    """Return the error of a policy whose observations are normalised by another file's numbers."""
    return UserError(
        f"{source} {sign}, whose statistics are a part of the policy: add them to the zip as "
        f'{STATISTICS}, numbers by the names mean, var, epsilon and clip_obs, or {{"norm_obs": '
        "false}, or export the policy to ONNX with the normalisation inside"
    )


def _layers(tensors: dict[str, np.ndarray], config: Config, source: str) -> list[str]:
    """Return the names of the layers in order, numbered 0, 2, 4, ...; check their sizes."""
    kind = KINDS[config.algorithm]
    unused = re.compile(rf"{kind.unused}\.(weight|bias)")
    used = {name for name in tensors if not unused.fullmatch(name)}
    layers: list[str] = []
    for hidden in kind.hidden:
        count = sum(name.startswith(f"{hidden}.") for name in used) // 2
        layers += [f"{hidden}.{2 * number}" for number in range(count)]
    # gSDE bounds SAC's mean, a layer of its own.
    bounded = config.algorithm == "SAC" and config.explores_by_state
    layers += [f"{layer}.0" if bounded else layer for layer in kind.last]
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
        weight = tensors[f"{layer}.weight"]
        bias = tensors[f"{layer}.bias"]
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
    if config.algorithm == "QR-DQN" and inputs % outputs == 0:
        # Its value of an action is the mean of its quantiles, which the last layer may take.
        for name in (f"{layers[-1]}.weight", f"{layers[-1]}.bias"):
            array = tensors[name]
            tensors[name] = array.reshape(-1, outputs, *array.shape[1:]).mean(axis=0)
        inputs = outputs
    if inputs != outputs:
        what = "numbers of an action" if config.interface.action_size else "actions"
        raise UserError(
            f"{source} has {inputs} outputs for {outputs} {what}: save the policy again"
        )
    return layers


def _take_deviations(
    tensors: dict[str, np.ndarray], config: Config, source: str
) -> tuple[np.ndarray, np.ndarray] | None:
    """Remove the layer of log-deviations from the tensors of a continuous policy, and return it."""
    size = config.interface.action_size
    if not size or config.algorithm == "TD3":
        return None
    names = ["log_std"]
    if config.explores_by_state:  # of the layer before, and without use for its mean action
        tensors.pop("actor.log_std" if config.algorithm == "SAC" else "log_std", None)
        return None
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
    config: Config,
    source: str,
) -> ActorPolicy | BatchPolicy:
    """Return the policy of continuous actions; PPO's, in other units and clipped, are scaled."""
    mean = weights[-1]
    bias = biases[-1]
    bounded = config.algorithm == "SAC" and config.explores_by_state
    if config.bounds is not None:
        low, high = np.array(config.bounds, np.float32)
        half = (high - low) / 2.0
        mean = mean / half[:, None]
        bias = (bias - (high + low) / 2.0) / half
        if deviations is not None:
            deviations = deviations[0], deviations[1] - np.log(half)
    elif bounded:
        mean = mean / _CLIP_MEAN
        bias = bias / _CLIP_MEAN
    if deviations is not None:
        mean = np.vstack([mean, deviations[0]])
        bias = np.append(bias, deviations[1])
    actor = ActorPolicy(
        (*weights[:-1], mean.astype(np.float32)),
        (*biases[:-1], bias.astype(np.float32)),
        config.activation,
        config.interface.action_size,
        squash="tanh" if config.bounds is None and not bounded else "clip",
    )
    if not bounded:
        return actor

    def decide(batch: np.ndarray, _soft: bool) -> np.ndarray:
        return np.tanh(_CLIP_MEAN * actor.predict(batch)[0])

    return BatchPolicy(source, config.interface, decide)


@dataclass(frozen=True)
class Normalised(Memoryless):
    """Policy of observations that are normalised first, as `VecNormalize` does."""

    policy: Any  # policy of the normalised observations
    mean: Float[np.ndarray, " feature"]  # mean of each feature in training
    deviation: Float[np.ndarray, " feature"]  # √(variance + ε) of each feature
    clip: float  # largest size of a normalised feature

    def normal(self, observations: Any) -> Float32[np.ndarray, "batch feature"]:
        """Return normalised observations; `UserError` for an observation that doesn't fit."""
        batch = checked_batch(observations, len(self.mean))
        scaled = (batch - self.mean) / self.deviation
        return np.clip(scaled, -self.clip, self.clip).astype(np.float32)

    def choose(self, observation: np.ndarray, deterministic: bool, /) -> np.ndarray:
        """Return the actions of the policy for the normalised observations.

        Args:
            observation: One observation, (features,), or a batch, (batch, features).
            deterministic: Whether the policy takes its best action.

        Raises:
            UserError: If an observation doesn't fit.
        """
        numbers = numbers_of(observation)
        batch = self.normal(np.atleast_2d(numbers))
        batch = batch if numbers.ndim == 2 else batch[0]
        return self.policy.predict(batch, deterministic=deterministic)[0]


class SoftNormalised(Normalised):
    """The same of a policy that gives its probabilities."""

    def probabilities(self, observations: Batch) -> Chances:
        """Return the probability of each action."""
        return self.policy.probabilities(self.normal(observations))


def normalised(policy: Policy, content: bytes, n_features: int, source: str) -> Policy:
    """Return a policy with its normalisation.

    Args:
        policy: Policy of normalised observations.
        content: A JSON object with mean and var (one number a feature), epsilon and clip_obs, by
            the names of `VecNormalize`; or `{"norm_obs": false}`.
        n_features: Length of an observation.
        source: Name of the file in messages.

    Returns:
        The policy of observations as they are; the same policy if they are not normalised.

    Raises:
        UserError: If the numbers can't be statistics.
    """
    refusal = UserError(
        f"{source}: {STATISTICS} is no object of mean and var, {n_features} finite numbers each, "
        "epsilon and clip_obs: write them as VecNormalize has them"
    )
    try:
        numbers = json.loads(content)
        if numbers == {"norm_obs": False}:
            return policy
        mean, variance = (np.array(numbers[name], np.float64) for name in ("mean", "var"))
        epsilon = float(numbers.get("epsilon", 1e-8))
        clip = float(numbers.get("clip_obs", 10.0))
        sound = mean.shape == variance.shape == (n_features,) and clip > 0.0
        sound = sound and bool(np.isfinite(mean).all() and np.isfinite(variance).all())
        sound = sound and epsilon >= 0.0 and bool((variance + epsilon > 0.0).all())
    except (
        ValueError,
        TypeError,
        KeyError,
        AttributeError,
        OverflowError,
        RecursionError,
    ) as error:
        raise refusal from error
    if not sound:
        raise refusal
    kind = SoftNormalised if isinstance(policy, SoftPolicy) else Normalised
    return kind(policy, mean, np.sqrt(variance + epsilon), clip)


@dataclass(frozen=True)
class EpsilonGreedy(Memoryless):
    """Policy that takes the best action, or with probability ε a uniformly random one.

    Stable-Baselines3 draws once for all observations of a call; here every observation has its own
    draw, so that episodes do not depend on the batch. For a single observation the distribution is
    the same.
    """

    greedy: QPolicy
    epsilon: float
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def probabilities(self, observations: Batch) -> Chances:
        """Return the probability of each action."""
        best = self.greedy.q_values(observations).argmax(axis=1)
        n_actions = self.greedy.n_actions
        return (1.0 - self.epsilon) * np.eye(n_actions)[best] + self.epsilon / n_actions

    def choose(self, observation: np.ndarray, deterministic: bool, /) -> np.ndarray:
        """Return the best actions, or some random ones.

        Args:
            observation: One observation, (features,), or a batch, (batch, features).
            deterministic: Whether all actions are the best.

        Raises:
            UserError: If an observation doesn't fit.
        """
        best = self.greedy.choose(observation, True)
        if deterministic:
            return best
        explores = self.rng.random(best.shape) < self.epsilon
        random = self.rng.integers(self.greedy.n_actions, size=best.shape)
        return np.where(explores, random, best)
