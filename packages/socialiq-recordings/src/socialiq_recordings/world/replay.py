"""Recorded vehicles as demonstrations in the world's observations, actions and rewards."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair
from socialiq.worlds.intersection.settings import settings_of
from socialiq_recordings.episodes.decisions import levels_of
from socialiq_recordings.world.config import SUB_STEPS
from socialiq_recordings.world.recorded_world import RecordedWorld
from socialiq_recordings.world.state import Made, Traffic

MODES = ("human", "simulated")
"""Modes of recorded drivers, by whether the recording shows signs of a simulation."""


class Replayed(NamedTuple):
    """Recorded decisions in the form of a world.

    Attributes:
        table: Demonstrations; an episode ends with ARRIVAL, or with TIMEOUT at the end of the view.
        residual: Recorded speed at the next decision less that of the chosen level, m/s.
        change: Recorded change of speed of each decision, m/s.
    """

    table: Demonstrations
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


class _Run(NamedTuple):
    """Decisions of one vehicle: its recording, its number there, the sub-step of each."""

    recording: int
    ego: int
    steps: Int64[np.ndarray, " decision_and_one"]


def replay(world: RecordedWorld, every: float = 0.0) -> Replayed:
    """Return the decisions of every vehicle whose place an ego can take.

    Args:
        world: The world.
        every: s between the beginnings of a vehicle's episodes. The recorded moments between two
            decisions are then used too, by episodes that begin there; their decisions overlap and
            are not independent. 0: one episode for each vehicle.

    Raises:
        UserError: If no vehicle is seen for a whole decision.
    """
    runs = [
        run
        for vehicle in world.road.egos.tolist()
        for run in _runs(world, vehicle, round(every * SUB_STEPS))
    ]
    if not runs:
        raise UserError("no vehicle is seen for a whole decision: nothing is demonstrated")
    recordings, egos, steps, episode = (
        np.concatenate(column)
        for column in zip(
            *(
                (
                    np.full(len(one.steps), one.recording),
                    np.full(len(one.steps), one.ego),
                    one.steps,
                    np.full(len(one.steps), number),
                )
                for number, one in enumerate(runs)
            ),
            strict=True,
        )
    )
    made = _made(world, recordings, egos, steps)
    last = np.append(np.diff(episode) > 0, True)
    speed, kept = made.speed, ~last
    seconds = 1 / world.config.policy_rate
    action, residual = np.zeros(len(steps), np.int32), np.zeros(len(steps))
    for number in range(len(runs)):
        here = episode == number
        found = levels_of(speed[here], world.config.levels, seconds)
        action[np.flatnonzero(here)[:-1]] = found.action
        residual[np.flatnonzero(here)[:-1]] = found.residual
    change = np.diff(speed, append=0.0)[kept]
    ending = made.ending.copy()
    final = np.append(last[1:], False) & kept  # the last decision of its episode
    ending[final & (ending == int(Ending.NONE))] = int(Ending.TIMEOUT)
    observation = made.observation.reshape(len(steps), -1)
    rows = np.flatnonzero(kept)
    simulated = np.array([int(one["simulated"]) for one in world.provenance["recordings"]])
    table = Demonstrations.of(
        observation=observation[rows],
        action=action[rows],
        next_observation=observation[rows + 1],
        ending=ending[rows],
        rewards=RewardPair(made.pair[rows, 0], made.pair[rows, 1]),
        episode=episode[rows],
        mode=simulated[recordings[rows]],
        mode_names=MODES,
        n_actions=world.n_actions,
        source={"made_by": "socialiq data world", "world": world.provenance, "every": every},
    )
    return Replayed(table, residual[rows], change)


def _runs(world: RecordedWorld, vehicle: int, every: int) -> list[_Run]:
    """Return the decisions of a vehicle, one run for each beginning."""
    road, frames = world.road, world.config.frames
    recording = int(np.searchsorted(road.recording_first, vehicle, side="right")) - 1
    begin, end = (int(road.state_first[vehicle + one]) for one in range(2))
    along, first = road.state[begin:end, 0], int(road.state_step[vehicle])
    found = []
    for start in range(0, frames, every) if every else (0,):
        places = np.arange(start, len(along), frames)
        arrived = np.flatnonzero(along[places] >= road.arrival[vehicle])
        if len(arrived):
            places = places[: arrived[0] + 1]
        if len(places) > 1:
            ego = vehicle - int(road.recording_first[recording])
            found.append(_Run(recording, ego, first + places))
    return found


def _made(
    world: RecordedWorld,
    recordings: Int64[np.ndarray, " moment"],
    egos: Int64[np.ndarray, " moment"],
    steps: Int64[np.ndarray, " moment"],
) -> Made:
    """Return observation, and the rewards of the decision that follows, at recorded moments."""
    from socialiq.worlds.highway.core.compile import run_in_parts
    from socialiq_recordings.world import core

    made = Made.of(world, len(steps))
    settings = settings_of(world.config.options(world.max_speed))
    moments = (recordings.astype(np.int64), egos.astype(np.int64), steps.astype(np.int64))
    traffic = Traffic.of(world, 1)
    run_in_parts(core.replay, 1, len(steps), world.road, traffic, made, *moments, settings)
    return made
