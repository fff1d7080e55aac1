"""`data decisions`: accelerations and steering of recorded drivers, and the rate data support."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from socialiq.cli.output import print_json, print_table, say
from socialiq.errors import UserError
from socialiq.types import Row
from socialiq_lab.results import Results, check_target, save
from socialiq_recordings.cli.recorded_files import Choices, sources_of, swap_all
from socialiq_recordings.episodes import support
from socialiq_recordings.episodes.annotate import Driven
from socialiq_recordings.episodes.decisions import Decisions, decisions_at
from socialiq_recordings.episodes.ego_swap import Swapped
from socialiq_recordings.episodes.scene import Scene
from socialiq_recordings.identity.once import tracks_once
from socialiq_recordings.recording import Recording

_Choices = tyro.conf.OmitArgPrefixes[Choices]


@dataclass(frozen=True)
class Decide:
    """List drivers' accelerations and steering, and the rate of decisions that the data support.

    Example: socialiq data decisions junction.safetensors --out decisions
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of `socialiq data import`."""
    out: Path | None = None
    """Folder to write: every decision, the rates, the discretisations."""
    choices: _Choices = dataclasses.field(default_factory=Choices)
    replace: bool = False
    """Replace earlier results in the folder."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Measure, write, print."""
        if self.out is not None:
            check_target(self.out, self.replace)
        recorded, identified, swapped = swap_all(self.recordings, self.choices, self.json)
        every = [one.tracks for one in recorded]
        if self.choices.duplicates == "drop":
            every = tracks_once(every, identified)
        rates = support.rates(every)
        config = self.choices.config()
        driven = [one for each in swapped for one in each.episodes]
        if not driven:
            raise UserError(
                "no vehicle of these recordings meets a conflict: `socialiq data demonstrations` "
                "lists the reasons"
            )
        dts = [r.tracks.dt for r, s in zip(recorded, swapped, strict=True) for _ in s.episodes]
        kinds = support.left_out(driven, dts, config)
        seconds = support.supported(rates)
        rows = _rows(recorded, swapped)
        summary = {
            "supported_seconds": seconds,
            "decision_seconds": 1 / config.policy_rate,
            "position_rms": _rms([row["ahead"] for row in rows], [row["beside"] for row in rows]),
            "discretisations": {row["actions"]: row for row in kinds},
        }
        tables = {"rates": rates, "discretisations": kinds}
        if self.out is not None:
            asked = _Asked(self.choices, sources_of(swapped))
            results = Results.of(
                "recordings decisions", asked, tables | {"decisions": rows}, summary
            )
            save(results, self.out, {}, self.replace)
        if self.json:
            print_json(summary | tables)
        else:
            _show(rates, kinds, seconds, config.policy_rate)
        return 0


@dataclass(frozen=True)
class _Asked:
    """Provenance of the decisions."""

    choices: Choices
    sources: list[dict[str, Any]]


def _show(rates: list[Row], kinds: list[Row], seconds: float | None, rate: int) -> None:
    print_table(rates, "Accelerations measured twice, by speeds and by positions")
    print_table(kinds, "\nWhat the actions leave out, by decision")
    if seconds is None or seconds > 1 / rate:
        which = "none of these durations" if seconds is None else f"{seconds:g} s"
        say(
            f"these recordings support decisions of {which}, and yours last {1 / rate:g} s: "
            "accelerations are mostly error there"
        )


def _rms(ahead: list[float], beside: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(ahead) + np.square(beside))))


def _rows(recorded: list[Recording], swapped: list[Swapped]) -> list[Row]:
    rows: list[Row] = []
    for recording, each in zip(recorded, swapped, strict=True):
        scene = Scene(recording)
        for driven in each.episodes:
            first = scene.rows(driven.track).start
            found = decisions_at(scene, first + driven.frame - int(scene.tracks.frame[first]))
            rows += _of(each.recording, int(scene.tracks.identity[driven.track]), driven, found)
    return rows


def _of(recording: str, identity: int, driven: Driven, found: Decisions) -> list[Row]:
    return [
        {
            "recording": recording,
            "vehicle": identity,
            "frame": int(driven.frame[k]),
            "speed": float(driven.speed[k]),
            "action": int(driven.action[k]),
            "residual": float(driven.residual[k]),
            **{name: getattr(found, name)[k].item() for name in Decisions._fields},
        }
        for k in range(len(driven.action))
    ]
