"""A gridworld made ready for exact evaluation, and the regret of a dial that trains there."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

from socialiq.evaluation.exact import Optimum, Readout, action_table, evaluate_exactly
from socialiq.learners.dial import config as dial
from socialiq.learners.dial.train import Regret, dial_of
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.registry import make_grid


class Ground(NamedTuple):
    """A gridworld with its exact optima.

    Attributes:
        table: All its states.
        part: Its reachable states.
        optimum: The best that any policy can do there, by angle.
    """

    table: Table
    part: Table
    optimum: Optimum

    @staticmethod
    def of(world: str) -> Ground:
        """Enumerate a world with its default options."""
        table = tabulate(make_grid(world))
        part = table.reachable_part()
        return Ground(table, part, Optimum(part))


def with_clock(ground: Ground, clock: bool) -> Ground:
    """Return the ground with the time in the observations, or unchanged."""
    if not clock:
        return ground
    table, part = (
        dataclasses.replace(states, world=states.world.with_clock())
        for states in (ground.table, ground.part)
    )
    return Ground(table, part, ground.optimum)


def exact_regret(
    ground: Ground,
    static: dial.DialConfig,
    numbers: Sequence[dial.DialHyperparameters],
    readout: Readout = "soft",
) -> Regret:
    """Return the regret of a run's policy at the angle of its static config.

    The default is the soft policy: its regret falls smoothly with the multiplier, a greedy policy's
    in jumps, so that no multiplier may meet a budget.
    """

    def regret(network: DialNetwork, run: int, multiplier: float) -> float:
        policy = dial_of(static, numbers[run], network, multiplier)
        return regret_at(ground, policy, static.low, readout)

    return regret


def regret_at(ground: Ground, policy: DialPolicy, angle: float, readout: Readout) -> float:
    """Return the regret of a dial at an angle in degrees, evaluated exactly."""
    chances = action_table(policy.at(angle), ground.part, readout)
    return ground.optimum.regret(evaluate_exactly(ground.part, chances), angle)
