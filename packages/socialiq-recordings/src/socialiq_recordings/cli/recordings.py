"""`data import`: convert recorded traffic to checked files, one for each recording."""

from __future__ import annotations

import csv
import dataclasses
import io
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import print_json, print_table
from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq.outputs import whole_folder
from socialiq.storage import write_atomically
from socialiq_recordings import files
from socialiq_recordings.measurement import MeasurementError
from socialiq_recordings.readers.column_map import ColumnMap, read_map
from socialiq_recordings.readers.commonroad import MOST_STATES
from socialiq_recordings.readers.import_file import FORMATS, import_file


@dataclass(frozen=True)
class Import:
    """Import recorded traffic, without implausible tracks, which are listed with reasons.

    Example: socialiq data import commonroad USA_Lanker-1_1_T-1.xml --out lankershim
    """

    format: Annotated[str, tyro.conf.Positional]
    """commonroad (XML 2017a to 2020a), csv (with --columns) or argoverse (2, Parquet)."""
    recorded: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """The files."""
    out: Path
    """Folder to make: a file for each recording, and refused.csv."""
    columns: str = ""
    """Column map of a CSV file: highd, ind, interaction, ngsim, or a file that ends in .toml."""
    most_states: int = MOST_STATES
    """Largest number of states in a file, to bound memory."""
    road: Path | None = None
    """Map of CSV files: CommonRoad XML, Lanelet2 OSM, or a recording with lanelets."""
    position_error: float | None = None
    """Standard error of positions, m; by default the column map's, or 0.25."""
    speed_error: float | None = None
    """Standard error of speeds, m/s; by default the column map's, or 0.25."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Read all files, write the folder atomically, print."""
        one_of("format", self.format, FORMATS)
        if not self.recorded:
            raise UserError("name at least one file to import")
        if bool(self.columns) != (self.format == "csv"):
            raise UserError("--columns goes with csv, and csv needs it: name a column map")
        if self.out.exists() and (not self.out.is_dir() or any(self.out.iterdir())):
            raise UserError(f"{self.out} exists already: name a new folder, or remove it first")
        if self.road is not None and self.format != "csv":
            raise UserError(f"--road goes with csv: a {self.format} file has a map of its own")
        columns = read_map(self.columns) if self.columns else None
        failed: list[dict[str, str]] = []
        with whole_folder(self.out) as part:
            found = self._import(part, columns, self._error(columns), failed)
            if not found:
                more = f" (and {len(failed) - 1} more files)" if len(failed) > 1 else ""
                raise UserError(failed[0]["reason"] + more)
            write_atomically(part / "refused.csv", _refused_csv(found))
        self._print(found, failed)
        return 1 if failed else 0

    def _error(self, columns: ColumnMap | None) -> MeasurementError | None:
        stated = {"position": self.position_error, "speed": self.speed_error}
        given = {name: value for name, value in stated.items() if value is not None}
        if not given:
            return None
        return dataclasses.replace(columns.error if columns else MeasurementError(), **given)

    def _import(
        self,
        folder: Path,
        columns: ColumnMap | None,
        error: MeasurementError | None,
        failed: list[dict[str, str]],
    ) -> list[dict[str, Any]]:
        """Import each file; one that can't be read is listed, and the others go on."""
        found = []
        for path in self.recorded:
            began = time.perf_counter()
            try:
                imported = import_file(
                    path, self.format, columns, self.most_states, self.road, error
                )
            except UserError as fault:
                failed.append({"file": str(path), "reason": str(fault)})
                continue
            seconds = time.perf_counter() - began
            states = sum(one.n_states for one in imported)
            for one in imported:
                tracks = one.recording.tracks
                target = folder / f"{_file_name(tracks.recording)}.safetensors"
                if target.exists():
                    reason = (
                        f"{path}: another recording is named {one_line(tracks.recording, 60)} too: "
                        "import it to a folder of its own"
                    )
                    failed.append({"file": str(path), "reason": reason})
                    continue
                found.append(
                    {
                        "recording": tracks.recording,
                        "file": target.name,
                        "sha256": files.save(target, one.recording),
                        "tracks": tracks.n_tracks,
                        "states": tracks.n_states,
                        "refused": [refused._asdict() for refused in one.refused],
                        "skipped": one.skipped,
                        "states_per_s": states / seconds,
                    }
                )
        return found

    def _print(self, found: list[dict[str, Any]], failed: list[dict[str, str]]) -> None:
        for one in failed:
            sys.stderr.write(f"not imported: {one_line(one['reason'], 400)}\n")
        if self.json:
            print_json({"out": str(self.out), "recordings": found, "failed": failed})
            return
        shown = ("recording", "tracks", "states")
        rows = [
            {name: one[name] for name in shown}
            | {"refused": len(one["refused"]), "states_per_s": round(one["states_per_s"])}
            for one in found
        ]
        total = {"recording": "all", **{name: sum(one[name] for one in rows) for name in shown[1:]}}
        total |= {"refused": sum(one["refused"] for one in rows), "states_per_s": ""}
        print_table([*rows, total] if len(rows) > 1 else rows, str(self.out))
        refused = [
            {"recording": one["recording"], **track} for one in found for track in one["refused"]
        ]
        if refused:
            print_table(refused, "\nrefused tracks")


def _file_name(recording: str) -> str:
    """Return the recording's name, without characters that file names can't have."""
    plain = "".join(one if one.isalnum() or one in "-_." else "-" for one in recording)
    return plain.lstrip(".")[:150] or "recording"


def _refused_csv(found: list[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("recording", "identity", "reason"))
    for one in found:
        for refused in one["refused"]:
            writer.writerow((one["recording"], refused["identity"], refused["reason"]))
    return text.getvalue()
