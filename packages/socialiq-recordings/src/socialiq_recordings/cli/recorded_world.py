"""`data world`: a recorded junction as an environment with reactive traffic."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import print_json, print_table
from socialiq.demonstrations import files as demonstration_files
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.outputs import refuse_existing
from socialiq.plotting.style import png
from socialiq.types import Row
from socialiq_lab.results import Results, check_target, save
from socialiq_recordings.cli.recorded_files import load_all
from socialiq_recordings.identity.duplicates import check_names
from socialiq_recordings.recording import Recording
from socialiq_recordings.road.network import Sign
from socialiq_recordings.simulated_source import signs_of_simulation
from socialiq_recordings.world.build import Made, build
from socialiq_recordings.world.config import LEVELS, Lights, WorldConfig

MOST_REPEATS = 100
"""Largest number of simulations of a recording for a report."""


@dataclass(frozen=True)
class Choices:
    """Options of the world's decisions."""

    policy_rate: int = 1
    """Decisions per second: 1, 2, 5 or 10; divides the recordings' rates."""
    levels: tuple[float, ...] = LEVELS
    """Accelerations that the ego can choose, m/s², ascending, 0 among them."""
    duration: float = 20.0
    """Seconds after which an episode times out."""
    observed_vehicles: int = 12
    """Rows of the observation, the ego's included."""
    lights: Lights = "inferred"
    """inferred: lines are closed where the first of a lane stood without a known reason; none."""

    def config(self) -> WorldConfig:
        """Return the options for the library."""
        return WorldConfig(**dataclasses.asdict(self))


@dataclass(frozen=True)
class MakeWorld:
    """Make recorded junctions an environment: calibrated drivers, that enter as the recorded did.

    The file is driven in by its name: socialiq evaluate POLICY --world W --episodes 100, or
    gymnasium.make("socialiq/RecordedJunction-v0", file=W).

    Example: socialiq data world junction.safetensors --out world.safetensors
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of `socialiq data import`, with a road."""
    out: Path
    """World to write; must not exist."""
    road: Path | None = None
    """Map of recordings without one: CommonRoad XML, Lanelet2 OSM, or a recording."""
    choices: tyro.conf.OmitArgPrefixes[Choices] = dataclasses.field(default_factory=Choices)
    demonstrations: Path | None = None
    """Demonstrations file to write: the recorded drivers' decisions in this world's form."""
    every: float = 0.0
    """Seconds between the beginnings of a vehicle's demonstrated episodes, which then overlap; 0:
    one episode for each vehicle."""
    report: Path | None = None
    """Folder to write: simulated traffic beside the recorded, in tables and pictures."""
    repeats: int = 5
    """Simulations of each recording for the report."""
    seed: int = 0
    """Seed of their drivers."""
    replace: bool = False
    """Replace an earlier report in the folder."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Read, calibrate, write, print."""
        config = self.choices.config()
        if not 1 <= self.repeats <= MOST_REPEATS:
            raise UserError(f"--repeats must be from 1 to {MOST_REPEATS}, got {self.repeats}")
        if not 0 <= self.every <= 1 / config.policy_rate:
            raise UserError(f"--every must be 0 to one decision, got {self.every:g}")
        for path in (self.out, self.demonstrations):
            if path is not None:
                refuse_existing(path)
        if self.report is not None:
            check_target(self.report, self.replace)
        recordings = load_all(self.recordings, self.road)
        check_names([one.tracks.recording for one in recordings])
        made = build(recordings, config)
        for remark in () if self.json else _remarks(recordings):
            sys.stderr.write(f"{remark}\n")
        summary = self.write(made)
        if self.json:
            print_json(summary)
        else:
            self.show(made, summary)
        return 0

    def write(self, made: Made) -> dict[str, Any]:
        """Compute, then write the files that are asked for, the world last; return the summary."""
        summary: dict[str, Any] = {
            "out": str(self.out),
            "vehicles": made.world.provenance["vehicles"],
            "egos": made.world.provenance["egos"],
            "closures": made.world.provenance["closures"],
            "calibration": made.world.provenance["calibration"],
        }
        found = None
        if self.demonstrations is not None:
            from socialiq_recordings.world.replay import replay

            found = replay(made.world, self.every)
        if self.report is not None:
            summary["compared"] = self.compared(made, self.report)
        if self.demonstrations is not None and found is not None:
            demonstration_files.save(self.demonstrations, found.table, replace=False)
            summary["demonstrations"] = {
                "episodes": found.table.n_episodes,
                "decisions": found.table.n_transitions,
                "residual_rms": found.residual_rms,
                "squares_left": found.squares_left,
            }
        summary["sha256"] = made.world.save(self.out, replace=False)
        return summary

    def compared(self, made: Made, folder: Path) -> list[Row]:
        """Simulate, write the report, return its table."""
        from socialiq_recordings.world import compare, figures

        simulated = compare.simulate(made, self.seed, self.repeats)
        rows = compare.table(made.observed, simulated)
        evidence = list(made.calibration.evidence)
        asked = _Asked(self.choices, self.repeats, self.seed, made.world.provenance["recordings"])
        tables = {"compared": rows, "drivers": evidence}
        results = Results.of("recordings world", asked, tables, {"compared": rows})
        drawn = png({"compared": figures.beside(made.observed, simulated)})
        save(results, folder, drawn, self.replace)
        return rows

    def show(self, made: Made, summary: dict[str, Any]) -> None:
        """Print the tables."""
        calibration = made.calibration
        print_table(list(calibration.evidence), "Drivers (m, s; estimated: from the recordings)")
        rows = [{"quantity": name, "value": summary[name]} for name in _COUNTS]
        rows += [
            {"quantity": f"demonstrated {name}", "value": value}
            for name, value in summary.get("demonstrations", {}).items()
        ]
        print_table(rows)
        if "compared" in summary:
            print_table(summary["compared"], "Recorded and simulated: quartiles, distance")


def _remarks(recordings: Sequence[Recording]) -> Iterator[str]:
    """Yield what must be known of recordings before their world is used."""
    for one in recordings:
        name, signs = one_line(one.tracks.recording, 60), signs_of_simulation(one.tracks)
        if signs:
            yield f"{name} is simulated, not human: {one_line(signs[0])}"
        if any(lanelet.sign == Sign.LIGHT for lanelet in one.road.lanelets.values()):
            yield (
                f"{name} has traffic lights, whose states are not used: lines are closed where "
                "vehicles were seen to stand, or never with --lights none"
            )


_COUNTS = ("vehicles", "egos", "closures")


@dataclass(frozen=True)
class _Asked:
    """Provenance of a report."""

    choices: Choices
    repeats: int
    seed: int
    recordings: list[dict[str, Any]]
