"""`data audit`: one recorded vehicle against a declaration."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.audit.profile.reader import load as load_profile
from socialiq.audit.recorded_vehicle import RecordedVerdict, episode_config, judge_recorded
from socialiq.audit.verdict.decision import Decision
from socialiq.cli.output import print_json, print_table
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.to_json import to_json
from socialiq_recordings.cli.recorded_files import load_all
from socialiq_recordings.episodes import ego_swap
from socialiq_recordings.identity.identify import identify
from socialiq_recordings.recording import Recording


@dataclass(frozen=True)
class AuditRecorded:
    """Check whether a recorded vehicle's driving is consistent with a declared profile.

    Exit status: 0 consistent, 1 not consistent, 2 a mistake in the call, 3 undecided. A vehicle
    has few decisions: below the least evidence the answer is 3, and most answers are. Regret can't
    be computed from a recording.

    Example: socialiq data audit junction.safetensors --track 17 --profile profile.toml
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of `socialiq data import`."""
    track: tuple[int, ...]
    """The vehicle's number in the file; one for all files, or one for each."""
    profile: Path
    """The declaration: `socialiq profile new` writes one."""
    road: Path | None = None
    """Map of recordings without one: CommonRoad XML, Lanelet2 OSM, or a recording."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Annotate the vehicle, compare it with the profile, print the verdict."""
        declared = load_profile(self.profile)
        config = episode_config(declared)
        if len(self.track) not in (1, len(self.recordings)):
            raise UserError("--track takes one number for all files, or one for each")
        tracks = self.track * (len(self.recordings) if len(self.track) == 1 else 1)
        recordings = load_all(self.recordings, self.road)
        _refuse_same_moments(recordings, tracks)
        driven = [
            ego_swap.episode_of(recording, track, config)
            for recording, track in zip(recordings, tracks, strict=True)
        ]
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


def _refuse_same_moments(recordings: Sequence[Recording], numbers: Sequence[int]) -> None:
    """Raise an error if two recordings show the vehicle in the same moments."""
    for one in identify(recordings).overlaps if len(recordings) > 1 else ():
        if not one.seconds:
            continue
        pair = [recordings[which].tracks for which in (one.first, one.second)]
        for tracks in one.vehicles:
            same = [int(of.identity[track]) for of, track in zip(pair, tracks, strict=True)]
            if same == [numbers[one.first], numbers[one.second]]:
                first, second = (one_line(of.recording, 60) for of in pair)
                raise UserError(
                    f"{first} and {second} show vehicle {same[0]} in the same moments "
                    f"({one.seconds:.1f} s in common), which would count twice: leave one out"
                )


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
    rows.append(
        {
            "test": f"evidence, independent {verdict.unit}s",
            "estimate": verdict.evidence,
            "low": "",
            "high": "",
            "asked for": f"at least {verdict.evidence_needed}",
        }
    )
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
