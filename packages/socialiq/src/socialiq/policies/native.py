"""Files of this package as policies: policies, ensembles, dials and tables.

The container's checksum detects damage; it is not a signature. So the header is checked against
the arrays before it is used (`nn.file_checks`).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.nn import actor_policy, dial_policy, ensemble, q_policy
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.ensemble import EnsemblePolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.policies.interface import Interface
from socialiq.storage import kind_of, load_arrays, save_arrays
from socialiq.worlds import context_policy
from socialiq.worlds.context_policy import ContextPolicy
from socialiq.worlds.registry import GRIDWORLDS, make_grid
from socialiq.worlds.tabular_policy import TabularPolicy

MOST_PROVENANCE = 65_536
"""Characters of a file's header, which goes into reports."""


def read_policy(path: Path, world: Interface | None) -> tuple[QPolicy, dict[str, Any]]:
    """Read a policy that `QPolicy.save` wrote.

    Args:
        path: The file.
        world: The interface that it must have, if any.

    Returns:
        The policy, and details from the file.

    Raises:
        UserError: If the file is missing, damaged, holds something else, or doesn't fit the world.
    """
    arrays, header = load_arrays(path, "policy", q_policy.SCHEMA_VERSION)
    _check_size(path, header)
    policy = QPolicy.checked(path, arrays, header)
    if world is not None:
        Interface(policy.n_features, policy.n_actions).check(str(path), world)
    return policy, _details(policy, header)


def read_ensemble(path: Path, world: Interface | None) -> tuple[EnsemblePolicy, dict[str, Any]]:
    """Read an ensemble that `EnsemblePolicy.save` wrote.

    Args:
        path: The file.
        world: The interface that it must have, if any.

    Returns:
        The policy, and details from the file.

    Raises:
        UserError: If the file is missing, damaged, holds something else, or doesn't fit the world.
    """
    arrays, header = load_arrays(path, ensemble.KIND, ensemble.SCHEMA_VERSION)
    _check_size(path, header)
    policy = EnsemblePolicy.checked(path, arrays, header)
    if world is not None:
        Interface(policy.n_features, policy.n_actions).check(str(path), world)
    members = [
        _details(one, stored) for one, stored in zip(policy.members, header["members"], strict=True)
    ]
    return policy, {
        "content_sha256": policy.sha256,
        "temperature": policy.temperature,
        "members": members,
        "provenance": header["provenance"],
    }


def read_dial(
    path: Path, angle: float | None, world: Interface | None
) -> tuple[QPolicy, dict[str, Any]]:
    """Read a dial that `DialPolicy.save` wrote, at one angle in degrees.

    Args:
        path: The file.
        angle: Degrees.
        world: The interface that it must have, if any.

    Returns:
        The policy, and details from the file.

    Raises:
        UserError: As `read_policy`; if there is no angle, or the dial was not trained for it.
    """
    arrays, header = load_arrays(path, "dial", dial_policy.VERSIONS)
    if angle is None:
        raise UserError(f"{path} is a dial: name an angle")
    _check_size(path, header)
    dial = DialPolicy.checked(path, arrays, header)
    if world is not None:
        Interface(dial.n_features, dial.n_actions).check(str(path), world)
    policy = dial.at(angle)
    return policy, _details(policy, header) | {"angle": angle, "low": dial.low, "high": dial.high}


def read_actor(
    path: Path, angle: float | None, world: Interface | None
) -> tuple[ActorPolicy, dict[str, Any]]:
    """Read a policy of continuous actions, or a dial of these at one angle.

    Args:
        path: The file.
        angle: Of a dial, in degrees; without use for a policy.
        world: The interface that it must have, if any.

    Returns:
        The policy, and details from the file.

    Raises:
        UserError: If the file is missing, damaged, holds something else, or doesn't fit the world;
            if a dial has no angle, or was not trained for it.
    """
    kind = kind_of(path)
    is_dial = kind == actor_policy.DIAL_KIND
    arrays, header = load_arrays(
        path, kind if is_dial else actor_policy.KIND, actor_policy.SCHEMA_VERSION
    )
    _check_size(path, header)
    if is_dial:
        if angle is None:
            raise UserError(f"{path} is a dial: name an angle")
        policy = ActorDial.checked(path, arrays, header).at(angle)
    else:
        policy = ActorPolicy.checked(path, arrays, header)
    if world is not None:
        Interface(policy.n_features, 0, policy.action_size).check(str(path), world)
    details = {
        "content_sha256": policy.sha256,
        "activation": policy.activation,
        "action_size": policy.action_size,
        "layers": [policy.n_features, *(len(bias) for bias in policy.biases)],
        "provenance": header["provenance"],
    }
    of_dial = {"angle": angle, "low": header["low"], "high": header["high"]} if is_dial else {}
    return policy, details | of_dial


def read_context(path: Path, world: Interface | None) -> tuple[ContextPolicy, dict[str, Any]]:
    """Read a dial with a rule of its angle, that `ContextPolicy.save` wrote.

    Args:
        path: The file.
        world: The interface that it must have, if any.

    Returns:
        The policy, and details from the file.

    Raises:
        UserError: If the file is missing, damaged, holds something else, or doesn't fit the world.
    """
    arrays, header = load_arrays(path, context_policy.KIND, context_policy.SCHEMA_VERSION)
    _check_size(path, header)
    policy = ContextPolicy.checked(path, arrays, header)
    if world is not None:
        Interface(policy.n_features, policy.n_actions).check(str(path), world)
    found = _details(policy.dial.turned, header) | {"rule": policy.rule.as_json()}
    return policy, found | {"low": policy.dial.low, "high": policy.dial.high}


def _details(policy: QPolicy, header: dict[str, Any]) -> dict[str, Any]:
    return {
        "content_sha256": policy.sha256,
        "activation": policy.activation,
        "temperature": policy.temperature,
        "layers": [policy.n_features, *(len(bias) for bias in policy.biases)],
        "view": header.get("view") or header.get("one_hot"),
        "provenance": header["provenance"],
    }


def _refusal(path: Path, fault: str) -> UserError:
    return UserError(f"{path} {fault}: make the file again")


def _check_size(path: Path, header: dict[str, Any]) -> None:
    """Refuse a header that is too long for a report."""
    if len(json.dumps(header)) > MOST_PROVENANCE:
        raise _refusal(path, f"has a header of more than {MOST_PROVENANCE:,} characters")


_TABLE_KIND = "table"
_TABLE_VERSION = 1
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
    return save_arrays(path, _TABLE_KIND, _TABLE_VERSION, {_ARRAY: policy.probabilities}, header)


def read_table(path: Path, world: Interface) -> tuple[TabularPolicy, dict[str, Any]]:
    """Read a table that `save_table` wrote.

    Returns:
        The policy, and details from the file.

    Raises:
        UserError: If the file is missing or damaged, is for another world or other options of it,
            or has a row that is not a distribution.
    """
    arrays, header = load_arrays(path, _TABLE_KIND, _TABLE_VERSION)
    name = header.get("world")
    if not isinstance(name, str) or name not in GRIDWORLDS:
        raise UserError(f"{path} is not for a world of {', '.join(GRIDWORLDS)}: make it again")
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
        raise UserError(f"{path} has a row that is not a distribution: make it again")
    return TabularPolicy(grid, chances), {"content_sha256": header["sha256"], "world": name}
