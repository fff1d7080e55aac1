"""`data world`, `data demonstrations`, `data census`: recorded junctions and their drivers."""

from __future__ import annotations

import dataclasses
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import Printing, print_json, print_table, say
from socialiq.demonstrations import files as demonstration_files
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.outputs import refuse_existing
from socialiq.plotting.style import png
from socialiq.results_folder import Results, check_target, save
from socialiq.types import Ending, Row
from socialiq_recordings import census
from socialiq_recordings.cli.files import load_all, remark
from socialiq_recordings.road.network import Sign
from socialiq_recordings.world.build import Made, build
from socialiq_recordings.world.recorded_world import LEVELS, Lights, WorldConfig
from socialiq_recordings.world.replay import Replayed, replay

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

    def build(self, paths: tuple[Path, ...], road: Path | None, quiet: bool) -> Made:
        """Build the world of some files, and say first what must be known of them."""
        config = WorldConfig(**dataclasses.asdict(self))  # a bad option before the slow work
        recordings = load_all(paths, road)
        built = build(recordings, config)
        if quiet:
            return built
        remark(recordings, built.identified)
        for recording in recordings:
            if any(lanelet.sign == Sign.LIGHT for lanelet in recording.road.lanelets.values()):
                name = one_line(recording.tracks.recording, 60)
                say(
                    f"{name} has traffic lights, whose states are not used: lines are closed where "
                    "vehicles were seen to stand, or never with --lights none"
                )
        return built


_Choices = tyro.conf.OmitArgPrefixes[Choices]


@dataclass(frozen=True)
class MakeWorld(Printing):
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
    choices: _Choices = dataclasses.field(default_factory=Choices)
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

    def run(self) -> int:
        """Read, calibrate, write, print."""
        if not 1 <= self.repeats <= MOST_REPEATS:
            raise UserError(f"--repeats must be from 1 to {MOST_REPEATS}, got {self.repeats}")
        check_every(self.every, self.choices)
        for path in (self.out, self.demonstrations):
            if path is not None:
                refuse_existing(path)
        if self.report is not None:
            check_target(self.report, self.replace)
        built = self.choices.build(self.recordings, self.road, self.json)
        summary = self.write(built)
        if self.json:
            print_json(summary)
            return 0
        print_table(
            list(built.calibration.evidence), "Drivers (m, s; estimated: from the recordings)"
        )
        rows = [
            {"quantity": name, "value": summary[name]} for name in ("vehicles", "egos", "closures")
        ]
        rows += [
            {"quantity": f"demonstrated {name}", "value": value}
            for name, value in summary.get("demonstrations", {}).items()
        ]
        print_table(rows)
        if "compared" in summary:
            print_table(summary["compared"], "Recorded and simulated: quartiles, distance")
        return 0

    def write(self, made: Made) -> dict[str, Any]:
        """Compute, then write the files that are asked for, the world last; return the summary."""
        provenance = made.world.provenance
        summary: dict[str, Any] = {"out": str(self.out)}
        summary |= {
            name: provenance[name] for name in ("vehicles", "egos", "closures", "calibration")
        }
        replayed = replay(made.world, self.every) if self.demonstrations is not None else None
        if self.report is not None:
            summary["compared"] = self.compared(made, self.report)
        if self.demonstrations is not None and replayed is not None:
            demonstration_files.save(self.demonstrations, replayed.table, replace=False)
            summary["demonstrations"] = quality(replayed)
        summary["sha256"] = made.world.save(self.out, replace=False)
        return summary

    def compared(self, made: Made, folder: Path) -> list[Row]:
        """Simulate, write the report, return its table."""
        from socialiq_recordings.world import compare

        simulated = compare.simulate(made, self.seed, self.repeats)
        rows = compare.table(made.observed, simulated)
        sources = made.world.provenance["recordings"]
        provenance = _ReportProvenance(self.choices, self.repeats, self.seed, sources)
        tables = {"compared": rows, "drivers": list(made.calibration.evidence)}
        results = Results.of("recordings world", provenance, tables, {"compared": rows})
        pictures = png({"compared": compare.beside(made.observed, simulated)})
        save(results, folder, pictures, self.replace)
        return rows


@dataclass(frozen=True)
class ToDemonstrations(Printing):
    """Write the decisions of recorded drivers as demonstrations, in the form of their world.

    The same table as `data world --demonstrations`, without the world.

    Example: socialiq data demonstrations junction.safetensors --out human.safetensors
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of `socialiq data import`, with a road."""
    out: Path
    """Demonstrations file to write; must not exist."""
    road: Path | None = None
    """Map of recordings without one: CommonRoad XML, Lanelet2 OSM, or a recording."""
    choices: _Choices = dataclasses.field(default_factory=Choices)
    every: float = 0.0
    """Seconds between the beginnings of a vehicle's episodes, which then overlap; 0: one episode
    for each vehicle."""
    as_human: bool = False
    """Give vehicles of simulated recordings the mode human, too; otherwise it is simulated."""

    def run(self) -> int:
        """Convert, write, and print the counts."""
        refuse_existing(self.out)
        check_every(self.every, self.choices)
        built = self.choices.build(self.recordings, self.road, self.json)
        replayed = replay(built.world, self.every, self.as_human)
        counts = counts_of(built, replayed)
        sha256 = demonstration_files.save(self.out, replayed.table, replace=False)
        if self.json:
            head = {"file": str(self.out), "sha256": sha256}
            print_json(head | quality(replayed) | {"recordings": counts})
            return 0
        show_counts(counts, str(self.out))
        rows = [{"quantity": name, "value": value} for name, value in quality(replayed).items()]
        print_table(rows)
        return 0


@dataclass(frozen=True)
class TakeCensus(Printing):
    """Locate recorded drivers in the plane of the two rewards, with confidence regions.

    Example: socialiq data census junction.safetensors --out census
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of `socialiq data import`, with a road."""
    out: Path | None = None
    """Folder to write: every driver, the counts, the summary, a picture."""
    road: Path | None = None
    """Map of recordings without one: CommonRoad XML, Lanelet2 OSM, or a recording."""
    choices: _Choices = dataclasses.field(default_factory=Choices)
    confidence: float = 0.95
    """Confidence of all intervals."""
    seed: int = 0
    """Seed of the resampling."""
    replace: bool = False
    """Replace an earlier census in the folder."""

    def run(self) -> int:
        """Count, estimate, write, print."""
        if not 0.5 <= self.confidence < 1.0:
            raise UserError(f"confidence must be at least 0.5 and below 1, got {self.confidence:g}")
        if self.out is not None:
            check_target(self.out, self.replace)
        built = self.choices.build(self.recordings, self.road, self.json)
        replayed = replay(built.world)
        drivers = census.drivers_of(built.world, replayed, self.confidence)
        statistics = census.population_of(drivers, built.identified, self.seed, self.confidence)
        counts, population = counts_of(built, replayed), dataclasses.asdict(statistics)
        rows = [dataclasses.asdict(driver) for driver in drivers]
        summary = {"population": population, "limits": list(census.LIMITS)}
        if self.out is not None:
            sources = built.world.provenance["recordings"]
            provenance = _CensusProvenance(self.choices, self.confidence, self.seed, sources)
            tables = {"drivers": rows, "recordings": counts}
            results = Results.of("recordings census", provenance, tables, summary)
            pictures = png({"census": census.picture(rows, population)})
            save(results, self.out, pictures, self.replace)
        if self.json:
            print_json(summary | {"recordings": counts, "drivers": rows})
            return 0
        show_counts(counts, "Recordings")
        print_table(
            [{"population": name, "value": _text(value)} for name, value in population.items()]
        )
        sys.stdout.write("\n".join(["What this can't show:", *census.LIMITS]) + "\n")
        return 0


@dataclass(frozen=True)
class _ReportProvenance:
    """Provenance of a report."""

    choices: Choices
    repeats: int
    seed: int
    recordings: list[dict[str, Any]]


@dataclass(frozen=True)
class _CensusProvenance:
    """Provenance of a census."""

    choices: Choices
    confidence: float
    seed: int
    sources: list[dict[str, Any]]


def check_every(every: float, choices: Choices) -> None:
    """Raise an error unless the beginnings of episodes lie within a decision."""
    if not 0 <= every <= 1 / max(choices.policy_rate, 1):
        raise UserError(f"--every must be 0 to one decision, got {every:g}")


def quality(replayed: Replayed) -> dict[str, Any]:
    """Return the counts of demonstrated decisions, and what their actions leave."""
    return {
        "episodes": replayed.table.n_episodes,
        "decisions": replayed.table.n_transitions,
        "residual_rms": replayed.residual_rms,
        "squares_left": replayed.squares_left,
    }


def counts_of(made: Made, replayed: Replayed) -> list[Row]:
    """Return a row of counts for each recording."""
    first = made.world.road.recording_first
    table, rows = replayed.table, []
    last = table.episode_starts + table.episode_lengths - 1
    for number, source in enumerate(made.world.provenance["recordings"]):
        of_recording = (replayed.vehicle >= first[number]) & (replayed.vehicle < first[number + 1])
        endings = Counter(table.ending[last[of_recording]].tolist())
        rows.append(
            {
                "recording": source["recording"],
                "site": made.identified.site[number],
                "chain": made.identified.chain[number],
                "origin": "simulated" if source["simulated"] else "recorded",
                "seconds": round(source["seconds"], 2),
                "vehicles": source["vehicles"],
                "episodes": int(of_recording.sum()),
                "decisions": int(table.episode_lengths[of_recording].sum()),
                "arrivals": endings[int(Ending.ARRIVAL)],
                "truncated": endings[int(Ending.TIMEOUT)],
            }
        )
    return rows


def show_counts(counts: list[Row], title: str) -> None:
    """Print episodes by recording, with sums."""
    names = [name for name in counts[0] if name not in ("site", "chain", "origin")]
    rows = [{name: row[name] for name in names} for row in counts]
    rows = [row | {"recording": one_line(str(row["recording"]))} for row in rows]
    if len(rows) > 1:
        total = {name: sum(row[name] for row in counts) for name in names[1:]}
        rows.append({"recording": "all", **total})
    print_table(rows, title)


def _text(value: Any) -> Any:
    """Return a cell's text, with an interval in a single text."""
    if isinstance(value, dict):
        return f"{value['estimate']:.1f} ({value['low']:.1f} to {value['high']:.1f})"
    return "not known" if value is None else value
