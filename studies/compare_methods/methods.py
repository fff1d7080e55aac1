"""Rows of the comparison: a method is one entry, with what it is told and its grid of settings."""

from __future__ import annotations

from socialiq_lab.comparison_runs import Method, product

TOLD = ("labels", "ranks", "rewards", "environment")
"""Inputs beside observations and actions: who demonstrated an episode, which of two episodes scores
better, the pair of rewards of each step, and the world to act in."""

SETTINGS_EACH = 4
"""Settings of every method's grid: equal tuning for all."""

LABELS, RANKS, REWARDS, ENVIRONMENT = ((name,) for name in TOLD)
ACTING = LABELS + ENVIRONMENT  # of a learner of the nearest demonstrator's episodes
BOTH = REWARDS + ENVIRONMENT

TWO = (1e-3, 3e-3)  # learning rates
RATES = product(learning_rate=(3e-4, 1e-3, 3e-3, 1e-2))
SHARPNESS = product(reweight_temperature=(1.0, 0.3, 0.1, 0.03))
ADVERSARIAL = product(learning_rate=TWO, discriminator_updates=(4.0, 16.0))
FOLLOWING = product(learning_rate=TWO, polyak=(0.015, 0.05))
SOFT = product(temperature=(1.0, 0.1), learning_rate=TWO)
EXPERTS = product(expert_weight=(7.5, 15.0), learning_rate=TWO)
LEAST_SQUARES = product(regularisation=(0.5, 10.0), learning_rate=TWO)
RANKED = product(strength=(1.0, 10.0), learning_rate=TWO)
GRADED = product(reference_weight=(0.5, 5.0), conservatism=(0.1, 1.0))
CONSERVATIVE = product(strength=(1.0, 10.0), conservatism=(0.1, 1.0))
IMPLICIT = product(expectile=(0.7, 0.9), inverse_temperature=(3.0, 10.0))
OUTCOMES = product(quantile=(1.0, 0.9), learning_rate=TWO)
GUIDED = product(guidance=(1.0, 2.0, 5.0, 10.0))
INFERRED = product(irl_temperature=(1.0, 0.1), learning_rate=TWO)
TABULAR = product(learning_rate=(0.1, 0.3), transfer=(0.0, 1.0))
STRENGTHS = product(strength=(1.0, 2.0, 3.0, 10.0))
PRIORS = product(prior_weight=(50.0, 200.0), learning_rate=TWO)
DISTANCES = product(temperature=(0.03, 0.1), end_temperature=(0.1, 0.3))
TARGETS = product(polyak=(0.01, 0.05), learning_rate=TWO)

METHODS = (
    Method("clone", "BC, pooled", "clone", RATES, serves="all"),
    Method("clone_of_mode", "BC of the nearest mode", "clone", RATES, LABELS, serves="mode"),
    Method("clone_by_return", "BC weighted by R(α)", "clone_by_return", SHARPNESS, REWARDS),
    Method(
        "clone_by_advantage",
        "BC weighted by the advantage",
        "clone_by_advantage",
        SHARPNESS,
        REWARDS,
    ),
    Method("dwbc", "DWBC, best third as expert", "dwbc", EXPERTS, RANKS),
    Method(
        "gail",
        "GAIL of the nearest mode",
        "gail",
        ADVERSARIAL,
        ACTING,
        serves="mode",
        intersection=False,
    ),
    Method(
        "airl",
        "AIRL of the nearest mode",
        "airl",
        ADVERSARIAL,
        ACTING,
        serves="mode",
        intersection=False,
    ),
    Method(
        "sqil",
        "SQIL of the nearest mode",
        "sqil",
        FOLLOWING,
        ACTING,
        serves="mode",
        intersection=False,
        soft=False,
    ),
    Method(
        "iq_learn_offline",
        "IQ-Learn of the nearest mode, offline",
        "iq_learn_offline",
        SOFT,
        LABELS,
        serves="mode",
    ),
    Method("iq_learn", "IQ-Learn of the nearest mode", "iq_learn", SOFT, ACTING, serves="mode"),
    Method("ls_iq", "LS-IQ of the nearest mode", "ls_iq", LEAST_SQUARES, ACTING, serves="mode"),
    Method(
        "multi_intention",
        "multi-intention IRL by EM",
        "multi_intention",
        SOFT,
        REWARDS,
        serves="all",
    ),
    Method("trex", "T-REX, ranked by R(α)", "trex", RANKED, RANKS + ENVIRONMENT),
    Method("sprinql", "SPRINQL's objective", "sprinql", GRADED, RANKS),
    Method("cql", "CQL on λR(α)", "cql", CONSERVATIVE, REWARDS),
    Method("iql", "IQL on R(α)", "iql", IMPLICIT, REWARDS),
    Method(
        "outcome_conditioned",
        "RvS on the pair of returns",
        "outcome_conditioned",
        OUTCOMES,
        REWARDS,
        serves="all",
    ),
    Method("guidance", "CFGRL guidance by advantage", "guidance", GUIDED, REWARDS),
    Method(
        "pareto_irl", "ParIRL, interpolated rewards", "pareto_irl", INFERRED, ACTING, serves="all"
    ),
    Method(
        "gpi_ls",
        "GPI-LS, tabular",
        "gpi_ls",
        TABULAR,
        BOTH,
        serves="all",
        intersection=False,
        soft=False,
    ),
    Method("rl", "deep Q-learning on R(α)", "rl", FOLLOWING, BOTH, soft=False),
    Method("thesis", "ours: the thesis' prior", "thesis", STRENGTHS, BOTH),
    Method(
        "dial_offline", "ours: the dial, offline", "dial_offline", PRIORS, REWARDS, serves="all"
    ),
    Method(
        "dial_regularised",
        "ours: the regularised dial, offline",
        "dial_regularised",
        DISTANCES,
        REWARDS,
        gridworlds=False,
        serves="all",
    ),
    Method("dial_online", "ours: the dial, online", "dial_online", TARGETS, BOTH, serves="all"),
)
"""The comparison's rows. A new one needs an entry here and a learner in `training.LEARNERS`."""

BY_NAME = {method.name: method for method in METHODS}

PEERS = {"gail": "imitation", "airl": "imitation", "sqil": "imitation", "gpi_ls": "morl"}
"""Learners of other libraries, each in an environment of its own (`peers`)."""
