"""`data power`: what these recordings could show of a social angle, and how many more would."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import Display, Printing, print_json, print_table
from socialiq.learners.callbacks import Clock
from socialiq.plotting.style import png
from socialiq.results_folder import Results, check_target, save
from socialiq.types import Row
from socialiq_recordings.cli.files import load_identified, sources_of
from socialiq_recordings.cli.prediction import say_if_too_few
from socialiq_recordings.identity.duplicates import Duplicates
from socialiq_recordings.prediction import study
from socialiq_recordings.prediction.situations import situations_of
from socialiq_recordings.trait import power
from socialiq_recordings.trait.models import Sample, chains_to_find_anything, sample_of
from socialiq_recordings.trait.power import POWER, PowerConfig, needed_rows, power_rows

_Config = tyro.conf.OmitArgPrefixes[PowerConfig]


@dataclass(frozen=True)
class Power(Printing):
    """Simulate drivers of known angles at recorded moments: what is found, and what it would take.

    Example: socialiq data power a.safetensors b.safetensors --out power
    """

    recordings: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files of `socialiq data import`."""
    out: Path | None = None
    """Folder to write: shares of detections, sizes needed, a figure."""
    simulation: _Config = dataclasses.field(default_factory=PowerConfig)
    road: Path | None = None
    """Map of recordings without one: CommonRoad XML, Lanelet2 OSM, or a recording."""
    duplicates: Duplicates = "drop"
    """Vehicles whose moments are in several recordings: count each once, keep all, or refuse."""
    replace: bool = False
    """Replace earlier results in the folder."""

    def run(self) -> int:
        """Read, simulate, count, write, print."""
        if self.out is not None:
            check_target(self.out, self.replace)
        recordings, identified = load_identified(
            self.recordings, self.road, self.duplicates, self.json
        )
        situations = situations_of(recordings, identified, self.duplicates == "drop")
        sample = sample_of(study.choices(situations, self.simulation.seed))
        rows = self._rows(sample)
        needed = needed_rows(rows)
        summary = {**_counts(sample), "needed": {row["population"]: row for row in needed}}
        if self.out is not None:
            provenance = _Asked(self.simulation, self.duplicates, sources_of(recordings))
            tables = {"power": rows, "needed": needed}
            results = Results.of("recordings power", provenance, tables, summary)
            save(results, self.out, png({"power": power.power(rows)}), self.replace)
        if self.json:
            print_json(summary | {"power": rows})
        else:
            _show(rows, needed, summary)
        return 0

    def _rows(self, sample: Sample) -> list[Row]:
        config = self.simulation
        total = (len(config.spreads) + 1) * len(config.sizes) * config.repeats
        with Display(quiet=self.json) as display:
            report, clock, done = display.stage("simulated drivers"), Clock(0, total, 1), 0

            def counted() -> None:
                nonlocal done
                done += 1
                report(clock.report(done, {}, {}, ())._replace(unit="samples"))

            return power_rows(sample, config, counted)


@dataclass(frozen=True)
class _Asked:
    """Provenance of a simulation."""

    simulation: PowerConfig
    duplicates: str
    sources: list[dict[str, Any]]


def _counts(sample: Sample) -> dict[str, Any]:
    return {
        "drivers": len(sample.chain),
        "chains": int(sample.chain.max()) + 1,
        "chains_needed": chains_to_find_anything(),
        "decisions": len(sample.table),
        "decisions_tested": int(sample.second.sum()),
    }


def _show(rows: list[Row], needed: list[Row], summary: dict[str, Any]) -> None:
    print_table(
        [
            {
                "population": row["population"],
                "size": f"x {row['size']}",
                "drivers": row["drivers"],
                "gain, nats": f"{row['gain_nats']:+.4f}",
                "less RMSE": f"{100 * row['rmse_gain']:+.1f} %",
                "found": f"{row['detected']:.0%} ({row['low']:.0%} to {row['high']:.0%})",
                "beats all": f"{row['beats_every_rival']:.0%}",
            }
            for row in rows
        ],
        f"Simulated drivers at {summary['decisions']} decisions in conflict of "
        f"{summary['drivers']} drivers in {summary['chains']} independent chains",
    )
    title = f"\nNeeded to find it in {POWER:.0%} of tries"
    print_table([_needed_line(row) for row in needed], title)
    say_if_too_few(summary["chains"], summary["chains_needed"])


def _needed_line(row: Row) -> Row:
    size = row["size_needed"]
    bound = f"more than {row['more_than']}" if row["more_than"] else "-"
    return {
        "population": row["population"],
        "RMSE saved if angles were known": f"{100 * row['known_angle_gain']:.1f} %",
        "times these data": bound if size is None else f"{size:.1f}",
        "drivers": "" if size is None else row["drivers_needed"],
        "chains": "" if size is None else row["chains_needed"],
    }
