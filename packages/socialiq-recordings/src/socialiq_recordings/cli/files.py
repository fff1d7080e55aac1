"""`data import`, `data inspect`, and the recordings that other `data` commands are given."""

import contextlib
import dataclasses
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from jaxtyping import Int8

from socialiq.cli.output import Printing, print_json, print_table, say
from socialiq.cli.parser import Paths
from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq.outputs import whole_folder
from socialiq.reading import sha256_of_file
from socialiq.results_folder import as_csv
from socialiq.storage import write_atomically
from socialiq.types import Row
from socialiq_recordings import files
from socialiq_recordings.identity import identify as identity
from socialiq_recordings.identity.identify import Duplicates, Identified
from socialiq_recordings.plausible import MeasurementError
from socialiq_recordings.readers import (
    FORMATS,
    MOST_STATES,
    WITHOUT_MAP,
    import_file,
    map_of,
)
from socialiq_recordings.readers.column_map import ColumnMap, read_map
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import (
    STEP,
    RoadNetwork,
    every_step,
    shapely,
    tree_of,
)
from socialiq_recordings.road.routes import OFF_THE_MAP, VEHICLES
from socialiq_recordings.signs_of_simulation import signs_of_simulation


@dataclass(frozen=True)
class Import(Printing):
    """Import recorded traffic, without implausible tracks, which are listed with reasons.

    Example: socialiq data import commonroad USA_Lanker-1_1_T-1.xml --out lankershim
    """

    format: Annotated[str, tyro.conf.Positional]
    """commonroad (XML 2017a to 2020a), csv (with --columns), argoverse (2, Parquet) or sind."""
    recorded: Paths
    """The files."""
    out: Path
    """Folder to make: a file for each recording, and refused.csv."""
    columns: str = ""
    """Column map of a CSV file: highd, ind, interaction, ngsim, sind, or a .toml file."""
    most_states: int = MOST_STATES
    """Largest number of states in a file, to bound memory."""
    road: Path | None = None
    """Map of csv and sind: CommonRoad XML, Lanelet2 OSM, or a recording with lanelets."""
    origin: tuple[float, float] | None = None
    """Latitude and longitude, degrees, of the origin of CSV positions, for Lanelet2 maps."""
    position_error: float | None = None
    """Standard error of positions, m; by default the column map's, or 0.25."""
    speed_error: float | None = None
    """Standard error of speeds, m/s; by default the column map's, or 0.25."""

    def run(self) -> int:
        """Read all files, write the folder atomically, print."""
        one_of("format", self.format, FORMATS)
        if not self.recorded:
            raise UserError("name at least one file to import")
        if bool(self.columns) != (self.format == "csv"):
            raise UserError("--columns goes with csv, and csv needs it: name a column map")
        if self.out.exists() and (not self.out.is_dir() or any(self.out.iterdir())):
            raise UserError(f"{self.out} exists already: name a new folder, or remove it first")
        without_map = self.format in WITHOUT_MAP
        if self.road is not None and not without_map:
            raise UserError(f"--road goes with csv and sind: {self.format} has a map of its own")
        if self.origin is not None and not (
            without_map and -80 <= self.origin[0] <= 84 and -180 <= self.origin[1] <= 180
        ):
            raise UserError("--origin goes with csv and sind: latitude, -80 to 84, and longitude")
        columns = read_map(self.columns) if self.columns else None
        failed: list[dict[str, str]] = []
        with whole_folder(self.out) as folder:
            rows = self._import(folder, columns, failed)
            if not rows:
                remainder = f" (and {len(failed) - 1} more files)" if len(failed) > 1 else ""
                raise UserError(failed[0]["reason"] + remainder)
            refused, faults = (
                [{"recording": row["recording"], **item} for row in rows for item in row[kind]]
                for kind in ("refused", "faults")
            )
            listed = [*refused, *faults]
            used = sum_of(rows, "users")
            read = used + Counter(item["road_user"] or "unknown" for item in refused)
            users = account(read, used, lambda _: "see refused.csv")
            table = as_csv(listed) if listed else "recording,identity,reason,road_user\n"
            write_atomically(folder / "refused.csv", table)
        for failure in failed:
            say(f"not imported: {one_line(failure['reason'], 400)}")
        if self.json:
            written = {"out": str(self.out), "recordings": rows, "road_users": users}
            print_json(written | {"failed": failed})
        else:
            names = ("recording", "tracks", "states")
            lines = [
                {name: row[name] for name in names}
                | {"refused": len(row["refused"]), "states_per_s": round(row["states_per_s"])}
                for row in rows
            ]
            sums = {n: sum(line[n] for line in lines) for n in (*names[1:], "refused")}
            total = {"recording": "all", **sums, "states_per_s": ""}
            print_table([*lines, total] if len(lines) > 1 else lines, str(self.out))
            print_table(users, "\nroad users")
            if refused:
                print_table(refused, "\nrefused tracks")
            left_out = sum_of(rows, "skipped")
            if left_out:
                print_table([{"left out": name, "number": n} for name, n in left_out.items()])
            if faults:
                print_table(faults[:_SHOWN], f"\nnot read as it stands: {len(faults)}")
        return 1 if failed else 0

    def _import(
        self, folder: Path, columns: ColumnMap | None, failed: list[dict[str, str]]
    ) -> list[dict[str, Any]]:
        """Import each file; one that can't be read is listed, and the import goes on."""
        stated = {"position": self.position_error, "speed": self.speed_error}
        stated = {name: value for name, value in stated.items() if value is not None}
        assumed = columns.error if columns else MeasurementError()
        error = dataclasses.replace(assumed, **stated) if stated else None
        rows = []
        for path in self.recorded:
            began = time.perf_counter()
            try:
                recordings = import_file(
                    path, self.format, columns, self.most_states, self.road, error, self.origin
                )
            except UserError as fault:
                failed.append({"file": str(path), "reason": str(fault)})
                continue
            seconds = time.perf_counter() - began
            states = sum(imported.n_states for imported in recordings)
            say_if_apart([imported.recording for imported in recordings])
            for imported in recordings:
                tracks = imported.recording.tracks
                # The recording's name, without characters that file names can't have.
                plain = (c if c.isalnum() or c in "-_." else "-" for c in tracks.recording)
                name = "".join(plain).lstrip(".")[:150] or "recording"
                target = folder / f"{name}.safetensors"
                if target.exists():
                    same = f"another recording is named {one_line(tracks.recording, 60)} too"
                    reason = f"{path}: {same}: import it to a folder of its own"
                    failed.append({"file": str(path), "reason": reason})
                    continue
                row: dict[str, Any] = {
                    "recording": tracks.recording,
                    "file": target.name,
                    "sha256": files.save(target, imported.recording),
                    "tracks": tracks.n_tracks,
                    "states": tracks.n_states,
                    "users": classes_of(tracks.road_user),
                    "refused": [refused._asdict() for refused in imported.refused],
                    "skipped": imported.skipped,
                    "faults": [fault._asdict() for fault in imported.faults],
                }
                rows.append(row | {"states_per_s": states / seconds})
        return rows


NO_ROAD = "has no lanelets: name its map with --road, here or at `socialiq data import`"
_SHOWN = 20  # faults that are printed; all are in refused.csv


BESIDE = "beside the lanelets of the map"
NO_VEHICLE = "no vehicle on lanelets"


def classes_of(road_user: Int8[np.ndarray, " track"]) -> Counter[str]:
    """Return the number of tracks of each class of road users."""
    return Counter(RoadUser(kind).name.lower() for kind in sorted(road_user.tolist()))


def sum_of(rows: Sequence[Mapping[str, Any]], name: str) -> Counter[str]:
    """Return the sums of counts by name that rows have.

    Args:
        rows: Rows with a cell of counts, each a mapping from a name to a number.
        name: Name of that cell.
    """
    return sum((Counter(row[name]) for row in rows), Counter[str]())


@dataclass(frozen=True)
class Inspect(Printing):
    """Count the sites, the independent chains and the different vehicles of recordings.

    Sites are compared by the geometry of their lanes, vehicles by their motion.

    Example: socialiq data inspect lankershim/*.safetensors
    """

    recordings: Paths
    """Files of `socialiq data import`, or its folders."""

    def run(self) -> int:
        """Read, identify, print."""
        recordings = load_all(self.recordings)
        identified = identity.identify(recordings)
        rows: list[dict[str, Any]] = []
        for number, recording in enumerate(recordings):
            tracks = recording.tracks
            row: dict[str, Any] = {
                "recording": tracks.recording,
                "site": identified.site[number],
                "chain": identified.chain[number],
                "seconds": round(float((tracks.frame.max() + 1) * tracks.dt), 2),
                "tracks": tracks.n_tracks,
                "users": classes_of(tracks.road_user),
                "lanelets": len(recording.road.lanelets),
                "simulated": "; ".join(signs_of_simulation(tracks)),
            }
            rows.append(row)
        every_track = [recording.tracks for recording in recordings]
        users = users_used(every_track, [range(tracks.n_tracks) for tracks in every_track])
        counts: dict[str, Any] = {
            "recordings": len(rows),
            "sites": len(set(identified.site)),
            "chains": len(set(identified.chain)),
            "tracks": sum(row["tracks"] for row in rows),
            "vehicles": identified.n_vehicles,
        }
        if self.json:
            listed = {"recordings": rows, "road_users": users, "overlaps": identified.rows()}
            print_json({"counts": counts, **listed})
            return 0
        for row in rows:
            texts = ("recording", "site", "chain", "simulated")
            row |= {name: one_line(row[name], 80) for name in texts}
            row["users"] = ", ".join(f"{n} {name}" for name, n in row["users"].items())
        print_table(rows, "Recordings")
        _show_overlaps(identified)
        print_table([{"number of": name, "count": count} for name, count in counts.items()])
        print_table(users, "Road users")
        return 0


def load_all(paths: tuple[Path, ...], road: Path | None = None) -> list[Recording]:
    """Return the recordings of some files or folders, on a map if one is named.

    Raises:
        UserError: If there is none, one can't be read, or two have one name; the line names it.
    """
    every: list[Path] = []
    for path in paths:
        inside = sorted(path.glob("*.safetensors")) if path.is_dir() else [path]
        if not inside:
            raise UserError(f"{path} holds no recording: name a folder of `socialiq data import`")
        every += inside
    if not every:
        raise UserError("no recording: name at least one file of `socialiq data import`")
    recordings = [files.load(path) for path in every]
    identity.check_names([recording.tracks.recording for recording in recordings])
    if road is None:
        return recordings
    stated = {"map": road.name, "map_sha256": sha256_of_file(road)}
    maps: dict[str, RoadNetwork] = {}
    for number, recording in enumerate(recordings):
        source = recording.tracks.source
        frame = str([source.get(name) for name in ("utm_origin", "origin")])
        if frame not in maps:
            maps[frame] = map_of(road, source)
            if faults := maps[frame].faults:
                first = ", ".join(f"{name}: {one_line(why, 100)}" for name, why, _ in faults[:3])
                say(f"{road}: {len(faults)} elements or errors are left out: {first}")
        tracks = dataclasses.replace(recording.tracks, source=source | stated)
        recordings[number] = Recording(tracks, maps[frame])
    return recordings


def users_used(
    recorded: Sequence[Tracks], used: Sequence[Collection[int]], why: str = BESIDE
) -> list[Row]:
    """Return a row for each class of road users: how many were read, used and left out, and why.

    Args:
        recorded: The tracks of each recording.
        used: Those of each that the results are about.
        why: The reason for which vehicles are left out; others are because they are no vehicles.
    """
    read = Counter[str]()
    kept = Counter[str]()
    for tracks, numbers in zip(recorded, used, strict=True):
        read += classes_of(tracks.road_user)
        kept += classes_of(tracks.road_user[sorted(numbers)])
    vehicles = {kind.name.lower() for kind in VEHICLES}
    return account(read, kept, lambda name: why if name in vehicles else NO_VEHICLE)


def account(read: Counter[str], used: Counter[str], why: Callable[[str], str]) -> list[Row]:
    """Return the rows of `users_used` by the numbers of each class.

    Args:
        read: Number of road users of each class that were read.
        used: Number of those that the results are about.
        why: Function that returns the reason for which road users of a class are left out.

    Returns:
        A row for each class that was read, in alphabetical order; without left-out ones its reason
        is empty.
    """
    rows: list[Row] = []
    for name, number in sorted(read.items()):
        left_out = number - used[name]
        row: Row = {"road_user": name, "read": number, "used": used[name], "left_out": left_out}
        rows.append(row | {"why": why(name) if left_out else ""})
    return rows


@dataclass(frozen=True, kw_only=True)
class OfRecordings(Printing):
    """Base of commands on recordings with a road."""

    recordings: Paths
    """Files of `socialiq data import`, or its folders."""
    road: Path | None = None
    """Map of recordings without one: CommonRoad XML, Lanelet2 OSM, or a recording."""


@dataclass(frozen=True, kw_only=True)
class OfDistinct(OfRecordings):
    """Base of commands that count moments once though several recordings show them."""

    duplicates: Duplicates = "drop"
    """Moments that are in several recordings: count each once, keep all, or refuse."""

    def load(self, lanelets: bool = True) -> tuple[list[Recording], Identified]:
        """Return the recordings and what they have in common, which is said.

        Raises:
            UserError: If there is none, one can't be read or lacks lanelets that are needed, or
                moments in common are refused.
        """
        recordings = load_all(self.recordings, self.road)
        for recording in recordings:  # what can be refused, before the slow work
            if lanelets and not recording.road.lanelets:
                raise UserError(f"{one_line(recording.tracks.recording, 60)} {NO_ROAD}")
        shapely()
        identified = identity.identify_distinct(recordings, self.duplicates)
        if not self.json:
            remark(recordings, identified)
        return recordings, identified


def remark(recordings: Sequence[Recording], identified: Identified) -> None:
    """Say on standard error what recordings have in common, and which are simulated.

    It also says which have most of their vehicles' states on no lane.

    Args:
        recordings: The recordings.
        identified: Their sites, chains and vehicles.
    """
    with contextlib.redirect_stdout(sys.stderr):
        _show_overlaps(identified)
    say_if_apart(recordings)
    for recording in recordings:
        signs = signs_of_simulation(recording.tracks)
        if signs:
            name = one_line(recording.tracks.recording, 60)
            say(f"{name} is simulated, not human: {one_line(signs[0])}")


def say_if_apart(recordings: Sequence[Recording]) -> None:
    """Say on standard error which recordings have most of their vehicles' states on no lane."""
    for recording in recordings:
        tracks = recording.tracks
        name = one_line(recording.tracks.recording, 60)
        lines = [every_step(lanelet.centre) for lanelet in recording.road.lanelets.values()]
        rows = np.isin(tracks.road_user, VEHICLES)[tracks.track]
        if lines and rows.any():
            places = np.column_stack([tracks.x, tracks.y])[rows]
            points = np.concatenate(lines)[:, :2]
            reach = np.hypot(OFF_THE_MAP, STEP / 2)
            # No two places in a square with this diagonal are further apart.
            squares = (np.floor(at * np.sqrt(2.0) / reach) @ [1, 1j] for at in (places, points))
            if np.isin(*squares).mean() >= 0.5:
                continue
            share = (tree_of(points).query(places)[0] > reach).mean()
            if share > 0.5:
                say(
                    f"{name}: {100 * share:.0f} % of its vehicles' states are on no lane of the "
                    "map: name the map of these tracks with --road, and its --origin at import"
                )


def _show_overlaps(identified: Identified) -> None:
    names = ("first", "second")
    rows = [row | {n: one_line(str(row[n])) for n in names} for row in identified.rows()]
    if rows:
        print_table(rows, "Recordings with vehicles in common (lag: of the second's clock, s)")
        sys.stdout.flush()


def sources_of(recordings: Sequence[Recording]) -> list[dict[str, Any]]:
    """Return provenance by recording."""
    every = (recording.tracks for recording in recordings)
    return [{"recording": tracks.recording, "source": tracks.source} for tracks in every]
