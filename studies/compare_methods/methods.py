"""Rows of the comparison: a method is one entry, with what it is told and its grid of settings."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

Setting = tuple[tuple[str, float], ...]
"""Settings by name that differ from the world's."""

TOLD = ("labels", "ranks", "rewards", "environment")
"""Inputs beside observations and actions: who demonstrated an episode, which of two episodes scores
better, the pair of rewards of each step, and the world to act in."""

SETTINGS_EACH = 4
"""Settings of every method's grid: equal tuning for all."""


def middle(settings: tuple[Setting, ...], count: int) -> tuple[Setting, ...]:
    """Return the middle ones of a grid, where fewer than all are tried."""
    first = (len(settings) - count) // 2
    return settings[first : first + count]


def product(**values: tuple[float, ...]) -> tuple[Setting, ...]:
    """Return the grid of all combinations of values."""
    combined = itertools.product(*values.values())
    return tuple(tuple(zip(values, one, strict=True)) for one in combined)


@dataclass(frozen=True)
class Method:
    """A row of the comparison.

    Attributes:
        name: Name of the row and of its folders.
        label: Name in tables and figures.
        learner: Name in `training.LEARNERS`.
        settings: Grid from which one is chosen on the development seeds, `SETTINGS_EACH` of them.
        told: Names of `TOLD`.
        serves: What one network serves: an "angle", a "mode" (the nearest demonstrator's, whose
            episodes it learns from), or "all" angles.
        gridworlds: Whether it runs in the gridworlds.
        intersection: Whether it runs in the intersection.
        soft: Whether its stochastic policy means something.
    """

    name: str
    label: str
    learner: str
    settings: tuple[Setting, ...]
    told: tuple[str, ...] = ()
    serves: str = "angle"
    gridworlds: bool = True
    intersection: bool = True
    soft: bool = True


RATES = (3e-4, 1e-3, 3e-3, 1e-2)
TWO_RATES = (1e-3, 3e-3)
LABELS, RANKS, REWARDS, ENVIRONMENT = ((name,) for name in TOLD)

METHODS = (
    Method("clone", "BC, pooled", "clone", product(learning_rate=RATES), serves="all"),
    Method(
        "clone_of_mode",
        "BC of the nearest mode",
        "clone",
        product(learning_rate=RATES),
        LABELS,
        serves="mode",
    ),
    Method(
        "clone_by_return",
        "BC weighted by R(α)",
        "clone_by_return",
        product(reweight_temperature=(1.0, 0.3, 0.1, 0.03)),
        REWARDS,
    ),
    Method(
        "clone_by_advantage",
        "BC weighted by the advantage",
        "clone_by_advantage",
        product(reweight_temperature=(1.0, 0.3, 0.1, 0.03)),
        REWARDS,
    ),
    Method(
        "dwbc",
        "DWBC, best third as expert",
        "dwbc",
        product(expert_weight=(7.5, 15.0), learning_rate=TWO_RATES),
        RANKS,
    ),
    Method(
        "gail",
        "GAIL of the nearest mode",
        "gail",
        product(learning_rate=TWO_RATES, discriminator_updates=(4.0, 16.0)),
        LABELS + ENVIRONMENT,
        serves="mode",
        intersection=False,
    ),
    Method(
        "airl",
        "AIRL of the nearest mode",
        "airl",
        product(learning_rate=TWO_RATES, discriminator_updates=(4.0, 16.0)),
        LABELS + ENVIRONMENT,
        serves="mode",
        intersection=False,
    ),
    Method(
        "sqil",
        "SQIL of the nearest mode",
        "sqil",
        product(learning_rate=TWO_RATES, polyak=(0.015, 0.05)),
        LABELS + ENVIRONMENT,
        serves="mode",
        intersection=False,
        soft=False,
    ),
    Method(
        "iq_learn_offline",
        "IQ-Learn of the nearest mode, offline",
        "iq_learn_offline",
        product(temperature=(1.0, 0.1), learning_rate=TWO_RATES),
        LABELS,
        serves="mode",
    ),
    Method(
        "iq_learn",
        "IQ-Learn of the nearest mode",
        "iq_learn",
        product(temperature=(1.0, 0.1), learning_rate=TWO_RATES),
        LABELS + ENVIRONMENT,
        serves="mode",
    ),
    Method(
        "ls_iq",
        "LS-IQ of the nearest mode",
        "ls_iq",
        product(regularisation=(0.5, 10.0), learning_rate=TWO_RATES),
        LABELS + ENVIRONMENT,
        serves="mode",
    ),
    Method(
        "multi_intention",
        "multi-intention IRL by EM",
        "multi_intention",
        product(temperature=(1.0, 0.1), learning_rate=TWO_RATES),
        REWARDS,
        serves="all",
    ),
    Method(
        "trex",
        "T-REX, ranked by R(α)",
        "trex",
        product(strength=(1.0, 10.0), learning_rate=TWO_RATES),
        RANKS + ENVIRONMENT,
    ),
    Method(
        "sprinql",
        "SPRINQL's objective",
        "sprinql",
        product(reference_weight=(0.5, 5.0), conservatism=(0.1, 1.0)),
        RANKS,
    ),
    Method(
        "cql",
        "CQL on λR(α)",
        "cql",
        product(strength=(1.0, 10.0), conservatism=(0.1, 1.0)),
        REWARDS,
    ),
    Method(
        "iql",
        "IQL on R(α)",
        "iql",
        product(expectile=(0.7, 0.9), inverse_temperature=(3.0, 10.0)),
        REWARDS,
    ),
    Method(
        "outcome_conditioned",
        "RvS on the pair of returns",
        "outcome_conditioned",
        product(quantile=(1.0, 0.9), learning_rate=TWO_RATES),
        REWARDS,
        serves="all",
    ),
    Method(
        "guidance",
        "CFGRL guidance by advantage",
        "guidance",
        product(guidance=(1.0, 2.0, 5.0, 10.0)),
        REWARDS,
    ),
    Method(
        "pareto_irl",
        "ParIRL, interpolated rewards",
        "pareto_irl",
        product(irl_temperature=(1.0, 0.1), learning_rate=TWO_RATES),
        LABELS + ENVIRONMENT,
        serves="all",
    ),
    Method(
        "gpi_ls",
        "GPI-LS, tabular",
        "gpi_ls",
        product(learning_rate=(0.1, 0.3), transfer=(0.0, 1.0)),
        REWARDS + ENVIRONMENT,
        serves="all",
        intersection=False,
        soft=False,
    ),
    Method(
        "rl",
        "deep Q-learning on R(α)",
        "rl",
        product(learning_rate=TWO_RATES, polyak=(0.015, 0.05)),
        REWARDS + ENVIRONMENT,
        soft=False,
    ),
    Method(
        "thesis",
        "ours: the thesis' prior",
        "thesis",
        product(strength=(1.0, 2.0, 3.0, 10.0)),
        REWARDS + ENVIRONMENT,
    ),
    Method(
        "dial_offline",
        "ours: the dial, offline",
        "dial_offline",
        product(prior_weight=(50.0, 200.0), learning_rate=TWO_RATES),
        REWARDS,
        serves="all",
    ),
    Method(
        "dial_regularised",
        "ours: the regularised dial, offline",
        "dial_regularised",
        product(temperature=(0.03, 0.1), end_temperature=(0.1, 0.3)),
        REWARDS,
        serves="all",
        gridworlds=False,
    ),
    Method(
        "dial_online",
        "ours: the dial, online",
        "dial_online",
        product(polyak=(0.01, 0.05), learning_rate=TWO_RATES),
        REWARDS + ENVIRONMENT,
        serves="all",
    ),
)
"""The comparison's rows. A new one needs an entry here and a learner in `training.LEARNERS`."""

BY_NAME = {method.name: method for method in METHODS}

PEERS = {"gail": "imitation", "airl": "imitation", "sqil": "imitation", "gpi_ls": "morl"}
"""Learners of other libraries, each in an environment of its own (`peers`)."""
