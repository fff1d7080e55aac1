"""Prediction over the latency at constant velocity, beside prediction by a driver model.

    python benchmarks/idm_prediction.py

The shipped dial of the intersection drives with actions that are one decision late, behind a front
end that lets other vehicles keep their velocity, brake for the vehicle ahead of them by the
Intelligent Driver Model (IDM) with highway-env's parameters, or speed up by it as well.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from socialiq.cli.output import print_table
from socialiq.evaluation.episodes import episodes_of
from socialiq.nn.dial_policy import DialPolicy
from socialiq.physics import desired_gap
from socialiq.storage import packaged_results
from socialiq.worlds.highway.ego import POSITION_RANGE, SPEED_RANGE
from socialiq.worlds.highway.perception import NUMPY, Arrays, FrontEnd
from socialiq.worlds.intersection.options import POPULATIONS, Options
from socialiq.worlds.intersection.world import Intersection

FIRST_SEED, EPISODES, ANGLES = 340_000_000, 1_000, (0.0, 45.0, 75.0)
DIAL = "intersection-dial-clock/iterated.safetensors"
ASIDE, SAME_WAY = 2.0, 0.7  # of a leader: m to a side at most, cosine between headings at least
IDM = POPULATIONS["highway_env"]


@dataclass(frozen=True)
class IDMFrontEnd(FrontEnd):
    """Front end whose prediction of others has accelerations of the IDM, up to a largest one."""

    largest: float = 0.0  # m/s²

    def _predicted(
        self, ego: Any, vehicles: Any, waiting: Any, on: Any, xp: Arrays = NUMPY
    ) -> tuple[Any, Any, Any]:
        later, rows, memory = super()._predicted(ego, vehicles, waiting, on, xp)
        seconds, there = self.latency / self.rate, vehicles[..., 0] > 0
        heading = vehicles[..., 5:7]
        speed = (vehicles[..., 3:5] * heading).sum(axis=-1) * SPEED_RANGE
        change = seconds * _acceleration(ego, vehicles).clip(-np.inf, self.largest)
        after = (speed + change).clip(0.0)
        way = heading * (seconds * (speed + after) / 2.0 / POSITION_RANGE)[..., None]
        rows[..., 1:3] = np.where(there[..., None], vehicles[..., 1:3] + way, rows[..., 1:3])
        moving = heading * (after / SPEED_RANGE)[..., None]
        rows[..., 3:5] = np.where(there[..., None], moving, rows[..., 3:5])
        return later, rows, memory


def _acceleration(ego: np.ndarray, vehicles: np.ndarray) -> np.ndarray:
    """Return the acceleration (batch, vehicles) of the IDM in m/s², for the leader that matters."""
    rows = np.concatenate([ego, vehicles], axis=1)[:, None]
    cos, sin = vehicles[..., 5:6], vehicles[..., 6:7]
    x, y = ((rows[..., i] - vehicles[..., i : i + 1]) * POSITION_RANGE for i in (1, 2))
    ahead, aside = x * cos + y * sin, y * cos - x * sin
    leads = (rows[..., 0] > 0) & (ahead > 0) & (np.abs(aside) < ASIDE)
    leads &= rows[..., 5] * cos + rows[..., 6] * sin > SAME_WAY
    speeds = (rows[..., 3] * rows[..., 5] + rows[..., 4] * rows[..., 6]) * SPEED_RANGE
    speed = (vehicles[..., 3:4] * cos + vehicles[..., 4:5] * sin) * SPEED_RANGE
    strongest, comfort = IDM.max_acceleration.mean, IDM.comfort_deceleration.mean
    steady = IDM.jam_distance.mean + speed * IDM.time_headway.mean
    desired = desired_gap(steady, speed, speed - speeds, strongest, comfort)
    braking = np.where(leads, (desired / ahead.clip(1.0)) ** 2, 0.0).max(axis=2)
    return strongest * (1.0 - (speed[..., 0] / Options().max_speed) ** 4 - braking)


def main() -> None:
    """Print J and collisions of each prediction by angle."""
    dial = DialPolicy.load(packaged_results() / DIAL)
    world, seeds = Intersection().shifted("late", "known"), np.arange(EPISODES) + FIRST_SEED
    assert world.front_end is not None
    known = vars(world.front_end)
    predictions = {
        "constant velocity": FrontEnd(**known),
        "braking by the IDM": IDMFrontEnd(**known),
        "IDM": IDMFrontEnd(**known, largest=np.inf),
    }
    rows = []
    for name, front_end in predictions.items():
        batch = dataclasses.replace(world, front_end=front_end).batch(256)
        for angle in ANGLES:
            metrics = episodes_of(batch, dial.at(angle), seeds).metrics()
            value = {"angle": angle, "J": metrics.value(angle)}
            rows.append({"prediction": name} | value | {"collision": metrics.collision})
    print_table(rows, f"One decision of latency, {EPISODES} episodes from seed {FIRST_SEED}")


if __name__ == "__main__":
    main()
