"""Seeded episodes of one driver at a recorded junction, and the drivers that always run there."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int64

from socialiq.audit.evidence.drive import outcomes_of
from socialiq.audit.evidence.outcomes import Outcomes, Reference
from socialiq.audit.evidence.trivial import RANDOM, ConstantPolicy, UniformPolicy
from socialiq.evaluation.simulate import Actor, SoftActor, SoftPolicy, simulate
from socialiq.policies.interface import Interface
from socialiq.types import Policy
from socialiq_recordings.world.batch import AS_DRIVER, JunctionBatch, JunctionSimulator

DRIVER = "driver"
"""Reference that drives as a driver of the calibrated population. It knows the ways of the others
and the closed lines, which policies see in part."""

Seeds = Int64[np.ndarray, " episode"]


class JunctionActor:
    """A policy that acts for all rows at once; it may take the time as a last feature."""

    def __init__(self, batch: JunctionBatch, driver: Reference, deterministic: bool) -> None:
        self._batch, self._driver, self._deterministic = batch, driver, deterministic

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Do nothing: the policy has no state."""

    def decide(
        self,
        observation: np.ndarray,  # noqa: ARG002  the batch has it
        running: np.ndarray,
    ) -> Int64[np.ndarray, " row"]:
        """Return the policy's actions; `AS_DRIVER` is no action of a policy."""
        policy, rows = self._driver.policy, len(running)
        if isinstance(policy, ConstantPolicy):
            return np.full(rows, policy.action, np.int64)
        answer, _ = policy.predict(self._batch.seen_by(policy), deterministic=self._deterministic)
        return Interface(0, self._batch.world.n_actions).checked(answer, rows, self._driver.name)


class _SoftActor:
    """Draws the actions of a soft policy by the episode's seed (`SoftActor`)."""

    def __init__(self, batch: JunctionBatch, policy: SoftPolicy) -> None:
        self._batch, self._policy = batch, policy
        self._actor = SoftActor(policy, batch.size)

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        self._actor.begin(rows, seeds)

    def decide(self, observation: np.ndarray, running: np.ndarray) -> np.ndarray:  # noqa: ARG002
        return self._actor.decide(self._batch.seen_by(self._policy), running)


def drive_junction(
    batch: JunctionBatch, driver: Reference, seeds: Seeds, deterministic: bool = True
) -> Outcomes:
    """Run a driver on one episode of a recorded junction for each seed.

    Args:
        batch: The episodes that run side by side.
        driver: The driver.
        seeds: Seeds of the episodes; a stochastic `SoftPolicy` draws from them too.
        deterministic: Whether it takes its best action.

    Raises:
        UserError: If its answers are not one of the world's actions for each episode.
    """
    policy: Policy = driver.policy
    actor: Actor = JunctionActor(batch, driver, deterministic)
    if not deterministic and isinstance(policy, SoftPolicy):
        actor = _SoftActor(batch, policy)
    steps = simulate(JunctionSimulator(batch), actor, seeds)
    return outcomes_of(driver.name, steps, len(seeds), driver.angles)


def rules_at_junction(n_actions: int) -> list[Reference]:
    """Return the references that always run: a calibrated driver, always faster, always slower.

    Args:
        n_actions: Number of accelerations, the strongest braking first.
    """
    actions = {DRIVER: AS_DRIVER, "go": n_actions - 1, "wait": 0}
    return [Reference(name, ConstantPolicy(action)) for name, action in actions.items()]


def trivial_at_junction(batch: JunctionBatch, seeds: Seeds) -> tuple[Outcomes, ...]:
    """Run random actions, drawn by the seeds; the constant ones are among the references."""
    driver = Reference(RANDOM, UniformPolicy(batch.world.n_actions))
    return (drive_junction(batch, driver, seeds, deterministic=False),)


def junction_strata(observation: Float32[np.ndarray, "episode feature"]) -> dict[str, np.ndarray]:
    """Return labels from the ego's first observation: the number of other rows, closed lines too.

    Args:
        observation: Observation of each episode after the reset.
    """
    density = (observation.reshape(len(observation), -1, 7)[:, 1:, 0] > 0).sum(axis=1)
    return {"density": np.select([density <= 3, density <= 7], ["0 to 3", "4 to 7"], "8 or more")}
