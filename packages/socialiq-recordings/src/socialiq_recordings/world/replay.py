"""Recorded vehicles as demonstrations in the world's observations, actions and rewards."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int32, Int64

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair
from socialiq.worlds.intersection.options import settings_of
from socialiq_recordings.world.batch import Made, Traffic
from socialiq_recordings.world.config import SUB_STEPS
from socialiq_recordings.world.recorded_world import RecordedWorld

HUMAN, SIMULATED = MODES = ("human", "simulated")
"""Modes of recorded drivers, by whether the recording shows signs of a simulation."""


class Levels(NamedTuple):
    """Decisions as levels of acceleration.

    Attributes:
        action: Index of the closest level; of two equally close, the one nearer to 0.
        residual: Speed at the next decision minus that of the level, m/s.
    """

    action: Int32[np.ndarray, " decision"]
    residual: Float64[np.ndarray, " decision"]


def levels_of(
    speed: Float64[np.ndarray, " decision_and_one"], levels: Sequence[float], seconds: float
) -> Levels:
    """Return the closest level of acceleration of each decision.

    Args:
        speed: Speed at every decision, and at the end of the last one, m/s.
        levels: m/s², ascending.
        seconds: Duration of a decision.
    """
    values = np.asarray(levels, np.float64)
    changes = np.diff(speed)
    misses = changes[:, None] - values * seconds
    # A tie goes to the level nearer to 0.
    action = np.argmin(np.round(np.abs(misses), 9) + 1e-12 * np.abs(values), axis=1)
    return Levels(action.astype(np.int32), misses[np.arange(len(changes)), action])


class Replayed(NamedTuple):
    """Recorded decisions in the form of a world.

    Attributes:
        table: Demonstrations; an episode ends with ARRIVAL, or with TIMEOUT at the end of the view.
        vehicle: Number in the world of each episode's vehicle.
        step: Sub-step of each decision, from the recording's first frame.
        speed: At the end of each decision, m/s.
        signals: Signals of the rewards of each decision, in the order of `SIGNALS`.
        residual: Recorded speed at the next decision less that of the chosen level, m/s.
        change: Recorded change of speed of each decision, m/s.
    """

    table: Demonstrations
    vehicle: Int64[np.ndarray, " episode"]
    step: Int64[np.ndarray, " decision"]
    speed: Float64[np.ndarray, " decision"]
    signals: Float64[np.ndarray, "decision signal"]
    residual: Float64[np.ndarray, " decision"]
    change: Float64[np.ndarray, " decision"]

    @property
    def residual_rms(self) -> float:
        """Root mean square of the residual, m/s."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def squares_left(self) -> float:
        """Share of the squared changes of speed that the levels leave."""
        return float((self.residual**2).sum() / max((self.change**2).sum(), 1e-12))


def replay(world: RecordedWorld, every: float = 0.0, as_human: bool = False) -> Replayed:
    """Return the decisions of every vehicle whose place an ego can take.

    Args:
        world: The world.
        every: s between the beginnings of a vehicle's episodes. The recorded moments between two
            decisions are then used too, by episodes that begin there; their decisions overlap and
            are not independent. 0: one episode for each vehicle.
        as_human: Whether vehicles of simulated recordings get the mode of people, too.

    Raises:
        UserError: If no vehicle is seen for a whole decision.
    """
    runs = [
        (vehicle, steps)
        for vehicle in world.road.egos.tolist()
        for steps in _runs(world, vehicle, round(every * SUB_STEPS))
    ]
    if not runs:
        raise UserError("no vehicle is seen for a whole decision: nothing is demonstrated")
    vehicles = np.array([vehicle for vehicle, _ in runs], np.int64)
    steps = np.concatenate([steps for _, steps in runs])
    episode = np.repeat(np.arange(len(runs)), [len(steps) for _, steps in runs])
    recording = np.searchsorted(world.road.recording_first, vehicles[episode], side="right") - 1
    results = _made(world, recording, vehicles[episode], steps)
    last = np.append(np.diff(episode) > 0, True)
    action, residual = np.zeros(len(steps), np.int32), np.zeros(len(steps))
    for number in range(len(runs)):
        rows = np.flatnonzero(episode == number)
        levels = levels_of(results.speed[rows], world.config.levels, 1 / world.config.policy_rate)
        action[rows[:-1]], residual[rows[:-1]] = levels
    rows = np.flatnonzero(~last)
    ending = results.ending.copy()
    final = rows[last[rows + 1]]  # the last decision of its episode
    ending[final] = np.where(ending[final] == int(Ending.NONE), int(Ending.TIMEOUT), ending[final])
    observation = results.observation.reshape(len(steps), -1)
    simulated = np.array(
        [int(source["simulated"] and not as_human) for source in world.provenance["recordings"]]
    )
    table = Demonstrations.of(
        observation=observation[rows],
        action=action[rows],
        next_observation=observation[rows + 1],
        ending=ending[rows],
        rewards=RewardPair(results.pair[rows, 0], results.pair[rows, 1]),
        episode=episode[rows],
        mode=simulated[recording[rows]],
        mode_names=MODES,
        n_actions=world.n_actions,
        source={"made_by": "socialiq data world", "world": world.provenance, "every": every},
    )
    return Replayed(
        table,
        vehicles,
        steps[rows],
        results.speed[rows + 1],
        results.signals[rows],
        residual[rows],
        results.speed[rows + 1] - results.speed[rows],
    )


def _runs(world: RecordedWorld, vehicle: int, every: int) -> list[Int64[np.ndarray, " decision"]]:
    """Return the sub-steps of a vehicle's decisions and of their end, one run a beginning."""
    road, frames = world.road, world.config.frames
    begin, end = road.state_first[vehicle : vehicle + 2].tolist()
    along = road.state[begin:end, 0]
    runs = []
    for start in range(0, frames, every) if every else (0,):
        rows = np.arange(start, len(along), frames)
        arrived = np.flatnonzero(along[rows] >= road.arrival[vehicle])
        if len(arrived):
            rows = rows[: arrived[0] + 1]
        if len(rows) > 1:
            runs.append(int(road.state_step[vehicle]) + rows)
    return runs


def _made(
    world: RecordedWorld,
    recording: Int64[np.ndarray, " moment"],
    vehicle: Int64[np.ndarray, " moment"],
    steps: Int64[np.ndarray, " moment"],
) -> Made:
    """Return observation, and the rewards of the decision that follows, at recorded moments."""
    from socialiq.worlds.highway.core.compile import run_in_parts
    from socialiq_recordings.world import core

    results = Made.of(world, len(steps))
    settings = settings_of(world.config.options(world.max_speed))
    egos = vehicle - world.road.recording_first[recording]
    moments = (recording.astype(np.int64), egos.astype(np.int64), steps.astype(np.int64))
    traffic = Traffic.of(world, 1)
    run_in_parts(core.replay, 1, len(steps), world.road, traffic, results, *moments, settings)
    return results
