"""Tabular policies, and the exact synthetic experts of thesis 5.2."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.mdp.solve import greedy_policy, value_iteration
from socialiq.mdp.tabular import TabularMDP
from socialiq.nn.saved import Arrays, Header, Saved
from socialiq.social.angle import score, weights
from socialiq.worlds.enumerate import Table
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.registry import GRIDWORLDS, make_grid


@dataclass(frozen=True)
class TabularPolicy(Saved):
    """Action probabilities by state, in the order of the world's state numbers.

    Attributes:
        world: The world; that of a saved table is one of the registry with its default options.
        probabilities: Of each action in each state.
        rng: Source of the draws.
        sha256: SHA-256 of the file's content, for a table that was loaded.
    """

    KIND = "table"

    world: GridWorld
    probabilities: Float[np.ndarray, "state action"]
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    sha256: str = ""

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return self.world.n_features

    @property
    def n_actions(self) -> int:
        """Number of actions."""
        return self.world.n_actions

    def content(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return the table and the header of the file: the world's name and description."""
        header = {"world": self.world.name, "description": self.world.description}
        return {"probabilities": self.probabilities}, header

    @classmethod
    def checked(cls, path: Path, arrays: Arrays, header: Header) -> TabularPolicy:
        """Build a table from a file's content, as `Saved.checked`."""
        name = header.get("world")
        if not isinstance(name, str) or name not in GRIDWORLDS:
            raise UserError(f"{path} is not for a world of {', '.join(GRIDWORLDS)}: make it again")
        world = make_grid(name)
        if header.get("description") != world.description:
            raise UserError(f"{path} was made for other options of {name}: make it for the default")
        chances = arrays.get("probabilities", np.zeros(0))
        states = int(np.prod(world.shape))
        if chances.shape != (states, world.n_actions) or chances.dtype != np.float64:
            raise UserError(
                f"{path} must hold float64 of {states} states and {world.n_actions} actions: make "
                "it again"
            )
        if not ((chances >= 0.0).all() and np.allclose(chances.sum(axis=1), 1.0, atol=1e-9)):
            raise UserError(f"{path} has a row that is not a distribution: make it again")
        return cls(world, chances, sha256=header["sha256"])

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose actions: the most probable (the first of equals), or drawn from the table."""
        batch = np.atleast_2d(np.rint(observation).astype(np.int64))
        chances = self.probabilities[self.world.index(batch)]
        actions = chances.argmax(axis=1) if deterministic else draw_actions(chances, self.rng)
        return actions.reshape(np.shape(observation)[:-1]), state


def draw_actions(
    probabilities: Float[np.ndarray, "batch action"], rng: np.random.Generator
) -> np.ndarray:
    """Draw one action for each row of probabilities."""
    cumulative = probabilities.cumsum(axis=1)
    actions = (rng.random((len(probabilities), 1)) >= cumulative).sum(axis=1)
    return np.minimum(actions, probabilities.shape[1] - 1)


Variant = Literal["deterministic", "stochastic"]


def expert_policy(
    table: Table, angle: float, variant: Variant = "deterministic", discount: float = 0.99
) -> Float[np.ndarray, "state action"]:
    """Return the greedy policy of value iteration on R(α) (Eq 4.3), one-hot.

    Ties go to the first action within a relative 1e-12, and cos 90° keeps its float64 residue:
    the 5x5 altruist of Fig 6.1 exists only because of both (docs/worlds/crossing5.md).

    Args:
        table: The world, with all its states.
        angle: Social angle in degrees.
        variant: Solve the world itself, or the variant without spawns, as the thesis does before
            it rolls the experts out in the stochastic world.
        discount: γ of Table C.1.
    """
    mdp = without_chance(table.mdp) if variant == "deterministic" else table.mdp
    reward = score(weights(angle), mdp.rewards)
    return greedy_policy(value_iteration(mdp, reward, discount).q)


def without_chance(mdp: TabularMDP) -> TabularMDP:
    """Return the variant in which the first chance outcome always occurs: no vehicle spawns.

    Rewards don't depend on the outcome in the gridworlds: a spawn affects later steps only.
    """
    certain = np.zeros_like(mdp.probability)
    certain[..., 0] = 1.0
    return dataclasses.replace(mdp, probability=certain)
