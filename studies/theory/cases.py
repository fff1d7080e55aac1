"""Problems on which the statements of the theory are tested."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from socialiq.evaluation.prediction import Setting, problem_of
from socialiq.mdp.tabular import TabularMDP
from socialiq.theory.demonstrators import mean_target, occupancies
from socialiq.theory.objective import Problem
from socialiq.types import Ending, RewardPair
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.registry import GRIDWORLDS, make_grid

KINDS = ("instantaneous", "to_go")
ANGLES = (0.0, 45.0, 90.0)

_DISCOUNT = 0.9  # of the random worlds
_N_STATES, _N_ACTIONS, _N_OUTCOMES = 10, 3, 2


class Case(NamedTuple):
    """A problem with its name.

    Attributes:
        world: "crossing5", "crossing7" or "random 3" (with the seed).
        angle: α in degrees.
        target_kind: Target of the prior.
        problem: The problem, at the default λ and τ.
    """

    world: str
    angle: float
    target_kind: str
    problem: Problem

    @property
    def label(self) -> dict[str, str | float]:
        """Columns that name the case in a table."""
        return {"world": self.world, "angle": self.angle, "target_kind": self.target_kind}


def gridworlds() -> dict[str, Table]:
    """Return the reachable part of each gridworld."""
    return {name: tabulate(make_grid(name)).reachable_part() for name in GRIDWORLDS}


def grid_cases(
    worlds: dict[str, Table], kinds: Sequence[str] = KINDS, angles: Sequence[float] = ANGLES
) -> list[Case]:
    """Return the pool of equal numbers of episodes of each expert, at every angle and target."""
    return [
        Case(name, angle, kind, problem_of(part, Setting(angle, kind)))
        for name, part in worlds.items()
        for angle in angles
        for kind in kinds
    ]


def random_cases(seeds: Sequence[int], kinds: Sequence[str] = KINDS) -> list[Case]:
    """Return random worlds of ten states with three random demonstrators, one for each seed."""
    return [_random_case(seed, kind) for seed in seeds for kind in kinds]


def _random_case(seed: int, kind: str) -> Case:
    rng = np.random.default_rng(seed)
    shape = (_N_STATES, _N_ACTIONS, _N_OUTCOMES)
    mdp = TabularMDP(
        successor=rng.integers(_N_STATES, size=shape),
        probability=rng.dirichlet(np.ones(_N_OUTCOMES), shape[:2]),
        ending=np.where(rng.random(shape) < 0.1, Ending.ARRIVAL, Ending.NONE),
        rewards=RewardPair(rng.normal(size=shape[:2]), rng.normal(size=shape[:2])),
        initial=rng.dirichlet(np.ones(_N_STATES)),
    )
    policies = [rng.dirichlet(np.full(_N_ACTIONS, 0.5), _N_STATES) for _ in range(3)]
    parts = occupancies(mdp, policies, [1 / 3] * 3, _DISCOUNT)
    target = mean_target(mdp, policies, parts, mdp.rewards.env, kind, _DISCOUNT)
    problem = Problem(mdp, parts.sum(axis=0), target, discount=_DISCOUNT)
    return Case(f"random {seed}", 0.0, kind, problem)
