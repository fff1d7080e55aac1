"""Commands on recorded junctions: world, demonstrations, census, a dial that practises in one."""

import dataclasses
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from socialiq.cli.output import print_json, print_table, say
from socialiq.demonstrations import files as demonstration_files
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.outputs import refuse_existing
from socialiq.plotting.style import png
from socialiq.results_folder import Results, check_target, save
from socialiq.types import Ending, Row
from socialiq.worlds.highway.effects import EffectOptions
from socialiq_recordings import census
from socialiq_recordings.cli.files import OfRecordings, load_all, remark, users_used
from socialiq_recordings.recording import PEOPLE
from socialiq_recordings.road.network import Sign
from socialiq_recordings.world.build import Made, build
from socialiq_recordings.world.config import LEVELS, Lights, WorldConfig
from socialiq_recordings.world.replay import Replayed, replay

FEW = 0.05  # largest share of episodes with a situation never shown that is no warning
MOST_REPEATS = 100  # largest number of simulations of a recording for a report


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
        """Build the world of some files, and say first what must be known of them.

        Args:
            paths: Files of recordings, or folders of them.
            road: Map of recordings without one; None if each has its own.
            quiet: Whether remarks on the recordings are left out.

        Raises:
            UserError: If an option is bad, a file can't be read, or the recordings make no world.
        """
        config = WorldConfig(**dataclasses.asdict(self))  # a bad option before the slow work
        recordings = load_all(paths, road)
        built = build(recordings, config)
        built.world.provenance["road_users"] = _users(built, False)
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
class MakeWorld(OfRecordings):
    """Make recorded junctions an environment: calibrated drivers, that enter as the recorded did.

    The file is driven in by its name: socialiq evaluate POLICY --world W --episodes 100, or
    gymnasium.make("socialiq/RecordedJunction-v0", file=W).

    Example: socialiq data world junction.safetensors --out world.safetensors
    """

    out: Path
    """World to write; must not exist."""
    caused: bool = False
    """Reward what the ego causes in the place of Eq 4.2, as `socialiq effects` measures it."""
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
        _check_every(self.every, self.choices)
        if self.caused and self.demonstrations is not None:
            raise UserError(
                "--demonstrations have the rewards of Eq 4.2: leave them out with --caused"
            )
        if self.out == self.demonstrations:
            raise UserError("--out and --demonstrations are one file: name two")
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
        evidence = list(built.calibration.evidence)
        print_table(evidence, "Drivers (m, s; estimated: from the recordings)")
        counts = {name: summary[name] for name in ("vehicles", "egos", "closures")}
        counts |= {f"simulated {name}": n for name, n in summary["contacts"].items()}
        demonstrated = summary.get("demonstrations", {})
        counts |= {f"demonstrated {name}": value for name, value in demonstrated.items()}
        print_table([{"quantity": name, "value": value} for name, value in counts.items()])
        print_table(summary["road_users"], "Road users")
        if "compared" in summary:
            print_table(summary["compared"], "Recorded and simulated: quartiles, distance")
        return 0

    def write(self, built: Made) -> dict[str, Any]:
        """Compute, then write the files that are asked for, the world last; return the summary."""
        from socialiq_recordings.world import compare

        provenance = built.world.provenance
        summary: dict[str, Any] = {"out": str(self.out)}
        summary |= {
            name: provenance[name] for name in ("vehicles", "egos", "closures", "calibration")
        }
        users = summary["road_users"] = provenance["road_users"]
        summary["contacts"] = compare.contacts(built, self.seed, self.repeats)
        replayed = replay(built.world, self.every) if self.demonstrations is not None else None
        if self.report is not None:
            simulated = compare.simulate(built, self.seed, self.repeats)
            rows = compare.table(built.observed, simulated)
            settings: Row = {"choices": dataclasses.asdict(self.choices), "repeats": self.repeats}
            settings |= {"seed": self.seed, "recordings": provenance["recordings"]}
            tables = {"compared": rows, "drivers": list(built.calibration.evidence)}
            tables["road_users"] = users
            results = Results.of("recordings world", settings, tables, {"compared": rows})
            pictures = png({"compared": compare.beside(built.observed, simulated)})
            save(results, self.report, pictures, self.replace)
            summary["compared"] = rows
        if self.demonstrations is not None and replayed is not None:
            demonstration_files.save(self.demonstrations, replayed.table, replace=False)
            summary["demonstrations"] = _quality(replayed, built.world.config.decisions)
        effects = EffectOptions() if self.caused else None
        world = dataclasses.replace(built.world, effects=effects)
        summary["sha256"] = world.save(self.out, replace=False)
        return summary


@dataclass(frozen=True)
class ToDemonstrations(OfRecordings):
    """Write the decisions of recorded drivers as demonstrations, in the form of their world.

    The same table as `data world --demonstrations`, without the world.

    Example: socialiq data demonstrations junction.safetensors --out human.safetensors
    """

    out: Path
    """Demonstrations file to write; must not exist."""
    choices: _Choices = dataclasses.field(default_factory=Choices)
    every: float = 0.0
    """Seconds between the beginnings of a vehicle's episodes, which then overlap; 0: one episode
    for each vehicle."""
    as_human: bool = False
    """Give vehicles of simulated recordings the mode human, too; otherwise it is simulated."""

    def run(self) -> int:
        """Convert, write, and print the counts."""
        refuse_existing(self.out)
        _check_every(self.every, self.choices)
        built = self.choices.build(self.recordings, self.road, self.json)
        replayed = replay(built.world, self.every, self.as_human)
        counts = _counts_of(built, replayed)
        users = _users(built)
        quality = _quality(replayed, built.world.config.decisions)
        sha256 = demonstration_files.save(self.out, replayed.table, replace=False)
        if self.json:
            head = {"file": str(self.out), "sha256": sha256}
            print_json(head | quality | {"road_users": users, "recordings": counts})
            return 0
        _show_counts(counts, str(self.out))
        print_table([{"quantity": name, "value": value} for name, value in quality.items()])
        print_table(users, "Road users")
        return 0


@dataclass(frozen=True)
class TakeCensus(OfRecordings):
    """Locate recorded drivers in the plane of the two rewards, with confidence regions.

    Example: socialiq data census junction.safetensors --out census
    """

    out: Path | None = None
    """Folder to write: every driver, the counts, the summary, a picture."""
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
        rows = census.drivers_of(built.world, replayed, self.confidence)
        population = census.population_of(rows, built.identified, self.seed, self.confidence)
        counts = _counts_of(built, replayed)
        summary = {"population": population, "limits": list(census.LIMITS)}
        users = summary["road_users"] = _users(built)
        if self.out is not None:
            provenance: Row = {
                "choices": dataclasses.asdict(self.choices),
                "confidence": self.confidence,
                "seed": self.seed,
                "sources": built.world.provenance["recordings"],
            }
            tables = {"drivers": rows, "recordings": counts, "road_users": users}
            results = Results.of("recordings census", provenance, tables, summary)
            pictures = png({"census": census.picture(rows, population)})
            save(results, self.out, pictures, self.replace)
        if self.json:
            print_json(summary | {"recordings": counts, "drivers": rows})
            return 0
        _show_counts(counts, "Recordings")
        lines = []
        for name, value in population.items():
            if isinstance(value, dict):
                value = f"{value['estimate']:.1f} ({value['low']:.1f} to {value['high']:.1f})"
            lines.append({"population": name, "value": "not known" if value is None else value})
        print_table(lines)
        print_table(users, "Road users")
        sys.stdout.write("\n".join(["What this can't show:", *census.LIMITS]) + "\n")
        return 0


def _users(built: Made, once: bool = True) -> list[Row]:
    """Return the numbers of road users that the recordings have and that are used.

    With `once`, drivers alone, and only one track of a vehicle that several recordings show at the
    same moments; without, also the people that are replayed.
    """
    used = [
        {*of.ways} & kept
        if once
        else {*of.ways, *np.flatnonzero(np.isin(of.scene.tracks.road_user, PEOPLE)).tolist()}
        for kept, of in zip(built.kept, built.every, strict=True)
    ]
    why = "seen once, or beside the lanelets of the map"
    why += ", or in another recording too" if once else ""
    return users_used([encounters.scene.tracks for encounters in built.every], used, why)


def _check_every(every: float, choices: Choices) -> None:
    if not 0 <= every <= 1 / max(choices.policy_rate, 1):
        raise UserError(f"--every must be 0 to one decision, got {every:g}")


def _quality(replayed: Replayed, decisions: int) -> dict[str, Any]:
    """Return the counts of demonstrated decisions, and what their actions leave; warn of few."""
    rows = replayed.table.n_transitions
    # Hanley and Lippman-Hand (1983): what is in none of n rows may, at 95 %, be in 3 of n.
    unseen = 1 - (1 - min(3 / rows, 1.0)) ** decisions
    if unseen > FEW:
        say(
            f"{rows} decisions are few: a situation of one decision in {max(rows // 3, 1)} may be "
            f"in none of them (95 %), and up to {100 * unseen:.0f} % of episodes of {decisions} "
            "decisions then meet it: expect collisions of policies trained on them alone; let a "
            "dial practise (socialiq train practised-dial), or import more"
        )
    row: Row = {"episodes": replayed.table.n_episodes, "decisions": replayed.table.n_transitions}
    return row | {"residual_rms": replayed.residual_rms, "squares_left": replayed.squares_left}


def _counts_of(built: Made, replayed: Replayed) -> list[Row]:
    """Return a row of counts for each recording."""
    first = built.world.road.recording_first
    table = replayed.table
    rows = []
    last = table.episode_starts + table.episode_lengths - 1
    for number, source in enumerate(built.world.provenance["recordings"]):
        of_recording = (replayed.vehicle >= first[number]) & (replayed.vehicle < first[number + 1])
        endings = Counter(table.ending[last[of_recording]].tolist())
        row: Row = {
            "recording": source["recording"],
            "site": built.identified.site[number],
            "chain": built.identified.chain[number],
            "origin": "simulated" if source["simulated"] else "recorded",
            "seconds": round(source["seconds"], 2),
            "vehicles": source["vehicles"],
            "episodes": int(of_recording.sum()),
            "decisions": int(table.episode_lengths[of_recording].sum()),
            "arrivals": endings[int(Ending.ARRIVAL)],
            "truncated": endings[int(Ending.TIMEOUT)],
        }
        rows.append(row)
    return rows


def _show_counts(counts: list[Row], title: str) -> None:
    """Print episodes by recording, with sums."""
    names = [name for name in counts[0] if name not in ("site", "chain", "origin")]
    rows = [{name: row[name] for name in names} for row in counts]
    rows = [row | {"recording": one_line(str(row["recording"]))} for row in rows]
    if len(rows) > 1:
        rows.append({"recording": "all"} | {n: sum(row[n] for row in counts) for n in names[1:]})
    print_table(rows, title)
