"""An audit in the page: its worst and median episodes replayed, and the drivers it compared."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from socialiq.audit.profile.profile import world_of
from socialiq.audit.report.folder import REPORT
from socialiq.audit.report.verify import read_report
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.social.angle import angle_of
from socialiq.types import Ending
from socialiq.view import View
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection

ENDINGS = {"arrival": Ending.ARRIVAL, "timeout": Ending.TIMEOUT}
"""Endings by their names in a report; every other name is a kind of collision."""


def audit_view(folder: Path) -> View:
    """Return an audit as content of the page.

    Args:
        folder: Folder of `socialiq audit`.

    Raises:
        UserError: If its report is missing, damaged or of another version, or has no episode of
            the intersection with its decisions.
    """
    report = read_report(folder / REPORT)
    options = _options(folder, report)
    episodes = _episodes(report)
    if not episodes:
        raise UserError(
            f"{folder} holds no decisions of an episode: its policy did not drive the same again; "
            "open its report.html"
        )
    verdict, declared = report["verdict"], report["declaration"]
    return View(
        kind="episodes",
        title=f"Audit of {one_line(report['policy']['record']['source'], 60)}",
        lead=f"{verdict['decision'].capitalize()}, declared at {declared['angle']:g}°. "
        f"{one_line(verdict['reason'], 400)}",
        data={
            "modes": _drivers(report),
            "notable": [
                {"episode": number, "why": episode["mode"].partition(",")[0]}
                for number, episode in enumerate(episodes)
            ],
            "curve": options == Options(),
        },
        count=len(episodes),
        part=episodes.__getitem__,
        options=options,
    )


def _options(folder: Path, report: Mapping[str, Any]) -> Options:
    """Return the scenario of a report at the intersection."""
    scenario = report["declaration"]["scenario"]
    if scenario["world"] != "intersection":
        raise UserError(
            f"{folder} is an audit in {one_line(str(scenario['world']), 60)}: view replays those "
            "at the intersection; open its report.html"
        )
    world = world_of(scenario["world"], scenario["options"])
    assert isinstance(world, Intersection)
    return world.options


def _episodes(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the episodes whose decisions are known, the worst first."""
    return [
        {
            "mode": f"{kind} {number}, episode {row['episode']} of the audit",
            "seed": row["seed"],
            "steps": list(range(row["decisions"])),
            "actions": [int(digit) for digit in row["trace"]["actions"]],
            "totals": [row["r_env"], row["r_social"]],
            "ending": int(ENDINGS.get(row["ending"], Ending.COLLISION)),
        }
        for kind in ("worst", "median")
        for number, row in enumerate(report["episodes"][kind], 1)
        if row["trace"] and row["trace"]["actions"]
    ]


def _drivers(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the means of the policy and of the drivers that it was compared with."""
    episodes = report["verdict"]["episodes"]
    return [
        {
            "mode": one_line(row["name"], 60),
            "episodes": episodes,
            # The report has intervals of the tests, not of each mean.
            "env": [row["r_env"]] * 3,
            "social": [row["r_social"]] * 3,
            "angle": angle_of(row["r_env"], row["r_social"]),
            "arrival": row["arrival"],
            "collision": row["at_fault"] + row["struck"],
        }
        for row in (report["policy"]["means"], *report["references"])
    ]
