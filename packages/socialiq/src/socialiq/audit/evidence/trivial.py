"""Trivial drivers: constant actions and uniformly random ones, on the episodes of an audit.

They are no references of the regret test. A declaration that all of them would pass excludes
nothing (`verdict.discrimination`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int64

from socialiq.audit.evidence.drive import (
    ByRule,
    drive_actions,
    drive_environment,
    drive_intersection,
    outcomes_of,
    steps_of,
)
from socialiq.audit.evidence.outcomes import Outcomes, Reference
from socialiq.audit.profile.environment import Environment
from socialiq.evaluation.context import DecisionLosses
from socialiq.evaluation.play import BatchSimulator
from socialiq.evaluation.simulate import SoftActor, simulate
from socialiq.policies.interface import Interface
from socialiq.worlds.enumerate import Table
from socialiq.worlds.intersection.batch import Batch, width
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
        action: The action: a number, or a vector.
    """

    def __init__(self, action: int | np.ndarray) -> None:
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


class UniformActor:
    """Actor that draws continuous actions uniformly from [-1, 1], by the seeds of the episodes.

    Args:
        action_size: Length of an action.
        rows: Rows of the simulator.
    """

    def __init__(self, action_size: int, rows: int) -> None:
        self._size = action_size
        self._streams: list[np.random.Generator | None] = [None] * rows

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Open the stream of each episode."""
        for row, seed in zip(rows.tolist(), seeds.tolist(), strict=True):
            self._streams[row] = np.random.default_rng([_RANDOM, seed])

    def decide(self, observation: Any, running: np.ndarray) -> Float32[np.ndarray, "row size"]:  # noqa: ARG002
        """Draw for the running rows; the others get 0."""
        action = np.zeros((len(running), self._size), np.float32)
        for row in np.flatnonzero(running).tolist():
            stream = self._streams[row]
            assert stream is not None  # `begin` opened it
            action[row] = stream.uniform(-1.0, 1.0, self._size)
        return action


def trivial_at_intersection(
    batch: Batch, seeds: Seeds, by_rule: ByRule | None = None
) -> tuple[Outcomes, ...]:
    """Run random actions, drawn by the seeds; the constant ones are among the references.

    Args:
        batch: The episodes that run side by side.
        seeds: Seeds of the episodes.
        by_rule: As for `drive.drive_intersection`.
    """
    if size := width(batch.options):
        steps = simulate(BatchSimulator(batch), UniformActor(size, batch.size), seeds)
        return (outcomes_of(RANDOM, steps, len(seeds)),)
    driver = Reference(RANDOM, UniformPolicy(len(ACTIONS)))
    return (drive_intersection(batch, driver, seeds, deterministic=False, by_rule=by_rule),)


def trivial_in_grid(
    table: Table,
    fate: Float[np.ndarray, "episode draw"],
    seeds: Seeds,
    losses: DecisionLosses | None = None,
) -> tuple[Outcomes, ...]:
    """Run the first action, the last action, and random ones, drawn by the seeds.

    The first is to wait, the last to go as fast as possible.

    Args:
        table: The world's reachable part.
        fate: Result of `drive.fates`.
        seeds: Seeds of the episodes.
        losses: As for `drive.drive_grid`.
    """
    names, horizon = table.world.actions, table.world.horizon
    rows = [np.random.default_rng([_RANDOM, seed]) for seed in seeds.tolist()]
    uniform = np.array([row.integers(len(names), size=horizon) for row in rows]).T
    chosen = {
        f"{PREFIX}{names[0]}": np.zeros_like(uniform),
        f"{PREFIX}{names[-1]}": np.full_like(uniform, len(names) - 1),
        RANDOM: uniform,
    }
    return tuple(
        drive_actions(table, actions, fate, name, losses) for name, actions in chosen.items()
    )


def trivial_in_environment(world: Environment, seeds: Seeds) -> tuple[Outcomes, ...]:
    """Run the first action, the last action, and random ones, drawn by the seeds.

    Of continuous actions the first and last are the lower and upper ends of all numbers. Their
    meaning is not known. Each costs as much time as a reference.

    Args:
        world: The environment.
        seeds: Seeds of the episodes.
    """
    sizes = Interface.of(world)
    names: dict[str, Any] = {f"action_{number}": number for number in (0, sizes.n_actions - 1)}
    if size := sizes.action_size:
        ends = {"lowest_values": -1.0, "highest_values": 1.0}
        names = {name: np.full(size, end, np.float32) for name, end in ends.items()}
    constant = (
        Reference(f"{PREFIX}{name}", ConstantPolicy(action)) for name, action in names.items()
    )
    outcomes = [drive_environment(world, driver, seeds) for driver in constant]
    actor = UniformActor(size, 1) if size else SoftActor(UniformPolicy(sizes.n_actions), size=1)
    return (*outcomes, outcomes_of(RANDOM, steps_of(world, actor, seeds), len(seeds)))
