"""Ensembles: the mean of several networks' action values as one policy, saved in one file.

The values are averaged, not the action probabilities. Errors of values that differ between training
seeds cancel in the mean, and an offset that a member adds to all actions of a state changes neither
the best action nor softmax(Q/τ) of the mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.nn.q_policy import QPolicy, ValuePolicy
from socialiq.nn.saved import Arrays, Header, load_one_of, refusal
from socialiq.storage import kind_of

MOST_MEMBERS = 32


@dataclass(frozen=True, repr=False)
class EnsemblePolicy(ValuePolicy):
    """Policy that selects actions by the mean of its members' values, with a record for the whole.

    Members are networks of any structure, for one kind of observation and one set of actions.
    """

    KIND = "ensemble"

    members: tuple[QPolicy, ...]
    temperature: float
    provenance: Mapping[str, Any] = field(default_factory=dict)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    sha256: str = ""

    @staticmethod
    def of(
        members: Sequence[QPolicy | EnsemblePolicy], provenance: Mapping[str, Any] | None = None
    ) -> EnsemblePolicy:
        """Build the ensemble of policies of one temperature; of ensembles it gets the members.

        Args:
            members: Networks, or ensembles of them.
            provenance: Record of the ensemble; None is what all members record alike, such as
                learner and angle.

        Returns:
            The ensemble; its members have no score of unlikeness.

        Raises:
            UserError: If there are none or too many, or they differ in features, actions or
                temperature.
        """
        networks = tuple(
            replace(network, unlikeness=None)  # which reads the features of one network
            for member in members
            for network in members_of(member)
        )
        if fault := _fault(networks):
            raise UserError(f"an ensemble {fault}")
        if provenance is None:
            provenance = _common([network.provenance for network in networks])
        return EnsemblePolicy(networks, networks[0].temperature, provenance)

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
        """Return the mean of the members' Q of each observation and action."""
        total = sum(member.q_values(observations) for member in self.members)
        return np.asarray(total / np.float32(len(self.members)))

    def content(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return the named arrays and the header of the ensemble's file."""
        contents = [member.content() for member in self.members]
        arrays = {
            f"member_{number}.{name}": array
            for number, (of_member, _) in enumerate(contents)
            for name, array in of_member.items()
        }
        headers = [header for _, header in contents]
        return arrays, {"members": headers, "provenance": dict(self.provenance)}

    @classmethod
    def checked(cls, path: Path, arrays: Arrays, header: Header) -> EnsemblePolicy:
        """Build an ensemble from a file's content, as `Saved.checked`.

        Args:
            path: The file, which errors name.
            arrays: Named arrays of the file, those of member n with the prefix `member_n.`.
            header: Header of the file.

        Returns:
            The ensemble.

        Raises:
            UserError: If arrays and header don't agree, or the members can't form an ensemble.
        """
        headers = header.get("members")
        provenance = header.get("provenance")
        if not (isinstance(headers, list) and isinstance(provenance, dict)):
            raise refusal(path, "lists no members")
        if len(headers) > MOST_MEMBERS or not all(isinstance(row, dict) for row in headers):
            raise refusal(path, "has a member that is no network")
        members: list[QPolicy] = []
        for number, row in enumerate(headers):
            names = [name for name in arrays if name.startswith(f"member_{number}.")]
            member_arrays = {name.partition(".")[2]: arrays[name] for name in names}
            members.append(QPolicy.checked(path, member_arrays, {**row, "sha256": ""}))
        if fault := _fault(members):
            raise refusal(path, fault)
        return cls(tuple(members), members[0].temperature, provenance, sha256=str(header["sha256"]))


def load_values(path: Path) -> QPolicy | EnsemblePolicy:
    """Read a file of one network or of an ensemble.

    Raises:
        UserError: If the file is missing, damaged, or holds something else.
    """
    if kind_of(path) in (ActorPolicy.KIND, ActorDial.KIND):
        raise UserError(f"{path} has continuous actions: name a policy of discrete ones")
    return load_one_of(path, (EnsemblePolicy, QPolicy))


def members_of(policy: Any) -> tuple[Any, ...]:
    """Return the networks of a policy: its members, or itself."""
    return policy.members if isinstance(policy, EnsemblePolicy) else (policy,)


def _fault(members: Sequence[ValuePolicy]) -> str:
    """Return what is wrong with the members, or ""."""
    if not 1 <= len(members) <= MOST_MEMBERS:
        return f"must have 1 to {MOST_MEMBERS} members, got {len(members)}"
    if len({(member.n_features, member.n_actions) for member in members}) > 1:
        return "must have members for one world: they differ in features or actions"
    if len({member.temperature for member in members}) > 1:
        return "must have members of one temperature"
    return ""


def _common(records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the entries that all records have alike, also within their objects."""
    first, *following = records
    common: dict[str, Any] = {}
    for name, value in first.items():
        values: list[Any] = [record.get(name) for record in following]
        if isinstance(value, Mapping) and all(isinstance(entry, Mapping) for entry in values):
            common[name] = _common([value, *values])
        elif all(entry == value for entry in values):
            common[name] = value
    return common
