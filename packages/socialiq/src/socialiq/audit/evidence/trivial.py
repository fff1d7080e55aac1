"""Trivial drivers: constant actions and uniformly random ones, on the episodes of an audit.

They are no references of the regret test. A declaration that all of them would pass excludes
nothing (`verdict.results`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.audit.evidence.drive import Course
from socialiq.audit.evidence.outcomes import Outcomes, Reference
from socialiq.evaluation.simulate import UNIFORM, ScriptedActor, UniformActor
from socialiq.policies.interface import Interface
from socialiq.worlds.world import ConstantPolicy

PREFIX = "trivial_"
"""Beginning of their names."""

RANDOM = f"{PREFIX}random"

GO_AND_WAIT = ("go", "wait")
"""Constant drivers of the intersection, which are references already, by name of their rule."""


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


def trivial_drivers(course: Course) -> tuple[Outcomes, ...]:
    """Run the first action, the last action, and random ones, drawn by the seeds of the episodes.

    The first is to wait, the last to go as fast as possible; in an environment their meaning is
    not known, and of continuous actions they are the lower and upper ends of all numbers. Where
    the world has references of its own, the constant drivers are among them.
    """
    world, interface = course.world, Interface.of(course.world)
    constant: dict[str, Any] = {}
    if not world.references and interface.action_size:
        ends = {"lowest_values": -1.0, "highest_values": 1.0}
        constant = {
            name: np.full(interface.action_size, end, np.float32) for name, end in ends.items()
        }
    elif not world.references:
        names = getattr(world, "actions", [f"action_{k}" for k in range(interface.n_actions)])
        constant = {names[0]: 0, names[-1]: interface.n_actions - 1}
    outcomes = [
        course.drive(Reference(f"{PREFIX}{name}", ConstantPolicy(action)))
        for name, action in constant.items()
    ]
    return (*outcomes, _random(course, interface))


def _random(course: Course, interface: Interface) -> Outcomes:
    """Run random actions, drawn by the seeds of the episodes."""
    if course.world.is_exact:
        horizon = course.batch.table.world.horizon
        streams = [np.random.default_rng([UNIFORM, seed]) for seed in course.seeds.tolist()]
        actions = [stream.integers(interface.n_actions, size=horizon) for stream in streams]
        table = np.array(actions).T
        return course.outcomes(RANDOM, ScriptedActor(lambda time, _, __: table[time]))
    if interface.action_size:
        return course.outcomes(RANDOM, UniformActor(interface.action_size, course.batch))
    driver = Reference(RANDOM, UniformPolicy(interface.n_actions))
    return course.drive(driver, deterministic=False)
