"""Perception front end: the estimate of the scene between sensors and any policy.

It follows vehicles from one decision to the next at constant velocity, carries on those that are
not seen, weighs what is measured against what was predicted (a Kalman filter of one variance for
positions and one for velocities), and predicts all to the time at which an action takes effect.
The arithmetic is written once, over `Arrays`; `policies.front_end` writes it as an ONNX graph.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float32

from socialiq.errors import UserError, one_of
from socialiq.settings import assignments, changed
from socialiq.worlds.highway.core.vehicle import SPEED_GAIN
from socialiq.worlds.highway.options import FEATURES
from socialiq.worlds.intersection.options import IDLE, POSITION_RANGE, SPEED_RANGE, Options
from socialiq.worlds.intersection.shifts import Exit, Shift

ROW = len(FEATURES)
TRACK = ROW + 3  # with the variances of position and velocity, and the decisions unseen
PER_SECOND = SPEED_RANGE / POSITION_RANGE
GATE = 4.0 / POSITION_RANGE  # distance from a prediction within which a vehicle is the same
DEVIATIONS = 3.0  # by which the gate grows with the uncertainty
GROWTH = (1.0 / POSITION_RANGE) ** 2  # variance of a position that a decision adds
SPEED_GROWTH = (2.0 / SPEED_RANGE) ** 2
FAR = 100.0  # squared distance to a row that is empty
TINY = 1e-12
KNOWN, TRACKED = "known", 3
_USUAL = Options()
SPEEDS = _USUAL.target_speeds  # m/s
DECISIONS = _USUAL.decisions
EXITS = ("left", "straight", "right")
SUB_STEP = 1.0 / _USUAL.simulation_frequency


class Arrays:
    """Operations on arrays with an axis for the batch first, in NumPy."""

    def part(self, array: Any, first: int, last: int) -> Any:
        """Return columns of the last axis."""
        return array[..., first:last]

    def joined(self, arrays: Sequence[Any], axis: int = -1) -> Any:
        """Return arrays end to end."""
        return np.concatenate(arrays, axis=axis)

    def shaped(self, array: Any, *shape: int) -> Any:
        """Return an array with another shape behind the axis for the batch."""
        return array.reshape(-1, *shape)

    def least(self, array: Any, axis: int) -> Any:
        """Return the minimum along an axis, which stays."""
        return array.min(axis=axis, keepdims=True)

    def total(self, array: Any, axis: int) -> Any:
        """Return the sum along an axis, which stays."""
        return array.sum(axis=axis, keepdims=True)

    def product(self, left: Any, right: Any) -> Any:
        """Return the product of matrices, the first of them transposed."""
        return left.swapaxes(1, 2) @ right

    def at_most(self, left: Any, right: Any) -> Any:
        """Return 1 where an array is at most another one, else 0."""
        return (left <= right).astype(np.float32)

    def limited(self, array: Any, low: float, high: float) -> Any:
        """Return an array within limits."""
        return array.clip(np.float32(low), np.float32(high))

    def rounded(self, array: Any) -> Any:
        """Return the nearest whole numbers, halves to the even one."""
        return np.round(array)

    def root(self, array: Any) -> Any:
        """Return the square root."""
        return np.sqrt(array)

    def first(self, rows: Any, keys: Any, count: int) -> Any:
        """Return the rows of a batch with the smallest keys, in the order of these."""
        order = np.argsort(keys, axis=1, kind="stable")[:, :count]
        return np.take_along_axis(rows, order[..., None], axis=1)


NUMPY = Arrays()


@dataclass(frozen=True)
class FrontEnd:
    """Front end of a policy, by what is known of its sensors; by default it changes nothing.

    Raises:
        UserError: If a value is out of its range.
    """

    latency: int = 0  # decisions until an action takes effect
    track: int = 0  # decisions for which a vehicle that is not seen is carried on
    noise: float = 0.0  # m, standard deviation of errors of position; in m/s half as much
    rate: int = 1  # decisions per second
    # the exit that the ego takes, for policies that were trained for all: the time, at most 19, is
    # then of 20 for left, 20 for straight and 20 for right. "": the time alone; "own": the world's
    exit: Exit = ""

    def __post_init__(self) -> None:
        for name, least, most in (("latency", 0, 8), ("track", 0, 20), ("noise", 0, 100)):
            if not least <= getattr(self, name) <= most:
                raise UserError(f"front end: {name} must be from {least} to {most}")
        if not 1 <= self.rate <= 10:
            raise UserError("front end: rate must be from 1 to 10")

    @staticmethod
    def of(text: str, shifts: Sequence[Shift] = (), options: Options | None = None) -> FrontEnd:
        """Return the front end of FIELD=VALUE with commas, as `latency=1,track=3`, in a world.

        The word `KNOWN` stands for latency, noise and rate as they are there, and for `TRACKED`.

        Raises:
            UserError: If a field or a value is unknown, its own exit is not fixed, or a word is of
                a world and there is none.
        """
        words, front = text.split(","), FrontEnd()
        for word in words:
            if "=" not in word:
                one_of("front end", word, (KNOWN, "FIELD=VALUE"))
        if options is None and {KNOWN, "exit=own"} & {*words}:
            raise UserError("a front end without a world needs values, as latency=1,exit=left")
        if KNOWN in words and options:
            latency, noise = (
                max((getattr(shift, name) for shift in shifts), default=0)
                for name in ("latency", "noise")
            )
            front = FrontEnd(latency, TRACKED, noise, options.policy_frequency)
        front = changed(front, assignments([word for word in words if word != KNOWN]))
        if front.exit != "own" or options is None:
            return front
        one_of("destination", options.destination, EXITS)
        return replace(front, exit=options.destination)

    def memory(self, size: int, features: int) -> Float32[np.ndarray, "batch value"]:
        """Return the memory at the begin of so many episodes: zeros."""
        return np.zeros((size, (features // ROW - 1) * TRACK + 1 + self.latency), np.float32)

    def see(
        self,
        observation: Any,
        memory: Any,
        features: int,
        latency: Any = None,
        noise: Any = None,
        xp: Arrays = NUMPY,
    ) -> tuple[Any, Any]:
        """Return what a policy is shown of an observation, and the memory after it.

        Args:
            observation: Rows of vehicles, float32 (batch, features), maybe with the time behind.
            memory: Of the decision before.
            features: Length of an observation without the time.
            latency: Whether each episode has the latency (batch, 1), 0 or 1; by default all.
            noise: Of each episode in m (batch, 1); by default as declared.
            xp: Arithmetic.
        """
        count = features // ROW - 1
        rows = xp.shaped(xp.part(observation, 0, features), count + 1, ROW)
        columns = xp.shaped(xp.part(observation, 0, features), 1, features)
        ego = xp.part(columns, 0, ROW)
        others = xp.shaped(xp.part(columns, ROW, features), count, ROW)
        tracks = xp.part(memory, 0, count * TRACK)
        if self.track or self.noise:
            error = np.float32(self.noise) if noise is None else noise[..., None]
            followed = self._followed(others, xp.shaped(tracks, count, TRACK), count, error, xp)
            others, tracks = xp.part(followed, 0, ROW), xp.shaped(followed, count * TRACK)
            rows = xp.joined([ego, others], 1)
        waiting = xp.part(memory, count * TRACK, count * TRACK + 1 + self.latency)
        if self.latency:
            on = np.float32(1.0) if latency is None else latency[..., None]
            rows, target = self._predicted(ego, others, waiting, on, xp)
            queue = xp.part(waiting, 1, 1 + self.latency)
            waiting = xp.joined([target, queue])
        time = self.clock(xp.part(observation, features, features + 1), latency, xp)
        return xp.joined([xp.shaped(rows, features), time]), xp.joined([tracks, waiting])

    def clock(self, time: Any, latency: Any = None, xp: Arrays = NUMPY) -> Any:
        """Return the time that policies are shown, in decisions."""
        if self.latency:
            time = time + np.float32(self.latency) * (1 if latency is None else latency)
        if not self.exit:
            return time
        block = np.float32(DECISIONS * EXITS.index(self.exit))
        return xp.limited(time, 0.0, DECISIONS - 1.0) + block

    def decided(self, memory: Any, action: Any, features: int, xp: Arrays = NUMPY) -> Any:
        """Return the memory after an action (batch, 1), float32, was decided."""
        if not self.latency:
            return memory
        last = (features // ROW - 1) * TRACK + 1
        parts = [(0, last), (last + 1, last + self.latency)]
        kept = [xp.part(memory, *ends) for ends in parts if ends[1] > ends[0]]
        return xp.joined([*kept, action - np.float32(IDLE)])

    def _followed(self, sensed: Any, tracks: Any, count: int, noise: Any, xp: Arrays) -> Any:
        """Return the tracks of vehicles that are sensed, then of those that are carried on."""
        moved, unit = self._moved(tracks, xp), np.float32(1.0)
        there, visible = (xp.limited(xp.part(rows, 0, 1), 0.0, 1.0) for rows in (moved, sensed))
        same = self._same(moved, sensed, there, visible, count, xp)
        prior, known = xp.product(same, moved), xp.shaped(xp.total(same, 1), count, 1)
        columns, variances = [xp.part(sensed, 0, 1)], []
        for first, scale, place in ((1, POSITION_RANGE, ROW), (3, 2 * SPEED_RANGE, ROW + 1)):
            error = noise * np.float32(1.0 / scale)
            error = error * error
            before = xp.part(prior, place, place + 1)
            weight = known * error / (before + error + np.float32(TINY))
            measured = xp.part(sensed, first, first + 2)
            columns.append(measured + weight * (xp.part(prior, first, first + 2) - measured))
            variances.append(visible * (weight * before + (unit - known) * error))
        rows = xp.joined([*columns, xp.part(sensed, 5, ROW), *variances, visible * np.float32(0.0)])
        place = xp.part(moved, 1, 3)
        carried = there * (unit - xp.total(same, 2))
        carried = carried * xp.at_most(xp.total(place * place, -1), np.float32(1.0))
        carried = carried * xp.at_most(xp.part(moved, TRACK - 1, TRACK), np.float32(self.track))
        every = xp.joined([rows, moved * carried], 1)
        present = xp.shaped(xp.joined([visible, carried], 1), 2 * count)
        order = np.arange(2 * count, dtype=np.float32)[None]
        return xp.first(every, order + np.float32(2 * count) * (unit - present), count)

    def _same(
        self, moved: Any, sensed: Any, there: Any, visible: Any, count: int, xp: Arrays
    ) -> Any:
        """Return 1 for each track and vehicle that are nearest to each other, within the gate."""
        cost: Any = np.float32(FAR) * (np.float32(2.0) - there - xp.shaped(visible, 1, count))
        for number, unit in ((1, 1.0), (2, 1.0), (3, PER_SECOND), (4, PER_SECOND)):
            before, now = (xp.part(rows, number, number + 1) for rows in (moved, sensed))
            away = (xp.shaped(before, count, 1) - xp.shaped(now, 1, count)) * np.float32(unit)
            cost = cost + away * away
        reach = np.float32(GATE) + np.float32(DEVIATIONS) * xp.root(xp.part(moved, ROW, ROW + 1))
        same = xp.at_most(cost, reach * reach) * xp.at_most(cost, xp.least(cost, 1))
        return same * xp.at_most(cost, xp.least(cost, 2))

    def _moved(self, tracks: Any, xp: Arrays) -> Any:
        """Return tracks after a decision at constant velocity."""
        velocity, seconds = xp.part(tracks, 3, 5), np.float32(PER_SECOND / self.rate)
        there = xp.limited(xp.part(tracks, 0, 1), 0.0, 1.0)
        place, speed = xp.part(tracks, ROW, ROW + 1), xp.part(tracks, ROW + 1, ROW + 2)
        place = place + speed * seconds * seconds + there * np.float32(GROWTH)
        return xp.joined(
            [
                xp.part(tracks, 0, 1),
                xp.part(tracks, 1, 3) + velocity * seconds,
                xp.part(tracks, 3, ROW),
                place,
                speed + there * np.float32(SPEED_GROWTH),
                xp.part(tracks, TRACK - 1, TRACK) + there,
            ]
        )

    def _predicted(self, ego: Any, vehicles: Any, waiting: Any, on: Any, xp: Arrays) -> Any:
        """Return all rows at the time of an action's effect, and the ego's next target speed.

        Others keep their velocity. The ego keeps its heading, and its speed follows the actions
        that were decided, as highway-env's speed control does.
        """
        seconds, unit = 1.0 / self.rate, np.float32(1.0)
        left = (1.0 - SUB_STEP * SPEED_GAIN) ** round(seconds / SUB_STEP)
        along, step = xp.part(ego, 5, ROW), np.float32(SPEEDS[1] - SPEEDS[0])
        speed = xp.total(xp.part(ego, 3, 5) * along, -1) * np.float32(SPEED_RANGE)
        waiting, after = xp.shaped(waiting, 1, 1 + self.latency), None
        driven: Any = np.float32(0.0)
        target, now = xp.part(waiting, 0, 1) + np.float32(SPEEDS[-1]), speed
        for number in range(self.latency):
            action = xp.part(waiting, 1 + number, 2 + number)
            level = xp.limited(xp.rounded(now / step) + action, 0.0, len(SPEEDS) - 1.0)
            moving = action * action
            target = moving * level * step + (unit - moving) * target
            change = (now - target) * np.float32((1.0 - left) / SPEED_GAIN)
            driven = driven + target * np.float32(seconds) + change
            now = target + (now - target) * np.float32(left)
            after = target if after is None else after
        assert after is not None
        place = xp.part(ego, 1, 3) + on * driven * along * np.float32(1.0 / POSITION_RANGE)
        velocity = on * now * along * np.float32(1.0 / SPEED_RANGE)
        velocity = velocity + (unit - on) * xp.part(ego, 3, 5)
        ego = xp.joined([xp.part(ego, 0, 1), place, velocity, along])
        ahead = on * np.float32(PER_SECOND * seconds * self.latency)
        place = xp.part(vehicles, 1, 3) + xp.part(vehicles, 3, 5) * ahead
        vehicles = xp.joined([xp.part(vehicles, 0, 1), place, xp.part(vehicles, 3, ROW)])
        memory = xp.shaped(after - np.float32(SPEEDS[-1]), 1)
        return xp.joined([ego, vehicles], 1), memory
