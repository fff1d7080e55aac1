"""Learners of the study, each with its settings."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.continuous.config import ActorIQLearnConfig, ActorIQLearnHyperparameters
from socialiq.learners.iq_learn.config import Endings

ROUND = 1000
"""Updates, and steps in the environment, between two rounds of acting: the greatest length of an
episode."""


@dataclass(frozen=True)
class Method:
    """A learner with its settings.

    Attributes:
        static: Its static configuration; the type says which learner it is.
        numbers: Its hyperparameters, but for seed and data set.
        absorbing: Whether terminal states are absorbing ones that the observation shows.
        standardised: Whether the networks see standardised observations.
        updates: Of online imitation; 0 for those of the task.
        forces: Whether the networks see contact forces, of tasks that have them.
    """

    static: Any
    numbers: Any
    absorbing: bool = False
    standardised: bool = False
    updates: int = 0
    forces: bool = True

    @property
    def online(self) -> bool:
        """Whether it acts in the environment."""
        return getattr(self.static, "online", False)


ONLINE = ActorIQLearnConfig(
    prior="none",
    chi2_on="mixture",
    bounded=True,
    endings=Endings(timeout="bootstrap", other="occupancy"),
    hidden=(64, 64),
    batch_size=128,
    replay_capacity=200_000,
    updates_per_round=ROUND,
)
OFFLINE = ActorIQLearnConfig(
    prior="none",
    online=False,
    value_term="value_expert",
    endings=Endings(timeout="bootstrap"),
    hidden=(64, 64),
    batch_size=128,
    updates=10_000,
)
NUMBERS = ActorIQLearnHyperparameters(temperature=0.01, learning_rate=1e-3)

CLONING = bc.CloningConfig(hidden=(64, 64), batch_size=128, updates=10_000)
CLONING_NUMBERS = bc.CloningHyperparameters(learning_rate=1e-3)

CHOSEN = "temperature 0.1, discount 0.97, linear rate, 100,000 updates"
"""Name of online imitation with settings that were chosen in development on Hopper, for every task:
a new choice has a new name, since earlier results are taken over by name."""

LONGER = "online, standardised, 300,000 updates"
"""Name of online imitation that differs from "online, standardised" in its length alone; chosen in
development on HalfCheetah."""

WITHOUT_FORCES = "online, standardised, temperature 0.3, 300,000 updates, no contact forces"
"""Name of online imitation that was chosen in development on Ant, whose contact forces are 0 but
for short peaks."""

LINEAR = dataclasses.replace(ONLINE, schedule="linear")

_EVERYWHERE = {
    "online": Method(ONLINE, NUMBERS),
    CHOSEN: Method(
        LINEAR, dataclasses.replace(NUMBERS, temperature=0.1, discount=0.97), updates=100_000
    ),
    "offline": Method(OFFLINE, NUMBERS),
    "cloning": Method(CLONING, CLONING_NUMBERS),
    "online, standardised": Method(LINEAR, NUMBERS, standardised=True, updates=100_000),
    LONGER: Method(
        dataclasses.replace(LINEAR, replay_capacity=300_000),
        NUMBERS,
        standardised=True,
        updates=300_000,
    ),
    "offline, standardised": Method(
        dataclasses.replace(OFFLINE, updates=20_000),
        dataclasses.replace(NUMBERS, temperature=0.1, discount=0.97),
        standardised=True,
    ),
    "cloning, standardised": Method(
        dataclasses.replace(CLONING, updates=50_000), CLONING_NUMBERS, standardised=True
    ),
}
METHODS = _EVERYWHERE | {
    WITHOUT_FORCES: dataclasses.replace(
        _EVERYWHERE[LONGER], numbers=dataclasses.replace(NUMBERS, temperature=0.3), forces=False
    ),
    "offline, standardised, no contact forces": dataclasses.replace(
        _EVERYWHERE["offline, standardised"], forces=False
    ),
    "cloning, standardised, no contact forces": dataclasses.replace(
        _EVERYWHERE["cloning, standardised"], forces=False
    ),
}
"""Methods by name in the tables: IQ-Learn online, the same with `CHOSEN`, offline, and cloning;
then with standardised observations, online with the temperature and discount of "online"; then for
tasks with contact forces."""

CLONE_OF = {
    "online": "cloning",
    CHOSEN: "cloning",
    "offline": "cloning",
    "online, standardised": "cloning, standardised",
    LONGER: "cloning, standardised",
    "offline, standardised": "cloning, standardised",
    WITHOUT_FORCES: "cloning, standardised, no contact forces",
    "offline, standardised, no contact forces": "cloning, standardised, no contact forces",
}
"""Cloning that each other method is tested against."""


@dataclass(frozen=True)
class Variant:
    """An ablation: online imitation with one option changed.

    Attributes:
        static: Changed fields of its static configuration.
        numbers: Changed hyperparameters.
        absorbing: As of `Method`.
    """

    static: Mapping[str, Any] = field(default_factory=dict)
    numbers: Mapping[str, Any] = field(default_factory=dict)
    absorbing: bool = False


def _endings(treatment: str) -> dict[str, Any]:
    return {"endings": Endings(timeout="bootstrap", other=treatment)}  # type: ignore[arg-type]


VARIANTS = {
    "values not bounded": Variant({"bounded": False}),
    "endings worth 0": Variant(_endings("zero")),
    "absorbing states": Variant(_endings("bootstrap"), absorbing=True),
    "regression": Variant({"critic": "regression"}),
    "V(s') with gradient": Variant({"next_value": "online"}),
    "linear rate, averaged weights": Variant({"schedule": "linear", "averaging": 1e-3}),
    "temperature 0.1": Variant(numbers={"temperature": 0.1}),
}
"""Ablations by name in the tables."""


def method_of(name: str) -> Method:
    """Return a method by its name in `METHODS` or `VARIANTS`."""
    if name in METHODS:
        return METHODS[name]
    variant, base = VARIANTS[name], METHODS["online"]
    static = dataclasses.replace(base.static, **variant.static)
    numbers = dataclasses.replace(base.numbers, **variant.numbers)
    return Method(static, numbers, variant.absorbing)
