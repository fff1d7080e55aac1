"""`data audit`: one recorded vehicle against a declaration."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.audit.profile.reader import load as load_profile
from socialiq.audit.recorded_vehicle import RecordedVerdict, episode_config, judge_recorded
from socialiq.audit.verdict.decision import Decision
from socialiq.cli.output import print_json, print_table
from socialiq.errors import UserError
from socialiq.recordings import files
from socialiq.recordings.episodes import ego_swap
from socialiq.recordings.readers.commonroad_road import road_of
from socialiq.recordings.recording import Recording
from socialiq.to_json import to_json


@dataclass(frozen=True)
class AuditRecorded:
    """Check whether a recorded vehicle's driving is consistent with a declared profile.

    Exit status: 0 consistent, 1 not consistent, 2 a mistake in the call, 3 undecided. A vehicle
    has few decisions, so most answers are 3. Regret can't be computed from a recording.

    Example: socialiq data audit junction.safetensors --track 17 --profile profile.toml
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of `socialiq data import`."""
    track: tuple[int, ...]
    """The vehicle's number in the file; one for all files, or one for each."""
    profile: Path
    """The declaration: `socialiq profile new` writes one."""
    road: Path | None = None
    """Map of recordings without one, in their frame: CommonRoad XML, or a recording."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Annotate the vehicle, compare it with the profile, print the verdict."""
        declared = load_profile(self.profile)
        config = episode_config(declared)
        if len(self.track) not in (1, len(self.recordings)):
            raise UserError("--track takes one number for all files, or one for each")
        tracks = self.track * (len(self.recordings) if len(self.track) == 1 else 1)
        road = None if self.road is None else road_of(self.road)
        driven = []
        for path, track in zip(self.recordings, tracks, strict=True):
            recording = files.load(path)
            recording = recording if road is None else Recording(recording.tracks, road)
            driven.append(ego_swap.episode_of(recording, track, config))
        verdict = judge_recorded(declared, driven)
        status = {Decision.PASS: 0, Decision.FAIL: 1, Decision.INCONCLUSIVE: 3}[verdict.decision]
        if self.json:
            print_json(to_json(verdict) | {"consistent": WORDS[verdict.decision]})
        else:
            _show(verdict)
        return status


WORDS = {
    Decision.PASS: "consistent",
    Decision.FAIL: "not consistent",
    Decision.INCONCLUSIVE: "not decided",
}


def _show(verdict: RecordedVerdict) -> None:
    sys.stdout.write(f"{WORDS[verdict.decision].upper()}: {verdict.reason}\n")
    region = verdict.shown
    rows: list[dict[str, Any]] = [
        {
            "test": "shown angle, degrees",
            "estimate": region.angle if region else "not known",
            "low": region.low if region else "",
            "high": region.high if region else "",
            "asked for": f"{verdict.declared:g} ± {verdict.margin:g}",
        }
    ]
    rows += [
        {
            "test": one.name.replace("_", " "),
            "estimate": one.share,
            "low": one.low,
            "high": one.high,
            "asked for": f"{one.side} {one.limit:g}",
        }
        for one in verdict.competence
    ]
    print_table(rows)
    if len(verdict.of_episodes) > 1:
        each = ", ".join("none" if one is None else f"{one:.0f}" for one in verdict.of_episodes)
        sys.stdout.write(
            f"The angle pools {verdict.episodes} episodes, taken as of one driver; of each alone: "
            f"{each} degrees.\n"
        )
    for what, why in verdict.not_tested.items():
        sys.stdout.write(f"Not tested: {what}; {why}.\n")
