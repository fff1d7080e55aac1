"""Tables as policies under audit: one distribution over actions for each state of a gridworld."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.policies.record import Interface
from socialiq.storage import load_arrays, save_arrays
from socialiq.worlds.registry import GRIDWORLDS, make_grid
from socialiq.worlds.tabular_policy import TabularPolicy

KIND = "table"
SCHEMA_VERSION = 1

_ARRAY = "probabilities"


def save_table(path: Path, policy: TabularPolicy) -> str:
    """Write a table to one safetensors file.

    Args:
        path: The file; its folder must exist.
        policy: In a world of the registry with its default options.

    Returns:
        The content's SHA-256.

    Raises:
        UserError: If the file can't be written.
    """
    header = {"world": policy.world.name, "description": policy.world.description}
    return save_arrays(path, KIND, SCHEMA_VERSION, {_ARRAY: policy.probabilities}, header)


def read_table(path: Path, world: Interface) -> tuple[TabularPolicy, dict[str, Any]]:
    """A table that `save_table` wrote.

    Returns:
        The policy, and what the file tells about it.

    Raises:
        UserError: If the file is missing or damaged, is for another world or another reading of it,
            or holds rows that are no distribution.
    """
    arrays, header = load_arrays(path, KIND, SCHEMA_VERSION)
    name = header.get("world")
    if not isinstance(name, str) or name not in GRIDWORLDS:
        raise UserError(f"{path} is for no world of {', '.join(GRIDWORLDS)}: make it again")
    grid = make_grid(name)
    if header.get("description") != grid.description:
        raise UserError(f"{path} was made for other options of {name}: make it for the default")
    Interface(grid.n_features, grid.n_actions).check(str(path), world)
    chances = arrays.get(_ARRAY, np.zeros(0))
    states = int(np.prod(grid.shape))
    if chances.shape != (states, grid.n_actions) or chances.dtype != np.float64:
        raise UserError(
            f"{path} must hold float64 of {states} states and {grid.n_actions} actions: make it "
            "again"
        )
    if not ((chances >= 0.0).all() and np.allclose(chances.sum(axis=1), 1.0, atol=1e-9)):
        raise UserError(f"{path} has a row that is no distribution: make it again")
    return TabularPolicy(grid, chances), {"content_sha256": header["sha256"], "world": name}
