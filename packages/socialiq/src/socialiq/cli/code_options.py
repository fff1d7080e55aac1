"""Options of policies that are code, the same in every command that runs them for an audit."""

from __future__ import annotations

from dataclasses import dataclass

import tyro

from socialiq.audit.request import Trust
from socialiq.policies.isolation import IsolationMode
from socialiq.policies.process import limits_of


@dataclass(frozen=True)
class CodeOptions:
    """Permissions and limits of a policy that is a process or a Python module."""

    allow_code: bool = False
    """Import the Python module of the declaration's environment, and run named Python modules that
    can't be isolated: their authors' code runs with your rights."""
    isolation: IsolationMode = "auto"
    """Isolation of processes and Python modules by bubblewrap: where it works, always, or never."""
    files: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """A further file or folder of a policy that is a process or a Python module: its hash covers
    it, and only what is covered is visible to an isolated one."""
    step_seconds: float = 5.0
    """Seconds within which a process must answer."""
    memory_gib: float = 8.0
    """Limit of the address space of each process of a policy, GiB; 0 for no limit."""

    @property
    def trust(self) -> Trust:
        """Permissions for `resolve_policy`."""
        limits = limits_of(self.step_seconds, self.memory_gib)
        return Trust(self.allow_code, limits, self.isolation, tuple(self.files))
