"""Driving policies of a declared social angle, learned from mixed demonstrations.

The names below are the public interface (docs/api.md has an example of each), the ten functions of
`socialiq.functions` first. They load when they are first used, so that `import socialiq` stays
light. Everything else may change between versions.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from socialiq.errors import public
from socialiq.worlds import register as _register

if TYPE_CHECKING:
    from socialiq.audit.profile.profile import Margin
    from socialiq.audit.profile.template import declare
    from socialiq.datasets.arrays import of_steps as from_arrays
    from socialiq.datasets.step_files import read_steps as read_arrays
    from socialiq.demonstrations.dataset import Demonstrations
    from socialiq.demonstrations.files import load as load_demonstrations
    from socialiq.demonstrations.files import save as save_demonstrations
    from socialiq.demonstrations.mixture import equal_trajectories, equal_transitions
    from socialiq.errors import UserError
    from socialiq.evaluation.exact import Optimum, action_table, evaluate_exactly
    from socialiq.evaluation.rollout import rollout_env
    from socialiq.evaluation.rollout import trajectory_datasets as expert_datasets
    from socialiq.functions.exchange import collect, export
    from socialiq.functions.learn import train
    from socialiq.functions.measure import audit, effects, evaluate, solve
    from socialiq.functions.worlds import driver, load, world
    from socialiq.learners.acting import acting_in
    from socialiq.learners.callbacks import Callbacks
    from socialiq.learners.dial.config import DialConfig, DialHyperparameters
    from socialiq.learners.dial.train import train as train_dial
    from socialiq.learners.iq_learn.config import IQLearnConfig as StaticConfig
    from socialiq.learners.iq_learn.config import IQLearnHyperparameters as Hyperparameters
    from socialiq.learners.kernel import Learner
    from socialiq.mdp.front import attainable_set
    from socialiq.nn.dial_policy import DialPolicy
    from socialiq.nn.q_policy import QPolicy
    from socialiq.policies.export import to_onnx
    from socialiq.policies.load import load_policy
    from socialiq.social.angle import estimate_angle, score, weights
    from socialiq.types import Ending, RewardPair
    from socialiq.worlds.enumerate import tabulate
    from socialiq.worlds.environment import make_environment
    from socialiq.worlds.registry import make
    from socialiq.worlds.wrapper import RewardPairWrapper, Transition

__all__ = ["collect", "driver", "evaluate", "train", "world"]
__all__ += ["audit", "effects", "export", "load", "solve"]
__all__ += ["Ending", "RewardPair", "UserError", "estimate_angle", "score", "weights"]
__all__ += ["RewardPairWrapper", "Transition", "attainable_set", "make", "make_environment"]
__all__ += ["Optimum", "action_table", "evaluate_exactly", "rollout_env", "tabulate"]
__all__ += ["Demonstrations", "equal_trajectories", "equal_transitions", "expert_datasets"]
__all__ += ["from_arrays", "load_demonstrations", "read_arrays", "save_demonstrations"]
__all__ += ["Callbacks", "Hyperparameters", "Learner", "StaticConfig", "acting_in"]
__all__ += ["DialConfig", "DialHyperparameters", "DialPolicy", "train_dial"]
__all__ += ["Margin", "QPolicy", "declare", "load_policy", "to_onnx"]

# The same as above for the interpreter; a test holds the two against each other.
_PLACES = {
    "Callbacks": "learners.callbacks",
    "Demonstrations": "demonstrations.dataset",
    "DialConfig": "learners.dial.config",
    "DialHyperparameters": "learners.dial.config",
    "DialPolicy": "nn.dial_policy",
    "Ending": "types",
    "Hyperparameters": "learners.iq_learn.config:IQLearnHyperparameters",
    "Learner": "learners.kernel",
    "Margin": "audit.profile.profile",
    "Optimum": "evaluation.exact",
    "QPolicy": "nn.q_policy",
    "RewardPair": "types",
    "RewardPairWrapper": "worlds.wrapper",
    "StaticConfig": "learners.iq_learn.config:IQLearnConfig",
    "Transition": "worlds.wrapper",
    "UserError": "errors",
    "acting_in": "learners.acting",
    "action_table": "evaluation.exact",
    "attainable_set": "mdp.front",
    "audit": "audit",
    "collect": "functions.exchange",
    "declare": "audit.profile.template",
    "driver": "functions.worlds",
    "effects": "functions.measure",
    "equal_trajectories": "demonstrations.mixture",
    "equal_transitions": "demonstrations.mixture",
    "estimate_angle": "social.angle",
    "evaluate": "functions.measure",
    "evaluate_exactly": "evaluation.exact",
    "expert_datasets": "evaluation.rollout:trajectory_datasets",
    "export": "functions.exchange",
    "from_arrays": "datasets.arrays:of_steps",
    "load": "functions.worlds",
    "load_demonstrations": "demonstrations.files:load",
    "load_policy": "policies.load",
    "make": "worlds.registry",
    "make_environment": "worlds.environment",
    "read_arrays": "datasets.step_files:read_steps",
    "rollout_env": "evaluation.rollout",
    "save_demonstrations": "demonstrations.files:save",
    "score": "social.angle",
    "solve": "functions.measure",
    "tabulate": "worlds.enumerate",
    "to_onnx": "policies.export",
    "train": "functions.learn",
    "train_dial": "learners.dial.train:train",
    "weights": "social.angle",
    "world": "functions.worlds",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'socialiq' has no attribute '{name}'")
    module, _, attribute = _PLACES[name].partition(":")
    value: Any = importlib.import_module(f"socialiq.{module}")
    if module != name:  # `audit` is a package that can be called
        value = getattr(value, attribute or name)
    globals()[name] = public(value, name)
    return globals()[name]


def __dir__() -> list[str]:
    return [*__all__]


_register()
