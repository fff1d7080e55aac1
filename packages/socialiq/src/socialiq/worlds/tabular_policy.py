"""Tabular policies of gridworlds, and the exact experts of an angle."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.mdp.solve import greedy_policy, value_iteration
from socialiq.nn.saved import Arrays, Header, Saved
from socialiq.social.angle import score, weights
from socialiq.types import Memoryless
from socialiq.worlds import crossing5, crossing7
from socialiq.worlds.enumerate import Table, drawn_outcome
from socialiq.worlds.grid_world import GridWorld


@dataclass(frozen=True, repr=False)
class TabularPolicy(Memoryless, Saved):
    """Action probabilities by state, in the order of the world's state numbers."""

    KIND = "table"

    world: GridWorld  # of a saved table one of the registry with its default options
    probabilities: Float[np.ndarray, "state action"]
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    sha256: str = ""  # of the file's content, for a table that was loaded

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
        """Build a table from a file's content, as `Saved.checked`.

        Args:
            path: Path of the file, for messages.
            arrays: The file's arrays; `probabilities` must be float64 (state, action).
            header: The file's header, with the world's name and description.

        Raises:
            UserError: If the file belongs to another world or to other options, or the table is not
                one of distributions.
        """
        name = header.get("world")
        worlds = {"crossing5": crossing5.make, "crossing7": crossing7.make}
        if not isinstance(name, str) or name not in worlds:
            raise UserError(f"{path} is not for a world of {', '.join(worlds)}: make it again")
        world = worlds[name]()
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

    def choose(self, observation: np.ndarray, deterministic: bool, /) -> np.ndarray:
        """Choose actions: the most probable (the first of equals), or drawn from the table.

        Args:
            observation: One observation (feature,), or a batch (..., feature).
            deterministic: Whether to take the most probable action.

        Returns:
            Numbers of actions, in the observations' shape without its last axis.
        """
        batch = np.atleast_2d(np.rint(observation).astype(np.int64))
        chances = self.probabilities[self.world.index(batch)]
        actions = chances.argmax(axis=1) if deterministic else draw_actions(chances, self.rng)
        return actions.reshape(np.shape(observation)[:-1])


def draw_actions(
    probabilities: Float[np.ndarray, "batch action"], rng: np.random.Generator
) -> np.ndarray:
    """Draw one action for each row of probabilities.

    Args:
        probabilities: Probability of each action; every row sums to 1.
        rng: Generator that gives one number for each row.

    Returns:
        Number of the action drawn in each row, int64 (batch,).
    """
    return drawn_outcome(probabilities, rng.random((len(probabilities), 1))[:, 0])


Variant = Literal["deterministic", "stochastic"]


def expert_policy(
    table: Table, angle: float, variant: Variant = "deterministic", discount: float = 0.99
) -> Float[np.ndarray, "state action"]:
    """Return the greedy policy of value iteration on R(α) (Eq 4.3), one-hot.

    Ties go to the first action within a relative 1e-12, and cos 90° keeps its float64 residue: the
    5x5 altruist of Fig 6.1 exists only because of both (docs/worlds/crossing5.md).

    Args:
        table: The enumerated world.
        angle: Social angle α in degrees.
        variant: "stochastic" solves the world itself. "deterministic" solves it without spawns, as
            the thesis does before it rolls the experts out in the stochastic world; rewards don't
            depend on spawns.
        discount: Discount factor γ, by default that of Table C.1.

    Returns:
        1 for the chosen action of each state, else 0.
    """
    mdp = table.mdp
    if variant == "deterministic":  # the first chance outcome always occurs: no vehicle spawns
        certain = np.zeros_like(mdp.probability)
        certain[..., 0] = 1.0
        mdp = dataclasses.replace(mdp, probability=certain)
    reward = score(weights(angle), mdp.rewards)
    return greedy_policy(value_iteration(mdp, reward, discount).q)
