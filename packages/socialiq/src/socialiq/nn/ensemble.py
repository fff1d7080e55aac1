"""Ensembles: the mean of several networks' action values as one policy, saved in one file.

The values are averaged, not the action probabilities. Errors of values that differ between training
seeds cancel in the mean, and an offset that a member adds to all actions of a state changes neither
the best action nor softmax(Q/τ) of the mean. A mean of probabilities would be a policy that draws
a member at each decision: it keeps the errors of each, and has no values for online planning.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.nn import actor_policy
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.value_policy import ValuePolicy
from socialiq.storage import kind_of, load_arrays, save_arrays

KIND = "ensemble"
SCHEMA_VERSION = 1
MOST_MEMBERS = 32


@dataclass(frozen=True)
class EnsemblePolicy(ValuePolicy):
    """Policy that selects actions by the mean of its members' values.

    Attributes:
        members: Networks of any structure, for one kind of observation and one set of actions.
        temperature: τ of softmax(mean Q/τ).
        provenance: JSON-compatible record of how the ensemble was made; members have their own.
        rng: Generator of the stochastic policy's draws.
        sha256: SHA-256 of the file's content, for an ensemble that was loaded.
    """

    members: tuple[QPolicy, ...]
    temperature: float
    provenance: Mapping[str, Any] = field(default_factory=dict)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    sha256: str = ""

    @staticmethod
    def of(
        members: Sequence[QPolicy | EnsemblePolicy], provenance: Mapping[str, Any] | None = None
    ) -> EnsemblePolicy:
        """Build the ensemble of some policies; members of ensembles among them become its own.

        Args:
            members: Policies of one temperature.
            provenance: How it was made. By default what all members record alike, such as the
                learner and the angle.

        Raises:
            UserError: If there are none or too many, or they differ in features, actions or
                temperature.
        """
        flat = tuple(one for member in members for one in members_of(member))
        if fault := _fault(flat):
            raise UserError(f"an ensemble {fault}")
        known = _common([one.provenance for one in flat]) if provenance is None else provenance
        return EnsemblePolicy(flat, flat[0].temperature, known)

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return self.members[0].n_features

    @property
    def n_actions(self) -> int:
        """Number of actions."""
        return self.members[0].n_actions

    def q_values(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Return the mean of the members' Q of each observation and action.

        Raises:
            UserError: If an observation has another length or is not finite.
        """
        total = sum(member.q_values(observations) for member in self.members)
        return np.asarray(total / np.float32(len(self.members)))

    def save(self, path: Path, replace: bool = True) -> str:
        """Write the ensemble to one safetensors file.

        Args:
            path: The file; its folder must exist.
            replace: Whether a file there is replaced.

        Returns:
            SHA-256 of the content.

        Raises:
            UserError: If the file can't be written.
        """
        return save_arrays(path, KIND, SCHEMA_VERSION, *self.content(), replace=replace)

    @staticmethod
    def load(path: Path) -> EnsemblePolicy:
        """Read an ensemble written by `save`.

        Raises:
            UserError: If the file is missing, damaged, or holds something else.
        """
        return EnsemblePolicy.checked(path, *load_arrays(path, KIND, SCHEMA_VERSION))

    @staticmethod
    def checked(
        path: Path, arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]
    ) -> EnsemblePolicy:
        """Build an ensemble from a file's content, after a check that its parts agree.

        Raises:
            UserError: If they don't agree.
        """
        listed, provenance = header.get("members"), header.get("provenance")
        if not (isinstance(listed, list) and isinstance(provenance, dict)):
            raise UserError(f"{path} lists no members: make the file again")
        if len(listed) > MOST_MEMBERS or not all(isinstance(one, dict) for one in listed):
            raise UserError(f"{path} has a member that is no network: make the file again")
        members = tuple(
            QPolicy.checked(path, _arrays_of(arrays, number), {**one, "sha256": ""})
            for number, one in enumerate(listed)
        )
        if fault := _fault(members):
            raise UserError(f"{path} {fault}: make the file again")
        temperature = members[0].temperature
        return EnsemblePolicy(members, temperature, provenance, sha256=str(header["sha256"]))

    def content(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return the named arrays and the header of the ensemble's file."""
        contents = [member.content() for member in self.members]
        arrays = {
            _prefix(number) + name: array
            for number, (held, _) in enumerate(contents)
            for name, array in held.items()
        }
        header = {
            "members": [header for _, header in contents],
            "provenance": dict(self.provenance),
        }
        return arrays, header


def load_values(path: Path) -> QPolicy | EnsemblePolicy:
    """Read a file of one network or of an ensemble.

    Raises:
        UserError: If the file is missing, damaged, or holds something else.
    """
    kind = kind_of(path)
    if kind in (actor_policy.KIND, actor_policy.DIAL_KIND):
        raise UserError(f"{path} has continuous actions: name a policy of discrete ones")
    return EnsemblePolicy.load(path) if kind == KIND else QPolicy.load(path)


def members_of(policy: Any) -> tuple[Any, ...]:
    """Return the networks of a policy: its members, or itself."""
    return policy.members if isinstance(policy, EnsemblePolicy) else (policy,)


def _prefix(number: int) -> str:
    return f"member_{number}."


def _arrays_of(arrays: Mapping[str, np.ndarray], number: int) -> dict[str, np.ndarray]:
    prefix = _prefix(number)
    return {name[len(prefix) :]: one for name, one in arrays.items() if name.startswith(prefix)}


def _fault(members: Sequence[ValuePolicy]) -> str:
    """Return what is wrong with the members, or ""."""
    if not 1 <= len(members) <= MOST_MEMBERS:
        return f"must have 1 to {MOST_MEMBERS} members, got {len(members)}"
    if len({(one.n_features, one.n_actions) for one in members}) > 1:
        return "must have members for one world: they differ in features or actions"
    if len({one.temperature for one in members}) > 1:
        return "must have members of one temperature"
    return ""


def _common(records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the entries that all records have alike, also within their objects."""
    first, *others = records
    found: dict[str, Any] = {}
    for name, value in first.items():
        values = [one.get(name) for one in others]
        if isinstance(value, Mapping) and all(isinstance(one, Mapping) for one in values):
            found[name] = _common([value, *(one for one in values if one is not None)])
        elif all(one == value for one in values):
            found[name] = value
    return found
