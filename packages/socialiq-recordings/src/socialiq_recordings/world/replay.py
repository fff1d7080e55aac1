"""Recorded vehicles as demonstrations in the world's observations, actions and rewards."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair
from socialiq.worlds.highway.options import Buffers, settings_of
from socialiq_recordings.world.batch import PLACE, records_of
from socialiq_recordings.world.config import SUB_STEPS
from socialiq_recordings.world.recorded_world import RecordedWorld

MADE_BY = "socialiq data world"
MODES = ("human", "simulated")
HUMAN, SIMULATED = MODES
"""Modes of recorded drivers, by whether the recording shows signs of a simulation."""


class Replayed(NamedTuple):
    """Recorded decisions in the form of a world."""

    # demonstrations; an episode ends with ARRIVAL, or with TIMEOUT at the end of the view
    table: Demonstrations
    vehicle: Int64[np.ndarray, " episode"]  # number in the world of each episode's vehicle
    # sub-step of each decision, from the recording's first frame
    step: Int64[np.ndarray, " decision"]
    speed: Float64[np.ndarray, " decision"]  # at the end of each decision, m/s
    # signals of the rewards of each decision, in the order of `SIGNALS`
    signals: Float64[np.ndarray, "decision signal"]
    # recorded speed at the next decision less that of the chosen level, m/s
    residual: Float64[np.ndarray, " decision"]
    change: Float64[np.ndarray, " decision"]  # recorded change of speed of each decision, m/s

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

    The action of a decision is the level closest to its change of speed; of two equally close, the
    one nearer to 0.

    Args:
        world: The world.
        every: s between the beginnings of a vehicle's episodes, whose decisions then overlap and
            are not independent. 0: one episode for each vehicle.
        as_human: Whether vehicles of simulated recordings get the mode of people, too.

    Raises:
        UserError: If no vehicle is seen for a whole decision, or the world rewards what is caused.
    """
    if world.effects:
        raise UserError(
            "a recording has no episode without its driver: demonstrations of the recorded are of "
            "Eq 4.2; drive a policy in this world (`socialiq collect WORLD --driver POLICY`)"
        )
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
    results = _results(world, recording, vehicles[episode], steps)
    last = np.append(np.diff(episode) > 0, True)
    rows = np.flatnonzero(~last)
    ending = results.ending.copy()
    final = rows[last[rows + 1]]  # the last decision of its episode
    ending[final] = np.where(ending[final] == int(Ending.NONE), int(Ending.TIMEOUT), ending[final])
    change = results.speed[rows + 1] - results.speed[rows]
    levels = np.array(world.levels)
    misses = change[:, None] - levels * (1 / world.config.policy_rate)
    # A tie goes to the level nearer to 0.
    action = np.argmin(np.round(np.abs(misses), 9) + 1e-12 * np.abs(levels), axis=1)
    observation = results.observation.reshape(len(steps), -1)
    simulated = np.array(
        [int(source["simulated"] and not as_human) for source in world.provenance["recordings"]]
    )
    table = Demonstrations.of(
        observation=observation[rows],
        action=action.astype(np.int32),
        next_observation=observation[rows + 1],
        ending=ending[rows],
        rewards=RewardPair(results.rewards[rows, 0], results.rewards[rows, 1]),
        episode=episode[rows],
        mode=simulated[recording[rows]],
        mode_names=MODES,
        n_actions=world.n_actions,
        source={"made_by": MADE_BY, "world": world.provenance, "every": every},
    )
    signals = results.signals[rows]
    residual = misses[np.arange(len(rows)), action]
    speed = results.speed[rows + 1]
    return Replayed(table, vehicles, steps[rows], speed, signals, residual, change)


def _runs(world: RecordedWorld, vehicle: int, every: int) -> list[Int64[np.ndarray, " decision"]]:
    """Return the sub-steps of a vehicle's decisions and of their end, one run a beginning."""
    road = world.road
    frames = world.config.frames
    most = world.config.decisions
    begin, end = road.state_first[vehicle : vehicle + 2].tolist()
    along = road.state[begin:end, 0]
    runs = []
    for start in range(0, frames, every) if every else (0,):
        rows = np.arange(start, len(along), frames)
        arrived = np.flatnonzero(along[rows] >= road.arrival[vehicle])
        if len(arrived):
            rows = rows[: arrived[0] + 1]
        size = len(rows) - 1 if len(rows) - 1 <= most else max(most - 1, 1)
        for first in range(0, len(rows) - 1, max(size, 1)):
            runs.append(int(road.state_step[vehicle]) + rows[first : first + size + 1])
    return runs


def _results(
    world: RecordedWorld,
    recording: Int64[np.ndarray, " moment"],
    vehicle: Int64[np.ndarray, " moment"],
    steps: Int64[np.ndarray, " moment"],
) -> Buffers:
    """Return observation, and the rewards of the decision that follows, at recorded moments."""
    from socialiq.worlds.highway.core.compile import run_in_parts
    from socialiq_recordings.world import core

    results = Buffers.of(world.options, PLACE, 0, len(steps))
    egos = vehicle - world.road.recording_first[recording]
    moments = (recording.astype(np.int64), egos.astype(np.int64), steps.astype(np.int64))
    state = world.road, records_of(world, 1), results
    run_in_parts(core.replay, 1, len(steps), *state, *moments, settings_of(world.options))
    return results
