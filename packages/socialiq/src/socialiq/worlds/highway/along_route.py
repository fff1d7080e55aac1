"""Observations of the schema `route`: from rows, what agents know of themselves, and the map."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float32, Integer

from socialiq.worlds.highway.ego import EgoModel
from socialiq.worlds.highway.network import LANE
from socialiq.worlds.highway.observation import (
    CLASS_SIZES,
    EGO_TABLE,
    MODEL,
    N_FEATURES,
    TASK,
    USER_TABLE,
    Line,
)
from socialiq.worlds.highway.options import FEATURES
from socialiq.worlds.highway.scenes import Road


class AlongRoute:
    """Schema `route` of a world: what agents observe, from their rows and what they know."""

    def __init__(self, model: EgoModel, fastest: float, road: Road | None = None) -> None:
        """Make the schema of a world.

        Args:
            model: Scales of the rows, which are absolute, and speed control of the ego.
            fastest: Fastest target speed, m/s.
            road: Map around the routes; None: others are predicted straight on.
        """
        self._map = np.zeros(0, LANE), np.full((0, 1), -1)
        if road is not None:
            self._map = road.lanes, road.successors
        self._lines = list[Line]()
        self._numbers = np.zeros(0, np.int64)  # of a route, by key; -1: none yet
        self._routes: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        slowest = 0.0 if model.accelerates else model.speeds[0]
        count = len(model.speeds)
        control = model.accelerates, slowest, fastest, (fastest - slowest) / (count - 1), count
        highest = max(model.changes)
        lowest = -highest if len(model.changes) == 1 else min(model.changes)
        self._model = np.array([(*model.units, *control, lowest, highest)], MODEL)

    def numbers(
        self, keys: Integer[np.ndarray, " agent"], line: Callable[[int], Line]
    ) -> Integer[np.ndarray, " agent"]:
        """Return the number of the route of each agent; routes of new keys are made.

        Args:
            keys: Whole number of at least 0 that the route of each agent depends on.
            line: Makes the route of an agent.
        """
        if len(self._numbers) <= keys.max():
            more = np.full(int(keys.max()) + 1 - len(self._numbers), -1)
            self._numbers = np.append(self._numbers, more)
        for at in np.flatnonzero(self._numbers[keys] < 0).tolist():
            if self._numbers[keys[at]] < 0:
                self._numbers[keys[at]] = len(self._lines)
                self._lines.append(line(at))
                self._routes = None
        return self._numbers[keys]

    def __call__(
        self, rows: Float32[np.ndarray, "agent value"], agents: np.ndarray
    ) -> Float32[np.ndarray, "agent feature"]:
        """Return observations; zeros of agents that have left.

        Args:
            rows: Rows that each agent is shown, one after another.
            agents: AGENT record of each agent.
        """
        from socialiq.worlds.highway.core import along_route  # imports Numba
        from socialiq.worlds.highway.core.compile import run_in_parts  # imports Numba

        out = np.zeros((len(rows), N_FEATURES), np.float32)
        if self._routes is None:
            self._routes = self._stacked()
        shown = np.ascontiguousarray(rows.reshape(len(rows), -1, len(FEATURES)))
        tables = self._routes, *self._map, CLASS_SIZES, self._model, (EGO_TABLE, USER_TABLE)
        run_in_parts(along_route.run, 1, len(rows), shown, agents, *tables, out)
        return out

    def _stacked(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return points of all routes, (route, point, 4), their lengths, and TASK records."""
        lengths = np.array([len(line.points) for line in self._lines])
        points = np.zeros((len(lengths), lengths.max(), 4))
        for row, line in zip(points, self._lines, strict=True):
            row[: len(line.points)] = line.points
        return points, lengths, np.array([line.task for line in self._lines], TASK)
