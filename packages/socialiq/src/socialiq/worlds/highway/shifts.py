"""Shifts of a road: changes of what the ego is shown, when it acts, and of the traffic.

Faults of observations work on the array of observed vehicles, (batch, rows of 7 numbers), so that
compiled cores stay as they are. Their random numbers are a hash of the episode, the decision and
the row: an episode has the same faults for every policy, in every batch, and in copies of a state.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Float32, UInt64

from socialiq.errors import UserError, one_of
from socialiq.settings import assignments, changed
from socialiq.worlds.highway.core.geometry import VEHICLE_WIDTH
from socialiq.worlds.highway.core.splitmix import following
from socialiq.worlds.highway.ego import EgoModel
from socialiq.worlds.highway.options import FEATURES, MOST_SPEEDS

Exit = Literal["", "own", "left", "right", "straight"]

OR = " or "  # between shifts of which each episode draws one
KEPT = 0.8  # correlation of a drift between two decisions
MOST_LATE = 8  # decisions
WET = 1.5  # times as many decisions from the slowest to the fastest target speed


@dataclass(frozen=True)
class Shift:
    """Changes of a road; by default none. Other roads than the intersection lack some options.

    The ego's own row has no faults. Errors of velocity in m/s are half of those of position in m.

    Raises:
        UserError: If a value is out of its range.
    """

    latency: int = 0  # decisions by which actions are late; the first ones keep the speed
    unseen: float = 0.0  # probability of each other vehicle to be missing, in each decision
    sight: float = math.inf  # m beyond which vehicles are missing
    occlusion: bool = False  # whether a nearer vehicle hides those behind it
    noise: float = 0.0  # m, standard deviation of the error of each vehicle in each decision
    drift: float = 0.0  # m, of an error that all vehicles share, with correlation `KEPT`
    exit: Exit = ""  # the ego's exit; "": as in the world's options, so in the following ones
    connected: bool = False  # whether drivers see leaders beyond their lane, as in intersection-v2
    cars: int = 0  # `initial_vehicle_count`
    spawn: float = -1.0  # `spawn_probability`; -1: as in the world's options
    drivers: str = ""  # `population`
    rate: int = 0  # decisions per second
    # whether a decision changes the target speed by about two thirds of what it does on the dry
    # road (by 3 m/s at the intersection), and drivers are of the population `wet`
    wet: bool = False

    def __post_init__(self) -> None:
        limits = {"latency": MOST_LATE, "unseen": 1.0, "noise": 100.0, "drift": 100.0}
        for name, most in limits.items():
            if not 0 <= getattr(self, name) <= most:
                raise UserError(f"{name} must be from 0 to {most:g}, got {getattr(self, name)}")
        if not (self.spawn == -1 or 0 <= self.spawn <= 1):
            raise UserError(f"spawn must be from 0 to 1, got {self.spawn}")
        if not self.sight > 0:
            raise UserError(f"sight must be a positive number of metres, got {self.sight}")
        one_of("exit", self.exit, ("left", "right", "straight", ""))

    def __str__(self) -> str:
        return ",".join(f"{name}={value}" for name, value in self.changes.items()) or "none"

    @property
    def changes(self) -> dict[str, Any]:
        """The fields that are not as by default."""
        fields = dataclasses.fields(self)
        values = vars(self)
        return {f.name: values[f.name] for f in fields if values[f.name] != f.default}

    @property
    def has_faults(self) -> bool:
        """Whether observations or the times of actions change."""
        return bool(self.changes.keys() & {field.name for field in FAULTS})

    def options_of(self, target_speeds: Sequence[float]) -> dict[str, Any]:
        """Return the options of a road that it changes.

        Args:
            target_speeds: The ego's on this road, m/s.

        Raises:
            UserError: If there are too many target speeds for a wet road.
        """
        changes = {OPTIONS[name]: value for name, value in self.changes.items() if name in OPTIONS}
        if self.wet:
            changes["population"] = self.drivers or "wet"
            count = 1 + round(WET * (len(target_speeds) - 1))
            if count > MOST_SPEEDS:
                raise UserError(
                    f"a wet road has half more steps of speed: give at most 5 target_speeds, not "
                    f"{len(target_speeds)}"
                )
            speeds = np.linspace(target_speeds[0], target_speeds[-1], count)
            changes["target_speeds"] = tuple(speeds.tolist())
        return changes


FAULTS = dataclasses.fields(Shift)[:6]
"""Fields that change observations or the times of actions; the others are options of the world."""

OPTIONS = {
    "exit": "destination",
    "connected": "connected_lanes",
    "cars": "initial_vehicle_count",
    "spawn": "spawn_probability",
    "drivers": "population",
    "rate": "policy_frequency",
}
"""Option of the road that a field is; `wet` changes two."""

SHIFTS = {
    "none": Shift(),
    "late": Shift(latency=1),
    "unseen-10": Shift(unseen=0.1),
    "unseen-30": Shift(unseen=0.3),
    "near": Shift(sight=25.0),
    "occluded": Shift(occlusion=True),
    "noise-1": Shift(noise=1.0),
    "noise-3": Shift(noise=3.0),
    "drift-2": Shift(drift=2.0),
    "right": Shift(exit="right"),
    "straight": Shift(exit="straight"),
    "connected": Shift(connected=True),
    "dense": Shift(cars=10, spawn=0.6),
    "drivers": Shift(drivers="thesis"),
    "twice": Shift(rate=2),
    "wet": Shift(wet=True),
}
"""Shifts by name; `dense` is highway-env's own traffic."""


def shift_of(text: str) -> Shift:
    """Return the shift of names of `SHIFTS` and FIELD=VALUE with commas, as `late,noise=1`.

    Raises:
        UserError: If a name, a field or a value is unknown.
    """
    values: dict[str, Any] = {}
    for word in filter(None, map(str.strip, text.split(","))):
        if "=" in word:
            values |= assignments([word])
            continue
        one_of("shift", word, (*SHIFTS, "FIELD=VALUE"))
        values |= SHIFTS[word].changes
    return changed(Shift(), values)


def shifts_of(text: str) -> tuple[Shift, ...]:
    """Return the shifts of a text, with `OR` between those of which each episode draws one."""
    return tuple(map(shift_of, text.split(OR)))


def key_of(seeds: np.ndarray) -> UInt64[np.ndarray, " batch"]:
    """Return the keys of episodes by their seeds, or of the following ones by the keys before."""
    return following(seeds.astype(np.uint64))


def values_of(shifts: Sequence[Shift], name: str, key: UInt64[np.ndarray, " batch"]) -> np.ndarray:
    """Return a field's value in each episode.

    Args:
        shifts: Shifts of which each episode draws one by its key.
        name: Name of the field.
        key: Key of each episode.
    """
    values = np.array([getattr(shift, name) for shift in shifts])
    if (values == values[0]).all():
        return np.full(len(key), values[0])
    return values[(_uniform(key, 0) * len(shifts)).astype(np.int64)]


def with_faults(
    shifts: Sequence[Shift],
    observation: Float32[np.ndarray, "batch feature"],
    key: UInt64[np.ndarray, " batch"],
    time: Float32[np.ndarray, " batch"],
    ego: EgoModel,
) -> Float32[np.ndarray, "batch feature"]:
    """Return observations with the faults of the episodes; vehicles that are left come first.

    Args:
        shifts: Of which each episode draws one.
        observation: True observations.
        key: Of each episode.
        time: Of each episode, in decisions.
        ego: Scales of the observation.
    """
    rows = observation.reshape(len(observation), -1, len(FEATURES)).copy()
    others = rows[:, 1:]
    number = np.arange(rows.shape[1] - 1, dtype=np.uint64)
    now = time.astype(np.uint64)[:, None]
    unit = np.array(ego.units)
    origin = np.float32(0.0) if ego.relative else rows[:, :1, 1:3]
    offset = (others[..., 1:3] - origin).astype(np.float64) * unit[:2]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    value = {field.name: values_of(shifts, field.name, key) for field in FAULTS}
    hidden = distance > value["sight"][:, None]
    if (partly := value["unseen"] > 0).any():
        draw = _uniform(key[partly, None], 1, now[partly], number)
        hidden[partly] |= draw < value["unseen"][partly, None]
    if value["occlusion"].any():
        hidden |= value["occlusion"][:, None] & _behind(offset, distance, others[..., 0] > 0)
    if (noisy := value["noise"] > 0).any():
        columns = np.arange(4, dtype=np.uint64)
        error = _normal(key[noisy, None, None], 2, now[noisy, :, None], number[:, None], columns)
        error *= value["noise"][noisy, None, None] * np.array([1.0, 1.0, 0.5, 0.5])
        others[noisy, :, 1:5] += error / unit
    if value["drift"].any():
        error = value["drift"][:, None] * _drift(key, now)
        others[..., 1:3] += (error / unit[:2])[:, None]
    others[hidden | (others[..., 0] == 0)] = 0.0
    order = np.argsort(others[..., 0] == 0, axis=1, kind="stable")
    rows[:, 1:] = np.take_along_axis(others, order[..., None], axis=1)
    return rows.clip(-1.0, 1.0 if rows[..., 0].max() <= 1 else None).reshape(observation.shape)


def _behind(
    offset: Float[np.ndarray, "batch other 2"], distance: np.ndarray, present: np.ndarray
) -> np.ndarray:
    """Whether the line from the ego to each vehicle passes within 1 m of a nearer one."""
    along = np.einsum("bic,bjc->bij", offset, offset) / np.maximum(distance, 1e-9)[:, None, :]
    across = np.sqrt(np.maximum(distance[..., None] ** 2 - along**2, 0.0))
    nearer = (along > 0) & (distance[..., None] < distance[:, None] - VEHICLE_WIDTH)
    return ((across < VEHICLE_WIDTH / 2) & nearer & present[..., None]).any(axis=1)


def _drift(key: np.ndarray, now: np.ndarray) -> Float[np.ndarray, "batch 2"]:
    """Return a stationary autoregressive error of unit variance in x and y."""
    then = np.arange(int(now.max(initial=0)) + 1, dtype=np.uint64)
    draws = _normal(key[:, None, None], 3, then[:, None], np.arange(2, dtype=np.uint64))
    age = now.astype(np.float64) - then
    weight = np.where(then == 0, 1.0, math.sqrt(1.0 - KEPT**2)) * KEPT ** np.maximum(age, 0.0)
    return np.einsum("bt,btc->bc", weight * (age >= 0), draws)


def _uniform(key: np.ndarray, *counters: Any) -> np.ndarray:
    """Return a number in (0, 1) for a key and counters, which are broadcast."""
    number = key
    for counter in counters:
        number = following(number ^ following(np.atleast_1d(np.asarray(counter, np.uint64))))
    return ((number >> np.uint64(12)) + 0.5) * 2.0**-52


def _normal(key: np.ndarray, *counters: Any) -> np.ndarray:
    """Return standard normal numbers by Box and Muller."""
    radius = np.sqrt(-2.0 * np.log(_uniform(key, *counters, 0)))
    return radius * np.cos(2.0 * math.pi * _uniform(key, *counters, 1))
