"""`data demonstrations`, `data census`, `data agreement`: uses of recordings."""

from __future__ import annotations

import dataclasses
import sys
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
from socialiq.to_json import to_json
from socialiq_lab.results import Results, check_target, save
from socialiq_recordings import census, held_out
from socialiq_recordings import census_figure as picture
from socialiq_recordings.census_spread import Deconvolved
from socialiq_recordings.cli.recorded_files import Choices, sources_of, swap_all
from socialiq_recordings.episodes import ego_swap

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
