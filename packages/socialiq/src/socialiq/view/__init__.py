"""The page over a local server: a user's policy, demonstrations, audit or recording in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from socialiq.worlds.intersection.options import Options

Decide = Callable[[Mapping[str, Any]], Mapping[str, Any]]
"""Answer to a question of the page, both JSON-compatible; a `UserError` is shown on the page."""


@dataclass(frozen=True)
class View:
    """A user's file as content of the page.

    Attributes:
        kind: Script that shows it: "policy", "episodes" or "traffic".
        title: Heading of the page.
        lead: Sentence below it.
        data: What the page knows from the start, JSON-compatible.
        count: Number of further parts, which the page fetches by their number.
        part: Returns one of them, JSON-compatible.
        options: Scenario of the core that the page drives.
        decide: Answers the questions of a policy's page.
        close: Ends what runs for it, a policy's process for instance.
    """

    kind: str
    title: str
    lead: str
    data: Mapping[str, Any]
    count: int = 0
    part: Callable[[int], Mapping[str, Any]] = lambda _: {}
    options: Options = field(default_factory=Options)
    decide: Decide | None = None
    close: Callable[[], None] = lambda: None
