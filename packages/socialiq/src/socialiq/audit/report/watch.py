"""Program that replays a report's episodes in its page, by the compiled core as WebAssembly.

The page holds the decisions, not a film: the core drives each episode again from its seed, so the
reader sees every signal, and whether the rewards are those of the report.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from socialiq.audit.profile.scenario import world_of
from socialiq.page.bundle import program
from socialiq.page.content import core
from socialiq.page.write import embedded, source_hash
from socialiq.worlds.intersection.world import Intersection

_KEPT = ("seed", "r_env", "r_social", "ending", "decisions")


class Replays(NamedTuple):
    """Program and data that replay episodes in a page.

    Attributes:
        program: The script.
        data: Its data as JSON: the core, its layout, and the episodes.
        allowed: Sources of scripts that the page's content security policy allows.
    """

    program: str
    data: str
    allowed: str


def replays(report: Mapping[str, Any]) -> Replays | None:
    """Return the replays of a report's episodes; None where none has decisions.

    Args:
        report: Content of `report.json`.

    Raises:
        UserError: If its scenario is not one of the intersection's.
    """
    rows = [
        {"kind": kind, "number": number, "actions": row["trace"]["actions"]}
        | {name: row[name] for name in _KEPT}
        for kind, rows in sorted(report["episodes"].items(), reverse=True)
        for number, row in enumerate(rows, 1)
        if row["trace"] and row["trace"]["actions"]
    ]
    scenario = report["declaration"]["scenario"]
    if not rows or scenario["world"] != "intersection":
        return None
    world = world_of(scenario["world"], scenario["options"])
    assert isinstance(world, Intersection)
    script = program("watch")
    data = embedded({**core(world.options), "episodes": rows})
    return Replays(script, data, f"{source_hash(script)} 'wasm-unsafe-eval'")
