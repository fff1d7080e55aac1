"""Learners of the study, each with its settings, and their training on many sets at once."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners import settings
from socialiq.learners.acting import acting_in
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.iq_learn.config import Endings, IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.iq_learn.train import train
from socialiq.learners.kernel import Trained
from studies.classic_control.tasks import CartPole, Task, make_env

CHUNK = 250
"""Updates between two rounds of acting, in environments outside compiled programs."""

# Settings of the IQ-Learn paper's discrete experiments: a near-greedy temperature, χ² on the
# expert, `value_expert`, the gradient through V(s').
PAPER = IQLearnConfig(
    prior="none",
    value_term="value_expert",
    next_value="online",
    online=False,
    activation="elu",
    batch_size=32,
    updates=10_000,
)
PAPER_NUMBERS = IQLearnHyperparameters(temperature=1e-3, learning_rate=1e-4)
PAPER_ONLINE = dataclasses.replace(
    PAPER, online=True, value_term="value", chi2_on="mixture", updates=6000
)

OFFLINE, OFFLINE_NUMBERS = presets.PRESETS["few-offline"]
ONLINE, ONLINE_NUMBERS = presets.PRESETS["few-online"]

# Cloning with what the offline preset has: network, scale, batch, rate, schedule, averaging.
_SHARED = {
    entry.name: getattr(OFFLINE, entry.name) for entry in dataclasses.fields(settings.LearnerConfig)
}
CLONING = bc.CloningConfig(**_SHARED)
CLONING_NUMBERS = bc.CloningHyperparameters(learning_rate=OFFLINE_NUMBERS.learning_rate)


@dataclass(frozen=True)
class Method:
    """A learner with its settings.

    Attributes:
        static: Its static configuration; the type says which learner it is.
        numbers: Its hyperparameters, but for seed and data set.
        mirrored: Whether the mirror images of the demonstrations are given.
        scaled: Whether the features are multiplied by the task's common factor.
    """

    static: Any
    numbers: Any
    mirrored: bool = False
    scaled: bool = True

    @property
    def online(self) -> bool:
        """Whether it acts in the environment."""
        return getattr(self.static, "online", False)


METHODS = {
    "iq_learn": Method(OFFLINE, OFFLINE_NUMBERS),
    "cloning": Method(CLONING, CLONING_NUMBERS),
    "iq_learn, mirrored": Method(OFFLINE, OFFLINE_NUMBERS, True),
    "cloning, mirrored": Method(CLONING, CLONING_NUMBERS, True),
    "iq_learn online": Method(ONLINE, ONLINE_NUMBERS),
}
"""Methods by name in the tables."""

PUBLISHED = {
    "iq_learn as published": Method(PAPER, PAPER_NUMBERS, scaled=False),
    "iq_learn online as published": Method(PAPER_ONLINE, PAPER_NUMBERS, scaled=False),
}
"""Settings of the IQ-Learn paper."""


@dataclass(frozen=True)
class Variant:
    """One change of a method: an ablation.

    Attributes:
        of: Name of the method.
        static: Changed fields of its static configuration.
        numbers: Changed hyperparameters.
        scaled: As in `Method`.
    """

    of: str
    static: Mapping[str, Any] = field(default_factory=dict)
    numbers: Mapping[str, Any] = field(default_factory=dict)
    scaled: bool = True


_offline = partial(Variant, "iq_learn, mirrored")
_online = partial(Variant, "iq_learn online")

VARIANTS = {
    "offline: temperature 0.001": _offline(numbers={"temperature": 1e-3}),
    "offline: chi2 alpha 500": _offline(numbers={"chi2_alpha": 500.0}),
    "offline: V(s') by a target network": _offline({"next_value": "target"}),
    "offline: constant rate, last weights": _offline({"schedule": "constant", "averaging": 0.0}),
    "offline: inputs as they are": _offline(scaled=False),
    "online: endings worth 0": _online({"endings": Endings(timeout="bootstrap")}),
    "online: V(s') not bounded": _online({"bounded": False}),
    "online: V(s') by a target network": _online({"next_value": "target"}),
    "online: constant rate, last weights": _online({"schedule": "constant", "averaging": 0.0}),
    "online: inputs as they are": _online(scaled=False),
    "online: one environment step an update": _online({"env_steps_per_update": 1}),
}
"""Ablations by name in the tables."""


def method_of(name: str) -> Method:
    """Return a method or a variant of one by its name.

    Raises:
        UserError: If there is none of that name.
    """
    methods = METHODS | PUBLISHED
    if name in methods:
        return methods[name]
    if name not in VARIANTS:
        raise UserError(f"unknown method '{name}': choose one of {', '.join(methods)}")
    change = VARIANTS[name]
    base = METHODS[change.of]
    return dataclasses.replace(
        base,
        static=dataclasses.replace(base.static, **change.static),
        numbers=dataclasses.replace(base.numbers, **change.numbers),
        scaled=change.scaled,
    )


def learn(
    task: Task,
    method: Method,
    datasets: Sequence[Demonstrations],
    seeds: Sequence[int],
    updates: int,
    callbacks: Callbacks,
) -> Trained:
    """Train one run for each set and seed, the seeds of a set side by side.

    Args:
        task: Where an online learner acts.
        method: What is trained.
        datasets: Sets of demonstrations.
        seeds: Training seeds.
        updates: Gradient steps of each run; 0 for those of the method.
        callbacks: Progress.
    """
    scale = task.input_scale if method.scaled else 1.0
    static = dataclasses.replace(
        method.static, updates=updates or method.static.updates, input_scale=scale
    )
    runs = [
        dataclasses.replace(method.numbers, seed=seed, dataset=index)
        for index in range(len(datasets))
        for seed in seeds
    ]
    if isinstance(static, bc.CloningConfig):
        return bc.BehaviourCloning.train_on(static, runs, datasets, callbacks)
    if not method.online:
        return train(static, runs, datasets, callbacks=callbacks)
    if task.env == "CartPole-v1":
        return train(static, runs, datasets, CartPole(), callbacks)
    static = dataclasses.replace(static, env_steps_per_update=1)  # they cost more than an update
    collect = acting_in(lambda: make_env(task), static, runs, CHUNK)
    return train(static, runs, datasets, None, callbacks, CHUNK, collect)
