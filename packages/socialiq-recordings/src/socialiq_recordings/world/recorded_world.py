"""World of recorded junctions as arrays, and its file."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from gymnasium import spaces

from socialiq import storage
from socialiq.errors import UserError, one_of
from socialiq.worlds import WORLD_FILE
from socialiq.worlds.highway.options import FEATURES, SIGNALS, reward_definition
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.world import ConstantPolicy, World
from socialiq_recordings.world.config import WorldConfig

if TYPE_CHECKING:
    from socialiq_recordings.world.batch import JunctionBatch

KIND = WORLD_FILE
SCHEMA_VERSION = 1

LAYOUT: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "recording_first": (np.int64, ()),
    "pair_first": (np.int64, ()),
    "identity": (np.int64, ()),
    "length": (np.float64, ()),
    "width": (np.float64, ()),
    "arrival": (np.float64, ()),
    "origin": (np.float64, ()),
    "zone": (np.float64, (2,)),
    "egos": (np.int64, ()),
    "line_first": (np.int64, ()),
    "line": (np.float64, (4,)),
    "state_first": (np.int64, ()),
    "state_step": (np.int64, ()),
    "state": (np.float64, (2,)),
    "area_of": (np.int64, ()),
    "area": (np.float64, (4,)),
    "area_yields": (np.int64, ()),
    "area_merges": (np.int64, ()),
    "stretch_first": (np.int64, ()),
    "stretch": (np.float64, (4,)),
    "closed_first": (np.int64, ()),
    "closed": (np.float64, (3,)),
    "drivers": (np.float64, (4,)),
}
"""Arrays: type, and shape of one row."""

_INFINITE = ("closed",)


class Road(NamedTuple):
    """Arrays that the compiled core reads; vehicles are numbered over all recordings.

    Attributes:
        recording_first: First vehicle of each recording, and the number of vehicles.
        pair_first: Place of each recording's first ordered pair, and the number of pairs. Pair
            (i, j) of a recording of n vehicles is at n i + j.
        identity: Number in the file that was recorded.
        length: m.
        width: m.
        arrival: Coordinate at which the vehicle as ego has arrived, m.
        origin: Coordinate on its way that its observations count from, m.
        zone: Influence zone, from and to, m.
        egos: Vehicles whose place the ego can take.
        line_first: First point of each way, and the number of points.
        line: x and y in m, direction in rad, largest speed in m/s, a point every metre.
        state_first: First recorded state of each way, and the number of states.
        state_step: Sub-step of that state from the recording's first frame.
        state: Coordinate in m and speed in m/s, a state each sub-step.
        area_of: Conflict area of a pair, -1 if there is none.
        area: Entry and exit of the first vehicle, then of the other, m.
        area_yields: 1 if the first vehicle yields, -1 if the other does, 0 if who comes first goes.
        area_merges: 1 if the ways merge, 0 if they cross.
        stretch_first: First stretch of a pair: where the other's way lies in the first one's.
        stretch: Begin and end on the other's way, then on the first one's, m.
        closed_first: First closure of each way.
        closed: Coordinate of a closed line in m, from and to in s.
        drivers: Mean, deviation and bounds of each parameter of `drivers.Drivers`.
    """

    recording_first: np.ndarray
    pair_first: np.ndarray
    identity: np.ndarray
    length: np.ndarray
    width: np.ndarray
    arrival: np.ndarray
    origin: np.ndarray
    zone: np.ndarray
    egos: np.ndarray
    line_first: np.ndarray
    line: np.ndarray
    state_first: np.ndarray
    state_step: np.ndarray
    state: np.ndarray
    area_of: np.ndarray
    area: np.ndarray
    area_yields: np.ndarray
    area_merges: np.ndarray
    stretch_first: np.ndarray
    stretch: np.ndarray
    closed_first: np.ndarray
    closed: np.ndarray
    drivers: np.ndarray


@dataclass(frozen=True, eq=False)
class RecordedWorld(World):
    """World of recorded junctions.

    Its rule-based drivers are a driver of the calibrated population, which knows the ways of the
    others and the closed lines that policies see in part; always faster; and always slower.

    Attributes:
        road: Its arrays.
        config: Options of its decisions and rewards.
        max_speed: v_max of Eq 4.1 and 4.2, and the ego's largest speed, m/s.
        provenance: Recordings, calibration and counts, as JSON.
        sha256: Of the file's content; "" if it was not read from a file.
        name: Name in hashes, the same for every file.
    """

    road: Road
    config: WorldConfig
    max_speed: float
    provenance: dict[str, Any]
    sha256: str = ""
    name: str = "recorded-junction"

    draws_by_seed: ClassVar[bool] = True
    drivers: ClassVar[tuple[str, ...]] = ("driver", "go", "wait")
    references: ClassVar[tuple[str, ...]] = drivers

    @property
    def description(self) -> str:
        """Format and SHA-256 of the file's content as JSON with sorted keys."""
        described = {"content": self.sha256, "format": SCHEMA_VERSION, "name": self.name}
        return json.dumps(described, sort_keys=True, separators=(",", ":"))

    @property
    def options(self) -> Options:
        """Options of the reward pair."""
        return self.config.options(self.max_speed)

    @property
    def whole_episode(self) -> int:
        """Decisions of an episode; recorded vehicles leave the view before theirs is over."""
        return self.config.decisions

    @property
    def reward(self) -> dict[str, Any]:
        """Definition of the reward pair: weights of the signals, and the options that matter."""
        return reward_definition(self.options)

    @property
    def signal_names(self) -> tuple[str, ...]:
        """Names of all signals, those of r_env first."""
        return SIGNALS

    @property
    def action_space(self) -> spaces.Discrete:
        """Space of one action: the number of an acceleration, the strongest braking first."""
        return spaces.Discrete(len(self.config.levels))

    def driver(self, name: str, seed: int = 0) -> ConstantPolicy:  # noqa: ARG002  none is random
        """Return a driver of `drivers`.

        Raises:
            UserError: If the name is unknown.
        """
        from socialiq_recordings.world.batch import AS_DRIVER

        one_of("driver of a recorded junction", name, self.drivers)
        actions = {"driver": AS_DRIVER, "go": self.n_actions - 1, "wait": 0}
        return ConstantPolicy(actions[name])

    def batch(self, size: int, threads: int = 1) -> JunctionBatch:
        """Return episodes side by side."""
        from socialiq_recordings.world.batch import JunctionBatch

        return JunctionBatch(self, size, threads)

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return self.config.observed_vehicles * len(FEATURES)

    @property
    def capacity(self) -> int:
        """Largest number of vehicles of a recording."""
        return int(np.diff(self.road.recording_first).max())

    def save(self, path: Path, replace: bool = False) -> str:
        """Write the world to one file, whole or not at all.

        Returns:
            SHA-256 of the content.

        Raises:
            UserError: If the file can't be written.
        """
        header = {
            "config": self.config.as_header(),
            "max_speed": self.max_speed,
            "provenance": self.provenance,
        }
        arrays = self.road._asdict()
        return storage.save_arrays(path, KIND, SCHEMA_VERSION, arrays, header, replace)

    @staticmethod
    def load(path: Path) -> RecordedWorld:
        """Read a world written by `save`, checking that its parts agree.

        Raises:
            UserError: If the file is missing, damaged, or holds something else.
        """
        arrays, header = storage.load_arrays(path, KIND, SCHEMA_VERSION)
        fault = _fault(arrays) or _header_fault(header)
        if fault:
            raise UserError(f"{path} {fault}: make the world again with `socialiq data world`")
        try:
            config = WorldConfig.of_header(header["config"])
        except (UserError, TypeError, KeyError, ValueError) as error:
            raise UserError(
                f"{path} has options that make no world: make it again with `socialiq data world`"
            ) from error
        road = Road(**{name: np.ascontiguousarray(arrays[name]) for name in LAYOUT})
        return RecordedWorld(
            road, config, header["max_speed"], header["provenance"], header["sha256"]
        )

    def with_config(self, **changes: Any) -> RecordedWorld:
        """Return the same road under other options."""
        return dataclasses.replace(self, config=dataclasses.replace(self.config, **changes))


def _header_fault(header: dict[str, Any]) -> str:
    speed = header.get("max_speed")
    if not (isinstance(speed, float) and 0 < speed < 1e3):
        return "has no largest speed"
    if not isinstance(header.get("provenance"), dict) or not isinstance(header.get("config"), dict):
        return "has no provenance or options"
    return ""


def _fault(arrays: dict[str, np.ndarray]) -> str:
    """Return what is wrong with a world's arrays; "" if nothing is.

    The compiled core checks no index, so that each is checked here.
    """
    for name, (dtype, shape) in LAYOUT.items():
        array = arrays.get(name)
        if array is None or array.dtype != dtype or array.shape[1:] != shape or array.ndim < 1:
            return f"lacks the column {name}, or has it in another form"
        if name in _INFINITE:
            if np.isnan(array).any():
                return f"has numbers in {name} that are none"
        elif not np.isfinite(array).all():
            return f"has numbers in {name} that are not finite"
    if set(arrays) != set(LAYOUT):
        return "has columns that are no world's"
    return _count_fault(arrays) or _index_fault(arrays)


def _count_fault(arrays: dict[str, np.ndarray]) -> str:
    vehicles, counts = len(arrays["identity"]), np.diff(arrays["recording_first"])
    offsets = {
        "recording_first": (None, vehicles),
        "pair_first": (len(counts) + 1, len(arrays["area_of"])),
        "line_first": (vehicles + 1, len(arrays["line"])),
        "state_first": (vehicles + 1, len(arrays["state"])),
        "stretch_first": (len(arrays["area_of"]) + 1, len(arrays["stretch"])),
        "closed_first": (vehicles + 1, len(arrays["closed"])),
    }
    for name, (rows, total) in offsets.items():
        first = arrays[name]
        sized = len(first) >= 2 and (rows is None or len(first) == rows)
        if not sized or first[0] != 0 or first[-1] != total or (np.diff(first) < 0).any():
            return f"has places in {name} that don't fit the other columns"
    if (counts < 1).any() or (np.diff(arrays["pair_first"]) != counts**2).any():
        return "has a recording without vehicles or pairs"
    short = (np.diff(arrays["line_first"]) < 2) | (np.diff(arrays["state_first"]) < 1)
    if short.any():
        return "has a vehicle without a line or a state"
    for name in ("length", "width", "arrival", "origin", "zone", "state_step"):
        if len(arrays[name]) != vehicles:
            return f"has another number of rows in {name} than vehicles"
    return ""


def _index_fault(arrays: dict[str, np.ndarray]) -> str:
    vehicles, areas = len(arrays["identity"]), len(arrays["area"])
    egos, of = arrays["egos"], arrays["area_of"]
    if len(egos) < 1 or (egos < 0).any() or (egos >= vehicles).any():
        return "has an ego that is no vehicle"
    if (of < -1).any() or (of >= areas).any():
        return "has a conflict area that isn't there"
    if len(arrays["area_yields"]) != areas or len(arrays["area_merges"]) != areas:
        return "has conflict areas without a right of way"
    if (arrays["length"] <= 0).any() or (arrays["width"] <= 0).any():
        return "has a vehicle without a size"
    if (np.abs(arrays["state_step"]) > 10**9).any() or (arrays["state_step"] < 0).any():
        return "has a state before the recording"
    if arrays["drivers"].shape != (6, 4) or (arrays["drivers"][:, (0, 2, 3)] <= 0).any():
        return "has drivers without parameters"
    if (np.abs(arrays["line"]) > 1e8).any() or (arrays["line"][:, 3] <= 0).any():
        return "has a line that is none"
    return ""
