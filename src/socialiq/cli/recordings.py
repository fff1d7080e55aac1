"""`data import`: convert recorded traffic to checked files, one for each recording."""

from __future__ import annotations

import csv
import io
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import print_json, print_table
from socialiq.errors import UserError, one_of
from socialiq.outputs import whole_folder
from socialiq.recordings import files
from socialiq.recordings.readers.column_map import read_map
from socialiq.recordings.readers.commonroad import MOST_STATES
from socialiq.recordings.readers.import_file import FORMATS, import_file
from socialiq.storage import write_atomically


@dataclass(frozen=True)
class Import:
    """Import recorded traffic, without implausible tracks, which are listed with reasons.

    Example: socialiq data import commonroad USA_Lanker-1_1_T-1.xml --out lankershim
    """

    format: Annotated[str, tyro.conf.Positional]
    """commonroad (XML 2018b or 2020a) or csv (with --columns)."""
    recorded: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """The files."""
    out: Path
    """Folder to make: a file for each recording, and refused.csv."""
    columns: str = ""
    """Column map of a CSV file: highd, ind, interaction, ngsim, or a file that ends in .toml."""
    most_states: int = MOST_STATES
    """Largest number of states in a file, to bound memory."""
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
        with whole_folder(self.out) as part:
            found = self._import(part)
            write_atomically(part / "refused.csv", _refused_csv(found))
        self._print(found)
        return 0

    def _import(self, folder: Path) -> list[dict[str, Any]]:
        columns = read_map(self.columns) if self.columns else None
        found = []
        for path in self.recorded:
            began = time.perf_counter()
            imported = import_file(path, self.format, columns, self.most_states)
            seconds = time.perf_counter() - began
            states = sum(one.n_states for one in imported)
            for one in imported:
                tracks = one.recording.tracks
                target = folder / f"{_file_name(tracks.recording)}.safetensors"
                if target.exists():
                    raise UserError(
                        f"{path}: another recording is named {tracks.recording} too: import it to "
                        "a folder of its own"
                    )
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

    def _print(self, found: list[dict[str, Any]]) -> None:
        if self.json:
            print_json({"out": str(self.out), "recordings": found})
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
