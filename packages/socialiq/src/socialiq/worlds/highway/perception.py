"""Perception front end: the estimate of the scene between sensors and any policy.

It follows vehicles from one decision to the next at constant velocity, carries on those that are
not seen, weighs what is measured against what was predicted (a Kalman filter of one variance for
positions and one for velocities), and predicts all to the time at which an action takes effect.
The arithmetic is written once, over `Arrays`; `policies.front_end` writes it as an ONNX graph.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from socialiq.errors import UserError, one_of
from socialiq.settings import assignments, changed
from socialiq.worlds.highway.core.vehicle import SPEED_GAIN
from socialiq.worlds.highway.ego import EgoModel
from socialiq.worlds.highway.options import FEATURES
from socialiq.worlds.highway.shifts import Exit, Shift

ROW = len(FEATURES)
TRACK = ROW + 3  # with the variances of position and velocity, and the decisions unseen
GATE = 4.0  # m from a prediction within which a vehicle is the same
DEVIATIONS = 3.0  # by which the gate grows with the uncertainty
GROWTH = 1.0  # m, deviation of a position that a decision adds
SPEED_GROWTH = 2.0  # m/s
FAR = 100.0  # squared distance to a row that is empty
TINY = 1e-12
KNOWN = "known"
TRACKED = 3
EXITS = ("left", "straight", "right")


class Arrays:
    """Operations on arrays with an axis for the batch first, in NumPy."""

    def part(self, array: Any, first: int, last: int) -> Any:
        """Return columns of the last axis.

        Args:
            array: Array to take them from.
            first: First column.
            last: Column behind the last one.
        """
        return array[..., first:last]

    def joined(self, arrays: Sequence[Any], axis: int = -1) -> Any:
        """Return arrays end to end.

        Args:
            arrays: Arrays that differ in length along one axis at most.
            axis: This axis.
        """
        return np.concatenate(arrays, axis=axis)

    def shaped(self, array: Any, *shape: int) -> Any:
        """Return an array with another shape behind the axis for the batch.

        Args:
            array: Array to reshape.
            *shape: Lengths of all further axes.
        """
        return array.reshape(-1, *shape)

    def least(self, array: Any, axis: int) -> Any:
        """Return the minimum along an axis.

        Args:
            array: Array to reduce.
            axis: Axis, which stays with length 1.
        """
        return array.min(axis=axis, keepdims=True)

    def total(self, array: Any, axis: int) -> Any:
        """Return the sum along an axis.

        Args:
            array: Array to reduce.
            axis: Axis, which stays with length 1.
        """
        return array.sum(axis=axis, keepdims=True)

    def product(self, left: Any, right: Any) -> Any:
        """Return the product of matrices, one for each episode of the batch.

        Args:
            left: Matrices that are transposed first, (batch, k, m).
            right: Matrices (batch, k, n).

        Returns:
            Products (batch, m, n).
        """
        return left.swapaxes(1, 2) @ right

    def at_most(self, left: Any, right: Any) -> Any:
        """Return 1 where a number is at most another one, else 0, as float32.

        Args:
            left: Numbers to compare.
            right: Their upper limits.
        """
        return (left <= right).astype(np.float32)

    def limited(self, array: Any, low: float, high: float) -> Any:
        """Return an array within limits.

        Args:
            array: Array to clip.
            low: Least value.
            high: Largest value.
        """
        return array.clip(np.float32(low), np.float32(high))

    def rounded(self, array: Any) -> Any:
        """Return the nearest whole numbers, halves to the even one."""
        return np.round(array)

    def root(self, array: Any) -> Any:
        """Return the square root."""
        return np.sqrt(array)

    def first(self, rows: Any, keys: Any, count: int) -> Any:
        """Return the rows of a batch with the smallest keys, in the order of these.

        Args:
            rows: Rows (batch, row, column).
            keys: Key of each row, (batch, row); of equal keys the first row is first.
            count: Number of rows to return for each episode.
        """
        order = np.argsort(keys, axis=1, kind="stable")[:, :count]
        return np.take_along_axis(rows, order[..., None], axis=1)


NUMPY = Arrays()


@dataclass(frozen=True)
class FrontEnd:
    """Front end of a policy, by what is known of its sensors; the default makes no change.

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
    ego: EgoModel = field(default=EgoModel(), repr=False)  # of the world

    def __post_init__(self) -> None:
        for name, least, most in (("latency", 0, 8), ("track", 0, 20), ("noise", 0, 100)):
            if not least <= getattr(self, name) <= most:
                raise UserError(f"front end: {name} must be from {least} to {most}")
        if not 1 <= self.rate <= 10:
            raise UserError("front end: rate must be from 1 to 10")

    @staticmethod
    def of(text: str, shifts: Sequence[Shift] = (), ego: EgoModel | None = None) -> FrontEnd:
        """Return the front end of FIELD=VALUE with commas, as `latency=1,track=3`.

        The word `KNOWN` stands for latency, noise and rate as they are in a world, and for
        `TRACKED`.

        Args:
            text: Words with commas.
            shifts: Of the world.
            ego: Of the world; None without one.

        Raises:
            UserError: If a field or a value is unknown, its own exit is not fixed, the world has
                one exit, or a word is of a world and there is none.
        """
        words = text.split(",")
        for word in words:
            if "=" not in word:
                one_of("front end", word, (KNOWN, "FIELD=VALUE"))
        if ego is None and {KNOWN, "exit=own"} & {*words}:
            raise UserError("a front end without a world needs values, as latency=1,exit=left")
        front = FrontEnd() if ego is None else FrontEnd(rate=ego.rate, ego=ego)
        if KNOWN in words:
            latency, noise = (
                max((getattr(shift, name) for shift in shifts), default=0)
                for name in ("latency", "noise")
            )
            front = replace(front, latency=latency, track=TRACKED, noise=noise)
        values = assignments([word for word in words if word != KNOWN])
        names = tuple(name.name for name in fields(FrontEnd) if name.repr)
        for name in values:
            one_of("front end", name, names)
        front = changed(front, values)
        if ego is None or not front.exit:
            return front
        if not ego.exit:
            raise UserError("a front end tells the exit where the ego has several: leave out exit")
        if front.exit != "own":
            return front
        one_of("destination", ego.exit, EXITS)
        return replace(front, exit=ego.exit)

    @property
    def _in_ego_frame(self) -> bool:
        """Whether rows relative to the ego have to be moved with it."""
        return self.ego.relative and bool(self.latency or self.track or self.noise)

    def memory(
        self, size: int, features: int, targets: Float[np.ndarray, " batch"] | None = None
    ) -> Float32[np.ndarray, "batch value"]:
        """Return the memory at the beginning of episodes.

        Args:
            size: Number of episodes.
            features: Length of an observation without the time.
            targets: Target speed of each ego, m/s; None for that of the world's first ego. An ego
                that accelerates has none.
        """
        first = (features // ROW - 1) * TRACK
        width = first + 1 + self.latency + 2 * self._in_ego_frame
        memory = np.zeros((size, width), np.float32)
        if targets is not None and self.latency:
            memory[:, first] = targets.astype(np.float32) - np.float32(self.ego.first)
        return memory

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
            memory: Memory after the decision before, (batch, values).
            features: Length of an observation without the time.
            latency: Whether each episode has the latency (batch, 1), 0 or 1; by default all.
            noise: Noise of each episode in m (batch, 1); by default as declared.
            xp: Operations on arrays, in NumPy or as nodes of a graph.
        """
        count = features // ROW - 1
        columns = xp.shaped(xp.part(observation, 0, features), 1, features)
        ego = xp.part(columns, 0, ROW)
        others = xp.shaped(xp.part(columns, ROW, features), count, ROW)
        tracks = xp.part(memory, 0, count * TRACK)
        last = count * TRACK + 1 + self.latency
        waiting = xp.part(memory, count * TRACK, last)
        seen = []
        driven: Any = None
        if self._in_ego_frame:
            velocity = xp.part(ego, 3, 5)
            others = self._turned(others, velocity, np.float32(1.0), xp)
            driven = self._driven(xp.shaped(xp.part(memory, last, last + 2), 1, 2), velocity)
            seen = [xp.shaped(velocity, 2)]
        if self.track or self.noise:
            error = np.float32(self.noise) if noise is None else noise[..., None]
            moved = self._moved(xp.shaped(tracks, count, TRACK), driven, xp)
            followed = self._followed(others, moved, count, error, xp)
            others = xp.part(followed, 0, ROW)
            tracks = xp.shaped(followed, count * TRACK)
        if self.latency:
            on = np.float32(1.0) if latency is None else latency[..., None]
            ego, others, target = self._predicted(ego, others, waiting, on, xp)
            queue = xp.part(waiting, 1, 1 + self.latency)
            waiting = xp.joined([target, queue])
        if self._in_ego_frame:
            others = self._turned(others, xp.part(ego, 3, 5), np.float32(-1.0), xp)
        rows = xp.joined([ego, others], 1)
        time = self.clock(xp.part(observation, features, features + 1), latency, xp)
        return xp.joined([xp.shaped(rows, features), time]), xp.joined([tracks, waiting, *seen])

    def _turned(self, rows: Any, velocity: Any, sign: Any, xp: Arrays) -> Any:
        """Return vehicles with the ego's velocity added to theirs, or by the sign taken off."""
        there = xp.limited(xp.part(rows, 0, 1), 0.0, 1.0) * sign
        changed = xp.part(rows, 3, 5) + there * velocity
        return xp.joined([xp.part(rows, 0, 3), changed, xp.part(rows, 5, ROW)])

    def _driven(self, before: Any, now: Any) -> Any:
        """Return the ego's way in a decision, in units of position, by its velocities.

        Under speed control they tell the target, and so the way.
        """
        seconds = 1.0 / self.rate
        share = seconds / (1.0 - self._left) - 1.0 / SPEED_GAIN
        way = before * np.float32(seconds) + (now - before) * np.float32(share)
        return way * self.ego.per_second.astype(np.float32)

    @property
    def _left(self) -> float:
        """Share of a difference from the target speed that is left after a decision."""
        sub_step = self.ego.sub_step
        return (1.0 - sub_step * SPEED_GAIN) ** round(1.0 / self.rate / sub_step)

    def clock(self, time: Any, latency: Any = None, xp: Arrays = NUMPY) -> Any:
        """Return the time that policies are shown, in decisions.

        Args:
            time: Decisions since the start, (batch, 1).
            latency: Whether each episode has the latency (batch, 1), 0 or 1; by default all.
            xp: Operations on arrays, in NumPy or as nodes of a graph.

        Returns:
            The time at which an action takes effect; with an exit it is at most 19, and 20 are
            added for each exit before it in the order left, straight, right.
        """
        if self.latency:
            time = time + np.float32(self.latency) * (1 if latency is None else latency)
        if not self.exit:
            return time
        decisions = self.ego.decisions
        block = np.float32(decisions * EXITS.index(self.exit))
        return xp.limited(time, 0.0, decisions - 1.0) + block

    def decided(self, memory: Any, action: Any, features: int, xp: Arrays = NUMPY) -> Any:
        """Return the memory after an action was decided.

        Args:
            memory: Memory that `see` returned, (batch, values).
            action: Number of the action, float32 (batch, 1), or values in [-1, 1], of which the
                first is the acceleration.
            features: Length of an observation without the time.
            xp: Operations on arrays, in NumPy or as nodes of a graph.

        Returns:
            The memory with the action at the end of those that wait; unchanged without latency.
        """
        if not self.latency:
            return memory
        first = (features // ROW - 1) * TRACK + 1
        last = first + self.latency
        change = self._change(action, xp)
        parts = [(0, first), (first + 1, last)]
        before = [xp.part(memory, *ends) for ends in parts if ends[1] > ends[0]]
        after = [xp.part(memory, last, last + 2)] if self._in_ego_frame else []
        return xp.joined([*before, change, *after])

    def _change(self, action: Any, xp: Arrays) -> Any:
        """Return an action as steps of the target speed, or as an acceleration in m/s²."""
        changes = self.ego.changes
        if not self.ego.n_actions:
            return xp.part(action, 0, 1) * np.float32(changes[0])
        change: Any = np.float32(changes[0])
        for number, (lower, upper) in enumerate(pairwise(changes), 1):
            if upper != lower:
                change = change + np.float32(upper - lower) * xp.at_most(np.float32(number), action)
        return change

    def _followed(self, sensed: Any, moved: Any, count: int, noise: Any, xp: Arrays) -> Any:
        """Return the tracks of vehicles that are sensed, then of those that are carried on."""
        unit = np.float32(1.0)
        there, visible = (xp.limited(xp.part(rows, 0, 1), 0.0, 1.0) for rows in (moved, sensed))
        same = self._same(moved, sensed, there, visible, count, xp)
        prior = xp.product(same, moved)
        known = xp.shaped(xp.total(same, 1), count, 1)
        columns = [xp.part(sensed, 0, 1)]
        x, _, vx, _ = self.ego.units
        variances = []
        for first, scale, place in ((1, x, ROW), (3, 2 * vx, ROW + 1)):
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
        for number, unit in enumerate(np.array(self.ego.units) / self.ego.units[0], 1):
            before, now = (xp.part(rows, number, number + 1) for rows in (moved, sensed))
            away = (xp.shaped(before, count, 1) - xp.shaped(now, 1, count)) * np.float32(unit)
            cost = cost + away * away
        reach = np.float32(GATE / self.ego.units[0]) + np.float32(DEVIATIONS) * xp.root(
            xp.part(moved, ROW, ROW + 1)
        )
        same = xp.at_most(cost, reach * reach) * xp.at_most(cost, xp.least(cost, 1))
        return same * xp.at_most(cost, xp.least(cost, 2))

    def _moved(self, tracks: Any, driven: Any, xp: Arrays) -> Any:
        """Return tracks after a decision at constant velocity, and the ego's way in their frame."""
        x, _, vx, _ = self.ego.units
        seconds = np.float32(vx / x / self.rate)
        there = xp.limited(xp.part(tracks, 0, 1), 0.0, 1.0)
        way = xp.part(tracks, 3, 5) * (self.ego.per_second / self.rate).astype(np.float32)
        way = way if driven is None else way - there * driven
        place = xp.part(tracks, ROW, ROW + 1)
        speed = xp.part(tracks, ROW + 1, ROW + 2)
        place = place + speed * seconds * seconds + there * np.float32((GROWTH / x) ** 2)
        return xp.joined(
            [
                xp.part(tracks, 0, 1),
                xp.part(tracks, 1, 3) + way,
                xp.part(tracks, 3, ROW),
                place,
                speed + there * np.float32((SPEED_GROWTH / vx) ** 2),
                xp.part(tracks, TRACK - 1, TRACK) + there,
            ]
        )

    def _predicted(
        self, ego: Any, vehicles: Any, waiting: Any, on: Any, xp: Arrays
    ) -> tuple[Any, Any, Any]:
        """Return ego and others at the time of an action's effect, and the next target speed.

        Others keep their velocity. The ego keeps its heading, and its speed follows the actions
        that were decided, as highway-env's speed control or its accelerations.
        """
        units = np.array(self.ego.units)
        along = xp.part(ego, 5, ROW)
        speed = xp.total(xp.part(ego, 3, 5) * (units[2:] / units[2]).astype(np.float32) * along, -1)
        control = self._accelerated if self.ego.accelerates else self._controlled
        driven, now, after = control(speed * np.float32(units[2]), waiting, xp)
        way = on * driven * along * (1.0 / units[:2]).astype(np.float32)
        velocity = on * now * along * (1.0 / units[2:]).astype(np.float32)
        velocity = velocity + (np.float32(1.0) - on) * xp.part(ego, 3, 5)
        place = xp.limited(xp.part(ego, 1, 3) + way, -1.0, 1.0)
        velocity = xp.limited(velocity, -1.0, 1.0)
        ego = xp.joined([xp.part(ego, 0, 1), place, velocity, along])
        ahead = on * (self.ego.per_second * (1.0 / self.rate) * self.latency).astype(np.float32)
        place = xp.part(vehicles, 1, 3) + xp.part(vehicles, 3, 5) * ahead
        if self.ego.relative:
            place = place - xp.limited(xp.part(vehicles, 0, 1), 0.0, 1.0) * way
        vehicles = xp.joined([xp.part(vehicles, 0, 1), place, xp.part(vehicles, 3, ROW)])
        return ego, vehicles, xp.shaped(after - np.float32(self.ego.first), 1)

    def _accelerated(self, speed: Any, waiting: Any, xp: Arrays) -> tuple[Any, Any, Any]:
        """Return the ego's way in m and its speed in m/s under accelerations; and no target.

        Both are exact below the largest speed of a vehicle. Above it the simulator brakes gradually
        instead of limiting the speed at once.
        """
        seconds = 1.0 / self.rate
        share = 0.5 * (seconds - (0.0 if self.ego.ballistic else self.ego.sub_step))
        slowest, *_, fastest = self.ego.speeds
        waiting = xp.shaped(waiting, 1, 1 + self.latency)
        driven: Any = np.float32(0.0)
        for number in range(self.latency):
            change = xp.part(waiting, 1 + number, 2 + number) * np.float32(seconds)
            reached = xp.limited(speed + change, slowest, fastest)
            way = speed * np.float32(seconds) + (reached - speed) * np.float32(share)
            if self.ego.ballistic:
                stands = xp.at_most(speed + change, np.float32(0.0))
                moving = speed / xp.limited(np.float32(-1.0) * change, TINY, np.inf)  # of the time
                way = way * (np.float32(1.0) - stands * (np.float32(1.0) - moving))
            driven = driven + way
            speed = reached
        return driven, speed, xp.part(waiting, 0, 1) + np.float32(self.ego.first)

    def _controlled(self, speed: Any, waiting: Any, xp: Arrays) -> tuple[Any, Any, Any]:
        """Return the ego's way in m, its speed, and the target after the next decision, in m/s."""
        seconds = 1.0 / self.rate
        unit = np.float32(1.0)
        left = self._left
        speeds = self.ego.speeds
        lowest = np.float32(speeds[0])
        step = np.float32(speeds[1] - speeds[0])
        waiting = xp.shaped(waiting, 1, 1 + self.latency)
        after: Any = None
        driven: Any = np.float32(0.0)
        target = xp.part(waiting, 0, 1) + np.float32(self.ego.first)
        now = speed
        for number in range(self.latency):
            change = xp.part(waiting, 1 + number, 2 + number)
            level = xp.limited(xp.rounded((now - lowest) / step), 0.0, len(speeds) - 1.0)
            level = xp.limited(level + change, 0.0, len(speeds) - 1.0)
            moving = change * change
            target = moving * (level * step + lowest) + (unit - moving) * target
            lag = (now - target) * np.float32((1.0 - left) / SPEED_GAIN)
            driven = driven + target * np.float32(seconds) + lag
            now = target + (now - target) * np.float32(left)
            after = target if after is None else after
        return driven, now, after
