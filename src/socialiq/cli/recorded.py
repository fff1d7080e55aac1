"""`data demonstrations`, `data census`, `data agreement`: uses of recordings."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import tyro

from socialiq.cli.output import print_json, print_table, say
from socialiq.demonstrations import files as demonstration_files
from socialiq.errors import UserError
from socialiq.experiments.results import Results, check_target, save
from socialiq.foreign import one_line
from socialiq.outputs import refuse_existing
from socialiq.plotting.style import png
from socialiq.recordings import census, files, held_out
from socialiq.recordings import census_figure as picture
from socialiq.recordings.census_spread import Deconvolved
from socialiq.recordings.episodes import ego_swap
from socialiq.recordings.episodes.config import LEVELS, EpisodeConfig
from socialiq.recordings.identity.duplicates import Duplicates, identify_distinct, swap_identified
from socialiq.recordings.identity.identify import Identified
from socialiq.recordings.readers.maps import map_of
from socialiq.recordings.recording import Recording
from socialiq.recordings.simulated_source import signs_of_simulation
from socialiq.to_json import to_json


@dataclass(frozen=True)
class Choices:
    """Options of the conversion of recordings to episodes."""

    policy_rate: int = 1
    """Decisions per second; divides the recording's rate."""
    speeds: tuple[float, ...] = (0.0, 4.5, 9.0)
    """Target speeds that actions step through, m/s; the last is v_max of the rewards."""
    loss: Literal["between_decisions", "summed"] = "between_decisions"
    """A neighbour's loss of speed: from decision to decision, or every fall between frames."""
    near: float = 3.0
    """Seconds that two vehicles may be apart at a conflict to meet there."""
    actions: Literal["meta-actions", "accelerations"] = "meta-actions"
    """Discretisation of decisions: slower, idle, faster; or levels of acceleration."""
    levels: tuple[float, ...] = LEVELS
    """Levels of acceleration, m/s², ascending."""
    influence: Literal["observed", "reasoned"] = "observed"
    """Losses of speed charged to the ego: every neighbour's, or those with a reason."""
    road: Path | None = None
    """Map of recordings without one: CommonRoad XML, Lanelet2 OSM, or a recording."""
    duplicates: Duplicates = "drop"
    """Vehicles whose moments are in several recordings: count each once, keep all, or refuse."""

    def config(self) -> EpisodeConfig:
        """Return the options for the library."""
        return EpisodeConfig(
            policy_rate=self.policy_rate,
            target_speeds=self.speeds,
            loss=self.loss,
            near=self.near,
            actions=self.actions,
            levels=self.levels,
            influence=self.influence,
        )


_Choices = tyro.conf.OmitArgPrefixes[Choices]


@dataclass(frozen=True)
class ToDemonstrations:
    """Make every recorded vehicle that meets a conflict the ego of one episode, in one file.

    Example: socialiq data demonstrations junction.safetensors --out human.safetensors
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of `socialiq data import`."""
    out: Path
    """Demonstrations file to write; must not exist."""
    choices: _Choices = dataclasses.field(default_factory=Choices)
    as_human: bool = False
    """Give vehicles of simulated recordings the mode human, too; otherwise it is simulated."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Convert, write, and print the counts and the reasons for omissions."""
        refuse_existing(self.out)
        swapped = swap_all(self.recordings, self.choices, self.json).swapped
        table = ego_swap.demonstrations(swapped, self.as_human)
        sha256 = demonstration_files.save(self.out, table, replace=False)
        counts = [one.counts for one in swapped]
        if self.json:
            print_json({"file": str(self.out), "sha256": sha256, "recordings": counts})
        else:
            show_counts(counts, str(self.out))
        return 0


@dataclass(frozen=True)
class TakeCensus:
    """Locate recorded drivers in the plane of the two rewards, with confidence regions.

    Example: socialiq data census junction.safetensors --out census
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of `socialiq data import`."""
    out: Path | None = None
    """Folder to write: every driver, the counts, the summary, a picture."""
    choices: _Choices = dataclasses.field(default_factory=Choices)
    confidence: float = 0.95
    """Confidence of all intervals."""
    seed: int = 0
    """Seed of the resampling."""
    replace: bool = False
    """Replace an earlier census in the folder."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Count, estimate, write, print."""
        check_share(self.confidence)
        if self.out is not None:
            check_target(self.out, self.replace)
        swapped = swap_all(self.recordings, self.choices, self.json).swapped
        found = census.take(swapped, self.seed, self.confidence)
        counts = [one.counts for one in swapped]
        population = dataclasses.asdict(found.population)
        spread = {"all": found.spread, "moving": found.spread_moving}
        summary = {
            "population": population,
            "spread": {name: one and to_json(one.population) for name, one in spread.items()},
            "limits": list(census.LIMITS),
        }
        drivers = [dataclasses.asdict(one) for one in found.drivers]
        posterior = [one._asdict() for one in found.posterior]
        if self.out is not None:
            tables = {"drivers": drivers, "recordings": counts, "posterior": posterior}
            tables["shrunken"] = census.shrunken_rows(found)
            config = _Asked(self.choices, self.confidence, self.seed, sources_of(swapped))
            results = Results.of("recordings census", config, tables, summary)
            pictures = png({"census": picture.census(drivers, population, posterior)})
            save(results, self.out, pictures, self.replace)
        if self.json:
            more = {"recordings": counts, "drivers": drivers, "posterior": posterior}
            print_json(summary | more)
        else:
            show_counts(counts, "Recordings")
            print_table(
                [{"population": key, "value": interval_text(v)} for key, v in population.items()]
            )
            print_table(_spread_rows(spread), "\nSpread of the angles behind the points, degrees")
            sys.stdout.write("\n".join(["What this can't show:", *census.LIMITS]) + "\n")
        return 0


def _spread_rows(spread: dict[str, Deconvolved | None]) -> list[dict[str, Any]]:
    """Return a row for each population of drivers: mean and spread with intervals."""
    rows = []
    for name, one in spread.items():
        of = one.population if one else None
        if of is not None:
            over = "not known"
            if of.chain_low is not None and of.chain_high is not None:
                over = f"{of.chain_low:.0f} to {of.chain_high:.0f}"
            rows.append(
                {
                    "drivers": f"{name} ({of.drivers})",
                    "mean": interval_text(
                        {"estimate": of.mean.angle, "low": of.mean.low, "high": of.mean.high}
                    ),
                    "spread": interval_text(
                        {"estimate": of.spread, "low": of.low, "high": of.high}
                    ),
                    "spread over chains": over,
                    "decisions are worth": f"{of.worth:.1f}",
                }
            )
    return rows


@dataclass(frozen=True)
class Agreement:
    """Train on all sites but one, predict its drivers' actions, for each in turn.

    Sites are identified by the geometry of their lanes, whatever their files are called.

    Example: socialiq data agreement a.safetensors b.safetensors --angle 0 45 90 --out agreement
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of `socialiq data import`, of at least two sites."""
    out: Path
    """Folder to write."""
    choices: _Choices = dataclasses.field(default_factory=Choices)
    angle: tuple[float, ...] = (0.0, 45.0, 90.0)
    """Target angles of IQ-Learn, degrees."""
    updates: int = 2000
    """Gradient steps of each run."""
    hidden: tuple[int, ...] = (64, 64)
    """Widths of the hidden layers."""
    seed: int = 0
    """Seed of training."""
    replace: bool = False
    """Replace earlier results in the folder."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Train, predict, write, print."""
        check_target(self.out, self.replace)
        swapped = swap_all(self.recordings, self.choices, self.json).swapped
        config = held_out.Config(self.angle, self.updates, hidden=self.hidden, seed=self.seed)
        found = held_out.agreement(ego_swap.demonstrations(swapped), config)
        methods = found.by_method()
        summary = {"methods": methods, "finite": found.finite, "failures": list(found.failures)}
        asked = _Trained(self.choices, config, sources_of(swapped))
        tables = {"held_out": found.rows, "methods": methods}
        results = Results.of("recordings agreement", asked, tables, summary)
        save(results, self.out, {}, self.replace)
        if self.json:
            print_json(summary)
        else:
            print_table(methods, "Held-out decisions; surprise: mean negative log-likelihood, nats")
        return 1 if found.failures or not found.finite else 0


@dataclass(frozen=True)
class _Asked:
    """Provenance of a census."""

    choices: Choices
    confidence: float
    seed: int
    sources: list[dict[str, Any]]


@dataclass(frozen=True)
class _Trained:
    """Provenance of an agreement."""

    choices: Choices
    training: held_out.Config
    sources: list[dict[str, Any]]


class Swap(NamedTuple):
    """Recordings of some files and their ego swap.

    Attributes:
        recordings: Tracks and roads.
        identified: Their sites, chains and vehicles.
        swapped: Episodes of each.
    """

    recordings: list[Recording]
    identified: Identified
    swapped: list[ego_swap.Swapped]


def swap_all(paths: tuple[Path, ...], choices: Choices, quiet: bool) -> Swap:
    """Return the recordings of some files and their ego swap; say first what they have in common.

    Raises:
        UserError: If there is none, or one can't be read or swapped; the line names it.
    """
    config = choices.config()  # a bad option before the slow work
    recordings, identified = load_identified(paths, choices.road, choices.duplicates, quiet)
    swapped = swap_identified(recordings, identified, config, choices.duplicates)
    return Swap(recordings, identified, swapped)


def load_identified(
    paths: tuple[Path, ...], road: Path | None, duplicates: Duplicates, quiet: bool
) -> tuple[list[Recording], Identified]:
    """Return the recordings of some files and what they have in common, which is said first.

    It goes to the standard error, as everything that is said before a result.

    Args:
        paths: Files of `socialiq data import`.
        road: Map of recordings without one.
        duplicates: Whether moments in common are refused.
        quiet: Whether nothing is said of them.

    Raises:
        UserError: If there is none, one can't be read, or moments in common are refused.
    """
    recordings = load_all(paths, road)
    identified = identify_distinct(recordings, duplicates)
    if quiet:
        return recordings, identified
    with contextlib.redirect_stdout(sys.stderr):
        show_overlaps(identified)
    for one in recordings:
        signs = signs_of_simulation(one.tracks)
        if signs:
            name = one_line(one.tracks.recording, 60)
            say(f"{name} is simulated, not human: {one_line(signs[0])}")
    return recordings, identified


def load_all(paths: tuple[Path, ...], road: Path | None = None) -> list[Recording]:
    """Return the recordings of some files, on a map if one is named.

    Raises:
        UserError: If there is none, or one can't be read; the line names it.
    """
    if not paths:
        raise UserError("no recording: name at least one file of `socialiq data import`")
    found = [files.load(path) for path in paths]
    if road is None:
        return found
    return [Recording(one.tracks, map_of(road, one.tracks.source)) for one in found]


def show_overlaps(identified: Identified) -> None:
    """Print the pairs of recordings with vehicles in common; nothing if there are none."""
    rows = [
        row | {"first": one_line(str(row["first"])), "second": one_line(str(row["second"]))}
        for row in identified.rows()
    ]
    if rows:
        print_table(rows, "Recordings with vehicles in common (lag: of the second's clock, s)")
        sys.stdout.flush()


def sources_of(swapped: list[ego_swap.Swapped]) -> list[dict[str, Any]]:
    """Return provenance by recording."""
    return [{"recording": one.recording, "source": one.source} for one in swapped]


def show_counts(counts: list[dict[str, Any]], title: str) -> None:
    """Print episodes by recording, with sums, and the reasons for tracks without episode."""
    hidden = (*ego_swap.REASONS, "site", "chain", "origin")
    shown = [name for name in counts[0] if name not in hidden]
    rows = [{name: row[name] for name in shown} for row in counts]
    rows = [row | {"recording": one_line(str(row["recording"]))} for row in rows]
    if len(rows) > 1:
        total = {name: sum(row[name] for row in counts) for name in shown if name != "recording"}
        rows.append({"recording": "all", **total})
    print_table(rows, title)
    reasons = {name: sum(row[name] for row in counts) for name in ego_swap.REASONS}
    print_table([{"no episode": name, "tracks": count} for name, count in reasons.items()])


def check_share(confidence: float) -> None:
    """Raise an error for an invalid level of confidence."""
    if not 0.5 <= confidence < 1.0:
        raise UserError(f"confidence must be at least 0.5 and below 1, got {confidence:g}")


def interval_text(value: Any) -> Any:
    """Return a cell's text, with an interval in a single text."""
    if isinstance(value, dict):
        return f"{value['estimate']:.1f} ({value['low']:.1f} to {value['high']:.1f})"
    return "not known" if value is None else value
