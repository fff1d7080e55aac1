"""Trivial drivers: constant actions and uniformly random ones, on the episodes of an audit.

They are no references of the regret test. A declaration that all of them would pass excludes
nothing (`verdict.discrimination`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float, Int64

from socialiq.audit.evidence.drive import (
    drive_actions,
    drive_environment,
    drive_intersection,
)
from socialiq.audit.evidence.outcomes import Outcomes, Reference
from socialiq.audit.profile.environment import Environment
from socialiq.worlds.enumerate import Table
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.state import ACTIONS

PREFIX = "trivial_"
"""Beginning of their names."""

RANDOM = f"{PREFIX}random"

GO_AND_WAIT = ("go", "wait")
"""Constant drivers of the intersection, which are references already, by name of their rule."""

_RANDOM = 6011  # makes these draws independent of other draws from the same seed

Seeds = Int64[np.ndarray, " episode"]


class ConstantPolicy:
    """Policy that chooses one action always.

    Args:
        action: The action.
    """

    def __init__(self, action: int) -> None:
        self.action = action

    def predict(
        self,
        observation: Any,  # noqa: ARG002  part of the protocol
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[np.ndarray, Any]:
        """Return the action for one observation."""
        return np.asarray(self.action), state


class UniformPolicy:
    """Policy that chooses every action with the same probability, whatever it observes.

    Args:
        actions: Number of actions.
    """

    def __init__(self, actions: int) -> None:
        self._actions = actions

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002  part of the protocol
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[np.ndarray, Any]:
        """Return the first action: the draws follow `probabilities`."""
        return np.zeros(len(observation), np.int64), state

    def probabilities(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Return equal probabilities."""
        return np.full((len(observations), self._actions), 1.0 / self._actions)


def trivial_at_intersection(batch: Batch, seeds: Seeds) -> tuple[Outcomes, ...]:
    """Run random actions, drawn by the seeds; the constant ones are among the references.

    Args:
        batch: The episodes that run side by side.
        seeds: Seeds of the episodes.
    """
    driver = Reference(RANDOM, UniformPolicy(len(ACTIONS)))
    return (drive_intersection(batch, driver, seeds, deterministic=False),)


def trivial_in_grid(
    table: Table, fate: Float[np.ndarray, "episode draw"], seeds: Seeds
) -> tuple[Outcomes, ...]:
    """Run the first action, the last action, and random ones, drawn by the seeds.

    The first is to wait, the last to go as fast as possible.

    Args:
        table: The world's reachable part.
        fate: Result of `drive.fates`.
        seeds: Seeds of the episodes.
    """
    names, horizon = table.world.actions, table.world.horizon
    rows = [np.random.default_rng([_RANDOM, seed]) for seed in seeds.tolist()]
    drawn = np.array([row.integers(len(names), size=horizon) for row in rows]).T
    chosen = {
        f"{PREFIX}{names[0]}": np.zeros_like(drawn),
        f"{PREFIX}{names[-1]}": np.full_like(drawn, len(names) - 1),
        RANDOM: drawn,
    }
    return tuple(drive_actions(table, actions, fate, name) for name, actions in chosen.items())


def trivial_in_environment(world: Environment, seeds: Seeds) -> tuple[Outcomes, ...]:
    """Run the first action, the last action, and random ones, drawn by the seeds.

    Their meaning is not known. Each costs as much time as a reference.

    Args:
        world: The environment.
        seeds: Seeds of the episodes.
    """
    last = world.n_actions - 1
    constant = (Reference(f"{PREFIX}action_{one}", ConstantPolicy(one)) for one in (0, last))
    found = [drive_environment(world, one, seeds) for one in constant]
    driver = Reference(RANDOM, UniformPolicy(world.n_actions))
    return (*found, drive_environment(world, driver, seeds, deterministic=False))
