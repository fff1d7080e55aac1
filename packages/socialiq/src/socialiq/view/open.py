"""Files and policies that a word of the command line names, as views of the page.

Another distribution adds its files by entry points of the group `socialiq.views`: the name is a
kind of file (`storage.kind_of`) or the end of a file's name, the object a function from its path to
a `View`.
"""

import contextlib
from collections.abc import Mapping
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.audit.profile.profile import world_of
from socialiq.audit.report.folder import REPORT
from socialiq.audit.report.verify import read_report
from socialiq.audit.request import Trust, resolve_policy
from socialiq.demonstrations.files import KIND as DEMONSTRATIONS
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.nn.dial_policy import DialPolicy
from socialiq.policies.interface import Loaded
from socialiq.social.angle import angle_of
from socialiq.storage import kind_of, shipped
from socialiq.types import Ending, Policy
from socialiq.view import View
from socialiq.view.demonstrations import demonstrations_view
from socialiq.view.driven import FIRST_ANGLE, driven_view
from socialiq.worlds.files import installed, loaded
from socialiq.worlds.grammar import road_of
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.world import with_time

GROUP = "socialiq.views"
_OF_RECORDINGS = "socialiq_recordings.view:recording_view"


def opened(what: str, angle: float | None, trust: Trust, world: str = "intersection") -> View:
    """Return a policy or a file as content of the page.

    In another world than the intersection a policy's episodes are driven here and shown.

    Args:
        what: Folder of an audit, file of demonstrations or of recorded traffic, or a policy as
            `audit.request.resolve_policy` takes it.
        angle: Angle of a dial in degrees; None for the default, or for what has no angle.
        trust: Permissions of a policy that is code.
        world: World of a policy.

    Raises:
        UserError: If it can't be read, belongs to another world, or an angle is given that has no
            use.
    """
    path = shipped(Path(what))
    if world != "intersection":
        return driven_view(what, world, angle, trust)
    kind = kind_of(path)
    suffix = path.suffix.lower()
    show = None
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
    verdict = report["verdict"]
    declared = report["declaration"]
    scenario = declared["scenario"]
    if scenario["world"] != "intersection":
        raise UserError(
            f"{folder} is an audit in {one_line(str(scenario['world']), 60)}: view replays those "
            "at the intersection; open its report.html"
        )
    world: Any = world_of(scenario["world"], scenario["options"])
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


MOST_ROWS = 64
"""Largest number of observations in one question of the page."""


class PolicyDecider:
    """Decisions of one policy, or of a dial at the angle that the page asks for.

    Raises:
        UserError: If it can't be read, or is made for another world.
    """

    def __init__(self, spec: str, angle: float, trust: Trust) -> None:
        self._spec = spec
        self._trust = trust
        self._world = road_of()
        self._open = contextlib.ExitStack()
        self._angle = angle
        self.loaded = self._load(angle)
        self._policies: dict[float, Policy] = {angle: self.loaded.policy}
        self.close = self._open.close

    @property
    def turns(self) -> bool:
        """Whether the policy is a dial."""
        return self.loaded.record.kind == "dial"

    def decide(self, question: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the `actions` of some observations, one for each.

        The question has `observations`, rows of the world's features; `decisions`, how many each
        episode has had; and `angle` in degrees, of a dial. `UserError` if it is malformed, or the
        policy fails.
        """
        n_features = self._world.n_features
        unknown = UserError("the page asked in a way that is not known: reload it")
        try:
            observations = np.array(question["observations"], np.float32)
            times = np.array(question["decisions"], np.float32)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise unknown from error
        rows = len(observations) if observations.ndim == 2 else 0
        fits = 1 <= rows <= MOST_ROWS and times.shape == (rows,)
        if not fits or observations.shape[1] != n_features or not np.isfinite(observations).all():
            raise unknown
        clock = self.loaded.record.interface.n_features == n_features + 1
        observations = with_time(observations, times, clock)
        angle = question.get("angle")
        degrees = self._angle
        if self.turns and angle is not None:
            if not isinstance(angle, int | float) or not 0 <= angle < 360:
                raise UserError("the page asked for no angle: reload it")
            degrees = float(angle)
        if degrees not in self._policies:
            if len(self._policies) > 360:
                raise UserError("the page asked for too many angles: reload it")
            self._policies[degrees] = self._load(degrees).policy
        chosen, _ = self._policies[degrees].predict(observations, deterministic=True)
        return {"actions": np.asarray(chosen).astype(int).tolist()}

    def _load(self, angle: float) -> Loaded:
        return self._open.enter_context(resolve_policy(self._spec, self._world, angle, self._trust))


def policy_view(spec: str, angle: float, trust: Trust) -> View:
    """Return a policy, as `resolve_policy` takes it, as content of the page.

    Raises:
        UserError: If it can't be read, or is made for another world.
    """
    decider = PolicyDecider(spec, angle, trust)
    record = decider.loaded.record
    name = one_line(spec if ":" in spec else Path(spec).name, 60)
    data: dict[str, Any] = {"name": name, "policy": record.kind, "sha256": record.sha256}
    if decider.turns:
        dial = DialPolicy.load(Path(spec))
        data |= {"dial": {"angle": angle, "low": dial.low, "high": dial.high}}
    return View(
        kind="policy",
        title=name,
        lead="Your policy on the same seeds as the dial of the package. It decides in Python, the "
        "traffic runs in this page.",
        data=data,
        decide=decider.decide,
        close=decider.close,
    )
