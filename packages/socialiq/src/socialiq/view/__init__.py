"""The page over a local server: a user's policy, demonstrations, audit or recording in it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from socialiq.worlds.intersection.options import Options

Decide = Callable[[Mapping[str, Any]], Mapping[str, Any]]
"""Answer to a question of the page, both JSON-compatible; a `UserError` is shown on the page."""


@dataclass(frozen=True)
class View:
    """A user's file as content of the page."""

    kind: str  # script that shows it: "policy", "episodes" or "traffic"
    title: str  # heading of the page
    lead: str  # sentence below it
    data: Mapping[str, Any]  # what the page knows from the start, JSON-compatible
    count: int = 0  # number of further parts, which the page fetches by their number
    part: Callable[[int], Mapping[str, Any]] = lambda _: {}  # returns one of them, JSON-compatible
    options: Options = field(default_factory=Options)  # scenario of the core that the page drives
    decide: Decide | None = None  # answers the questions of a policy's page
    # ends what runs for it, a policy's process for instance
    close: Callable[[], None] = lambda: None
