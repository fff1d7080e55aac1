"""Files and policies that a word of the command line names, as views of the page.

Another distribution adds its files by entry points of the group `socialiq.views`: the name is a
kind of file (`storage.kind_of`) or the end of a file's name, the object a function from its path to
a `View`.
"""

from __future__ import annotations

from importlib.metadata import EntryPoint
from pathlib import Path

from socialiq.audit.profile.profile import world_of
from socialiq.audit.report.folder import REPORT
from socialiq.audit.report.verify import read_report
from socialiq.audit.request import Trust
from socialiq.demonstrations.files import KIND as DEMONSTRATIONS
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.social.angle import angle_of
from socialiq.storage import kind_of, shipped
from socialiq.types import Ending
from socialiq.view import View
from socialiq.view.demonstrations import demonstrations_view
from socialiq.view.policy import policy_view
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import installed, loaded

FIRST_ANGLE = 45.0
"""Angle of a dial at the start, degrees."""

GROUP = "socialiq.views"
_OF_RECORDINGS = "socialiq_recordings.view:recording_view"


def opened(what: str, angle: float | None, trust: Trust) -> View:
    """Return a policy or a file as content of the page.

    Args:
        what: Folder of an audit, file of demonstrations or of recorded traffic, or a policy as
            `audit.request.resolve_policy` takes it.
        angle: Angle of a dial at the start, degrees; None unless the user gave one.
        trust: Permissions of a policy that is code.

    Raises:
        UserError: If it can't be read, is of another world, or an angle is given that has no use.
    """
    path = shipped(Path(what))
    kind, suffix, show = kind_of(path), path.suffix.lower(), None
    no_dial = UserError(f"--angle is of a dial, which {one_line(what)} is not: leave it out")
    if path.is_dir():
        show = audit_view
    elif suffix in (".csv", ".parquet", ".osm") and path.is_file():
        raise UserError(
            f"{one_line(str(path))}: import recorded traffic first, by `socialiq data import`, "
            "and name the file that it makes"
        )
    elif kind == DEMONSTRATIONS:
        show = demonstrations_view
    else:
        readers = {name: EntryPoint(name, _OF_RECORDINGS, GROUP) for name in ("recording", ".xml")}
        readers |= installed(GROUP)
        reader = readers.get(kind) or readers.get(suffix)
        show = None if reader is None else loaded(reader, one_line(str(path)))
    if show is not None:
        if angle is not None:
            raise no_dial
        return show(path)
    view = policy_view(what, FIRST_ANGLE if angle is None else angle, trust)
    if "dial" not in view.data and angle is not None:
        view.close()
        raise no_dial
    return view


def audit_view(folder: Path) -> View:
    """Return an audit as content of the page: its episodes, the worst first, and all drivers.

    Raises:
        UserError: If its report can't be read, or has no episode of the intersection.
    """
    report = read_report(folder / REPORT)
    verdict, declared = report["verdict"], report["declaration"]
    scenario = declared["scenario"]
    if scenario["world"] != "intersection":
        raise UserError(
            f"{folder} is an audit in {one_line(str(scenario['world']), 60)}: view replays those "
            "at the intersection; open its report.html"
        )
    world = world_of(scenario["world"], scenario["options"])
    assert isinstance(world, Intersection)
    endings = {"arrival": Ending.ARRIVAL, "timeout": Ending.TIMEOUT}
    episodes = [
        {
            "mode": f"{kind} {number}, episode {row['episode']} of the audit",
            "seed": row["seed"],
            "steps": list(range(row["decisions"])),
            "actions": [int(digit) for digit in row["trace"]["actions"]],
            "totals": [row["r_env"], row["r_social"]],
            "ending": int(endings.get(row["ending"], Ending.COLLISION)),
        }
        for kind in ("worst", "median")
        for number, row in enumerate(report["episodes"][kind], 1)
        if row["trace"] and row["trace"]["actions"]
    ]
    if not episodes:
        raise UserError(
            f"{folder} holds no decisions of an episode: its policy did not drive the same again; "
            "open its report.html"
        )
    drivers = [
        {
            "mode": one_line(row["name"], 60),
            "episodes": verdict["episodes"],
            # The report has intervals of the tests, not of each mean.
            "env": [row["r_env"]] * 3,
            "social": [row["r_social"]] * 3,
            "angle": angle_of(row["r_env"], row["r_social"]),
            "arrival": row["arrival"],
            "collision": row["at_fault"] + row["struck"],
        }
        for row in (report["policy"]["means"], *report["references"])
    ]
    reasons = [episode["mode"].partition(",")[0] for episode in episodes]
    notable = [{"episode": number, "why": why} for number, why in enumerate(reasons)]
    return View(
        kind="episodes",
        title=f"Audit of {one_line(report['policy']['record']['source'], 60)}",
        lead=f"{verdict['decision'].capitalize()}, declared at {declared['angle']:g}°. "
        f"{one_line(verdict['reason'], 400)}",
        data={"modes": drivers, "notable": notable, "curve": world.options == Options()},
        count=len(episodes),
        part=episodes.__getitem__,
        options=world.options,
    )
