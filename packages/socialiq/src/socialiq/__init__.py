"""Driving policies of a declared social angle, learned from mixed demonstrations.

The names below are the public interface (docs/api.md has an example of each); they load when they
are first used, so that `import socialiq` stays light. Everything else may change between versions.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from socialiq.worlds import register as _register

if TYPE_CHECKING:
    from socialiq.audit.conduct import audit_policy
    from socialiq.audit.profile.profile import Margin
    from socialiq.audit.profile.template import declare
    from socialiq.demonstrations.dataset import Demonstrations
    from socialiq.demonstrations.files import load as load_demonstrations
    from socialiq.demonstrations.files import save as save_demonstrations
    from socialiq.demonstrations.mixture import equal_trajectories, equal_transitions
    from socialiq.errors import UserError
    from socialiq.evaluation.rollout import rollout_env
    from socialiq.evaluation.rollout import trajectory_datasets as expert_datasets
    from socialiq.learners.acting import acting_in
    from socialiq.learners.iq_learn.config import IQLearnConfig as StaticConfig
    from socialiq.learners.iq_learn.config import IQLearnHyperparameters as Hyperparameters
    from socialiq.learners.iq_learn.train import train
    from socialiq.mdp.front import attainable_set
    from socialiq.nn.q_policy import QPolicy
    from socialiq.policies.load import load_policy
    from socialiq.social.angle import estimate_angle, score, weights
    from socialiq.types import Ending, RewardPair
    from socialiq.worlds.enumerate import tabulate
    from socialiq.worlds.environment import make_environment
    from socialiq.worlds.registry import make
    from socialiq.worlds.wrapper import RewardPairWrapper, Transition

__all__ = [
    "Demonstrations",
    "Ending",
    "Hyperparameters",
    "Margin",
    "QPolicy",
    "RewardPair",
    "RewardPairWrapper",
    "StaticConfig",
    "Transition",
    "UserError",
    "acting_in",
    "attainable_set",
    "audit_policy",
    "declare",
    "equal_trajectories",
    "equal_transitions",
    "estimate_angle",
    "expert_datasets",
    "load_demonstrations",
    "load_policy",
    "make",
    "make_environment",
    "rollout_env",
    "save_demonstrations",
    "score",
    "tabulate",
    "train",
    "weights",
]

# The same as above for the interpreter; a test holds the two against each other.
_PLACES = {
    "Demonstrations": "demonstrations.dataset",
    "Ending": "types",
    "Margin": "audit.profile.profile",
    "Hyperparameters": "learners.iq_learn.config:IQLearnHyperparameters",
    "QPolicy": "nn.q_policy",
    "RewardPair": "types",
    "RewardPairWrapper": "worlds.wrapper",
    "StaticConfig": "learners.iq_learn.config:IQLearnConfig",
    "Transition": "worlds.wrapper",
    "UserError": "errors",
    "acting_in": "learners.acting",
    "attainable_set": "mdp.front",
    "audit_policy": "audit.conduct",
    "declare": "audit.profile.template",
    "equal_trajectories": "demonstrations.mixture",
    "equal_transitions": "demonstrations.mixture",
    "estimate_angle": "social.angle",
    "expert_datasets": "evaluation.rollout:trajectory_datasets",
    "load_demonstrations": "demonstrations.files:load",
    "load_policy": "policies.load",
    "make": "worlds.registry",
    "make_environment": "worlds.environment",
    "rollout_env": "evaluation.rollout",
    "save_demonstrations": "demonstrations.files:save",
    "score": "social.angle",
    "tabulate": "worlds.enumerate",
    "train": "learners.iq_learn.train",
    "weights": "social.angle",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'socialiq' has no attribute '{name}'")
    module, _, attribute = _PLACES[name].partition(":")
    return getattr(importlib.import_module(f"socialiq.{module}"), attribute or name)


def __dir__() -> list[str]:
    return [*__all__]


_register()
