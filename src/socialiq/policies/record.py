"""What a policy under audit is, in words that can be written into a report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, NamedTuple

from socialiq.errors import UserError
from socialiq.types import Policy


class Interface(NamedTuple):
    """What a driver sees and may do.

    Attributes:
        n_features: Length of an observation.
        n_actions: Number of actions.
    """

    n_features: int
    n_actions: int

    def check(self, source: str, world: Interface) -> None:
        """Refuse a policy that was made for another world.

        Raises:
            UserError: If either number is not the world's.
        """
        if self != world:
            raise UserError(
                f"{source} takes {self.n_features} features and {self.n_actions} actions, the "
                f"world has {world.n_features} and {world.n_actions}: name the world it was made "
                "for"
            )


@dataclass(frozen=True)
class Record:
    """A plain account of a policy.

    Attributes:
        kind: "policy", "dial", "table", "sb3", "onnx", "process" or "python".
        source: The specification that it was loaded from, as one printable line.
        sha256: Of the file's bytes. Of a process: of its command and of the files named in it. Of
            Python: of the module's source. `covers` says which.
        covers: What `sha256` is the hash of.
        interface: What it sees and may do.
        soft: Whether it tells the distribution that it draws from, if not asked for its best.
        details: What else its file tells, all of it JSON.
    """

    kind: str
    source: str
    sha256: str
    covers: str
    interface: Interface
    soft: bool
    details: Mapping[str, Any] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """The same as one JSON object."""
        named = {name: getattr(self, name) for name in ("kind", "source", "sha256", "covers")}
        return {**named, **self.interface._asdict(), "soft": self.soft, **self.details}


def _nothing() -> None:
    pass


@dataclass(frozen=True)
class Loaded:
    """A policy under audit and its record; a context, because a process must be ended.

    Attributes:
        policy: Decides, as `types.Policy`.
        record: What it is.
        close: Ends what the policy holds open. To call it twice does no harm.
    """

    policy: Policy
    record: Record
    close: Callable[[], None] = _nothing

    def __enter__(self) -> Loaded:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
