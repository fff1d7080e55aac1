"""Real highway-env as an engine: the same arrays, filled from Python objects.

States, observations, and whether an episode has ended are read from highway-env. Rewards and the
kind of an ending are computed from its snapshots by the code that the core uses.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from socialiq.types import Ending
from socialiq.worlds.highway.core.compile import for_python
from socialiq.worlds.highway.gym import TERMINAL
from socialiq.worlds.highway.state import ANNOTATE, DECIDE, DECIDE_AND_RESET, RESET, SKIP, Buffers
from socialiq.worlds.intersection.core import step, traffic
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.reference.highway import HighwayIntersection
from socialiq.worlds.intersection.settings import settings_of

route_coordinate = for_python(traffic.route_coordinate)


class Reference:
    """One highway-env for each row of the buffers.

    Args:
        options: Scenario and reward options.
        buffers: Arrays to fill.

    Raises:
        UserError: If highway-env is not installed.
    """

    def __init__(self, options: Options, buffers: Buffers) -> None:
        self._buffers, self._settings = buffers, settings_of(options)
        self._rows = [HighwayIntersection(options) for _ in buffers.episodes]

    def run(self, commands: Any, seeds: Any, seeded: Any, actions: Any) -> None:
        """Carry out one command for each episode."""
        buffers = self._buffers
        decided = np.isin(commands, (DECIDE, DECIDE_AND_RESET))
        observation = np.zeros_like(buffers.reached)
        for row in np.flatnonzero(decided):
            observation[row] = self._rows[row].step(actions[row]).reshape(observation[row].shape)
            self._write_decision(int(row))
        annotated = np.where(decided, ANNOTATE, SKIP).astype(np.int8)
        unseeded, unused = np.zeros_like(decided), np.zeros(len(decided), np.int64)
        step.on_threads(1, buffers, annotated, seeds, unseeded, unused, self._settings)
        for row in np.flatnonzero(decided):
            self._take_ending(int(row))
        buffers.reached[decided] = observation[decided]
        buffers.observation[decided] = observation[decided]
        ended = (commands == DECIDE_AND_RESET) & (buffers.ending != int(Ending.NONE))
        for row in np.flatnonzero((commands == RESET) | ended):
            self._reset(int(row), int(seeds[row]) if seeded[row] else None)

    def _take_ending(self, row: int) -> None:
        """Correct an ending that is terminal here and not in highway-env, or the other way round.

        A comparison then finds the difference.
        """
        buffers, terminated = self._buffers, self._rows[row].terminated
        if terminated != (buffers.ending[row] in TERMINAL):
            buffers.ending[row] = int(Ending.OTHER if terminated else Ending.NONE)

    def _reset(self, row: int, seed: int | None) -> None:
        buffers, real = self._buffers, self._rows[row]
        buffers.observation[row] = real.reset(seed).reshape(buffers.observation[row].shape)
        self._write_now(row)
        buffers.episodes[row]["start"] = route_coordinate(buffers.vehicles[row][real.ego])

    def _write_decision(self, row: int) -> None:
        buffers, real = self._buffers, self._rows[row]
        buffers.before[row, : len(real.before)] = real.before
        buffers.after[row, : len(real.after)] = real.after
        buffers.present[row] = len(real.after), real.ego_after
        self._write_now(row)

    def _write_now(self, row: int) -> None:
        buffers, real = self._buffers, self._rows[row]
        vehicles, episode = real.vehicles, buffers.episodes[row]
        buffers.vehicles[row, : len(vehicles)] = vehicles
        episode["vehicles"], episode["ego"] = len(vehicles), real.ego
        episode["time"] = real.time
        episode["contact"], episode["touched"] = real.contact, real.touched
