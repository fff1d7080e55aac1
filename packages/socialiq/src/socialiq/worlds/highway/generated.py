"""Generated roads: crossings and roundabouts of three to five arms, drawn from a seed.

Arms are numbered clockwise as drawn, from the ego's, which leads to the south. Traffic keeps to the
right; `scenes.mirrored` turns a road into one on which it keeps to the left.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from socialiq.worlds.highway.crossings import PAVEMENT, crosswalk, way
from socialiq.worlds.highway.network import (
    APPROACH,
    CONFLICT,
    EXIT,
    LANE_WIDTH,
    Lane,
    Network,
    Point,
    Shape,
    arc,
    straight,
)
from socialiq.worlds.highway.scenes import Road, road_of
from socialiq.worlds.road_users import RIDES

Form = Literal["crossing", "roundabout"]
Priority = Literal["main", "stop", "none"]

FORMS: tuple[Form, ...] = ("crossing", "roundabout")
PRIORITIES: tuple[Priority, ...] = ("main", "stop", "none")
ARMS = 3, 5  # fewest and most
LANES = 1, 2
MOST_SKEW = 30.0  # degrees, either way
_DRAWN_SKEW = 20  # degrees, either way

ACCESS = 100.0  # m, length of an approach up to its stop line, and of an exit
TURN = 9.0  # m, least radius of a right turn on the right lane
SMALLEST_CIRCLE = 16.0  # m, radius of the inner lane of a circle
_BETWEEN = math.radians(10.0)  # least part of a circle between an entry and the exit before it
CROSSWALK = 4.0  # m from a stop line outwards to the middle of a crosswalk
_BICYCLES = 0.75  # m from the edge of the road to the middle of a bicycle lane
_RIDDEN = 19.0  # m of a bicycle lane before the stop line
_ROLLS = 8.0  # m before an all-way stop from which drivers roll


class Layout(NamedTuple):
    """Properties of a generated road."""

    form: Form = "crossing"
    arms: int = 4
    lanes: int = 1  # of each arm, in each direction
    priority: Priority = "main"
    skew: float = 0.0  # degrees by which the side arms are turned
    enters: int = 0  # arm by which the ego enters, from the first side arm on

    @staticmethod
    def of_seed(seed: int) -> Layout:
        """Return the layout that a seed draws."""
        draws = np.random.default_rng(seed).random(6)
        arms = ARMS[0] + int(draws[1] * (ARMS[1] - ARMS[0] + 1))
        return Layout(
            form=FORMS[int(draws[0] * len(FORMS))],
            arms=arms,
            lanes=LANES[0] + int(draws[2] * len(LANES)),
            priority=PRIORITIES[int(draws[3] * len(PRIORITIES))],
            skew=float(int(draws[4] * (2 * _DRAWN_SKEW + 1)) - _DRAWN_SKEW),
            enters=int(draws[5] * arms),
        )

    @property
    def main(self) -> tuple[int, int]:
        """Arms of the main road, from the first side arm on."""
        return (1, 2) if self.arms == 3 else (1, 3)

    @property
    def is_main(self) -> list[bool]:
        """Whether each arm is one of the main road, from the ego's arm on."""
        return [(self.enters + arm) % self.arms in self.main for arm in range(self.arms)]

    @property
    def directions(self) -> list[float]:
        """Directions of the arms from the centre, rad, clockwise as drawn from east.

        The first is that of the ego, south, 90 degrees; each further one is larger.
        """
        is_t = self.form == "crossing" and self.arms == 3
        degrees = [0.0, 90.0, 270.0] if is_t else [360.0 / self.arms * a for a in range(self.arms)]
        turned = [
            angle + (0.0 if arm in self.main else self.skew) for arm, angle in enumerate(degrees)
        ]
        from_ego = [turned[(self.enters + arm) % self.arms] for arm in range(self.arms)]
        return [math.radians(90.0 + (angle - from_ego[0]) % 360.0) for angle in from_ego]

    def lane_to(self, exit: int) -> int:
        """Return the lane, from the left, that leads to an exit.

        The left lane of two leads to the first exit clockwise at a crossing, and to all but the
        next one along the circle at a roundabout, so ways from one arm don't cross.

        Args:
            exit: Number of the exit, clockwise from the arm of entry: 1 is the leftmost.
        """
        last_left = 1 if self.form == "crossing" else self.arms - 2
        return int(self.lanes > 1 and exit > last_left)


def offset_of(lane: int) -> float:
    """Return the distance of a lane's centre from the middle of its arm, m."""
    return LANE_WIDTH * (lane + 0.5)


def _turned(angle: float, along: float, right: float) -> Point:
    """Return a point so far along a direction and to the right of it, m."""
    cos = math.cos(angle)
    sin = math.sin(angle)
    return along * cos - right * sin, along * sin + right * cos


def _bend(start: Point, heading: float, end: Point, turn: float) -> Shape:
    """Return the lane that leaves a point with a heading and turns by an angle up to another one.

    Args:
        start: Point (x, y) at which it begins, m.
        heading: Heading there, rad.
        end: Point at which it ends, m. The ways straight on from both meet at equal distances.
        turn: Change of heading, rad, positive to the right.
    """
    if abs(turn) < 1e-9:
        return straight(start, end)
    sense = 1 if turn > 0 else -1
    radius = math.dist(start, end) / (2.0 * math.sin(abs(turn) / 2.0))
    aside = _turned(heading, 0.0, sense * radius)
    centre = start[0] + aside[0], start[1] + aside[1]
    phase = heading - sense * math.pi / 2
    return arc(centre, radius, phase, phase + turn, sense)


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


def _least_between(directions: list[float]) -> float:
    """Return the least angle between neighbouring arms, rad."""
    following = [*directions[1:], directions[0] + 2.0 * math.pi]
    return min(after - before for before, after in zip(directions, following, strict=True))


class _Builder:
    """Network of a layout, filled arm by arm."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.directions = layout.directions
        self.roads = Network()
        self.between = _least_between(self.directions)
        self.walks = list[np.ndarray]()
        self.rides = list[np.ndarray]()

    def ranks(self, arm: int) -> int:
        """Return the priority of the vehicles of an arm."""
        return 3 if self.layout.priority == "main" and self.layout.is_main[arm] else 1

    def add_arm(self, arm: int, lane: int, stop: float, rank: int) -> None:
        """Add an approach and an exit.

        Args:
            arm: Number of the arm.
            lane: Number of the lane, from the left.
            stop: Distance of the stop line from the centre, m.
            rank: Priority of its vehicles.
        """
        angle = self.directions[arm]
        aside = offset_of(lane)
        far = stop + ACCESS
        slow_from = ACCESS - _ROLLS if self.layout.priority == "stop" else math.inf
        inwards = straight(_turned(angle, far, -aside), _turned(angle, stop, -aside))
        approach = Lane(inwards, APPROACH, False, rank, slow_from)
        self.roads.add(f"from{arm}.{lane}", f"in{arm}.{lane}", approach)
        outwards = straight(_turned(angle, stop, aside), _turned(angle, far, aside))
        self.roads.add(f"out{arm}.{lane}", f"arm{arm}", Lane(outwards, EXIT, False, rank))

    def add_crosswalk(self, arm: int, stop: float) -> None:
        """Add a crosswalk over an arm.

        Args:
            arm: Number of the arm.
            stop: Distance of its outermost stop line from the centre, m.
        """
        angle = self.directions[arm]
        middle = _turned(angle, stop + CROSSWALK, 0.0)
        half = self.layout.lanes * LANE_WIDTH + PAVEMENT
        self.walks += crosswalk(*middle, angle - math.pi / 2, half)

    def add_bicycle_lane(self, arm: int, stop: float) -> None:
        """Add a bicycle lane from an arm straight on, if an arm lies opposite.

        Args:
            arm: Number of the arm.
            stop: Distance of its stop line from the centre, m.
        """
        angle = self.directions[arm]
        if min(abs(_wrapped(angle + math.pi - exit)) for exit in self.directions) > 1e-9:
            return
        aside = self.layout.lanes * LANE_WIDTH + _BICYCLES
        middle = _turned(angle, 0.0, -aside)
        self.rides.append(way(RIDES, *middle, angle + math.pi, stop + _RIDDEN, stop))

    def road(self, sight: np.ndarray, actions: np.ndarray, speed_limit: float) -> Road:
        """Return the tables of the network; see `road_of_layout`."""
        layout = self.layout
        arms = range(layout.arms)
        lanes = [[layout.lane_to((exit - arm) % layout.arms) for exit in arms] for arm in arms]
        entries = [
            [self.roads.lane(f"from{arm}.{lane}", f"in{arm}.{lane}", 0) for lane in lanes[arm]]
            for arm in arms
        ]
        turns = [angle - self.directions[0] for angle in self.directions]
        return road_of(
            self.roads,
            sight,
            destinations=[f"arm{arm}" for arm in arms],
            arrivals=entries,
            frames=[(math.cos(turn), math.sin(turn)) for turn in turns],
            actions=actions,
            speed_limit=speed_limit,
            ways=[*self.walks, *self.rides],
        )


def stop_of_crossing(layout: Layout) -> float:
    """Return the distance of a crossing's stop lines from its centre, m.

    Right turns from the right lane to the right lane have a radius of at least `TURN`.
    """
    between = _least_between(layout.directions)
    return (offset_of(layout.lanes - 1) + TURN) / math.tan(between / 2.0)


def _crossing(layout: Layout) -> _Builder:
    """Return a crossing: a way across from each approach to each exit, an arc or straight."""
    builder = _Builder(layout)
    stop = stop_of_crossing(layout)
    for arm, angle in enumerate(builder.directions):
        rank = builder.ranks(arm)
        for lane in range(layout.lanes):
            builder.add_arm(arm, lane, stop, rank)
        builder.add_crosswalk(arm, stop)
        builder.add_bicycle_lane(arm, stop)
        for number in range(1, layout.arms):
            exit = (arm + number) % layout.arms
            lane = layout.lane_to(number)
            aside = offset_of(lane)
            heading = angle + math.pi
            turn = _wrapped(builder.directions[exit] - heading)
            start = _turned(angle, stop, -aside)
            end = _turned(builder.directions[exit], stop, aside)
            turns_left = turn < -math.pi / 4
            across = Lane(_bend(start, heading, end, turn), CONFLICT, False, rank - turns_left)
            builder.roads.add(f"in{arm}.{lane}", f"out{exit}.{lane}", across)
    return builder


class Circle(NamedTuple):
    """One lane of a circle, and the bends that lead to it and away from it."""

    radius: float  # m, of the lane
    stop: float  # m from the centre to the stop lines
    aside: float  # rad from the middle of an arm to where its bends touch the circle


def circle_of(layout: Layout, lane: int) -> Circle:
    """Return the circle on which a lane leads.

    A bend turns to the right with the radius `TURN` and touches the circle from outside. The circle
    is so large that an exit lies behind the entry before it.

    Args:
        layout: Layout of a roundabout.
        lane: Lane of the arms, from the left; the left lane leads to the inner circle.
    """
    widest = (_least_between(layout.directions) - _BETWEEN) / 2.0
    inner = SMALLEST_CIRCLE
    for number in range(layout.lanes):
        touching = (offset_of(number) + TURN) / math.sin(widest)
        inner = max(inner, touching - TURN - number * LANE_WIDTH)
    radius = inner + lane * LANE_WIDTH
    aside = math.asin((offset_of(lane) + TURN) / (radius + TURN))
    return Circle(radius, (radius + TURN) * math.cos(aside), aside)


def _roundabout(layout: Layout) -> _Builder:
    """Return a roundabout, driven anticlockwise as drawn.

    Of two lanes, the right one has a circle outside the other's on which it leads to the next exit
    alone, so it meets no vehicle of the left lanes.
    """
    builder = _Builder(layout)
    main = layout.priority == "main"
    for lane in range(layout.lanes):
        circle = circle_of(layout, lane)
        for arm, angle in enumerate(builder.directions):
            before = (arm - 1) % layout.arms  # the next arm along the circle
            builder.add_arm(arm, lane, circle.stop, 1)
            _add_bends(builder, arm, lane, circle)
            passed = _wrapped(angle - builder.directions[before]) % (2.0 * math.pi)
            first = angle - circle.aside
            last = angle - passed + circle.aside
            part = arc((0.0, 0.0), circle.radius, first, last, -1)
            around = Lane(part, CONFLICT, False, 3 if main else 1)
            builder.roads.add(f"on{arm}.{lane}", f"off{before}.{lane}", around)
            if lane == 0:
                part = arc((0.0, 0.0), circle.radius, angle + circle.aside, first, -1)
                around = Lane(part, CONFLICT, False, 3 if main else 1)
                builder.roads.add(f"off{arm}.{lane}", f"on{arm}.{lane}", around)
    outermost = max(circle_of(layout, lane).stop for lane in range(layout.lanes))
    for arm in range(layout.arms):
        builder.add_crosswalk(arm, outermost)
    return builder


def _add_bends(builder: _Builder, arm: int, lane: int, circle: Circle) -> None:
    """Add the bends from an approach to the circle and from the circle to the exit."""
    angle = builder.directions[arm]
    aside = offset_of(lane)
    main = builder.layout.priority == "main"
    turn = math.pi / 2 - circle.aside  # of both bends
    inwards = _turned(angle - circle.aside, circle.radius, 0.0)
    bend = _bend(_turned(angle, circle.stop, -aside), angle + math.pi, inwards, turn)
    builder.roads.add(f"in{arm}.{lane}", f"on{arm}.{lane}", Lane(bend, CONFLICT, False, 1))
    outwards = _turned(angle + circle.aside, circle.radius, 0.0)
    bend = _bend(outwards, angle - turn, _turned(angle, circle.stop, aside), turn)
    rank = 3 if main else 1
    builder.roads.add(f"off{arm}.{lane}", f"out{arm}.{lane}", Lane(bend, CONFLICT, False, rank))


_BUILDERS = {"crossing": _crossing, "roundabout": _roundabout}


def road_of_layout(
    layout: Layout, sight: np.ndarray, actions: np.ndarray, speed_limit: float
) -> Road:
    """Return the tables of a generated road.

    Args:
        layout: Its properties.
        sight: SIGHT record in an array of one.
        actions: Change of the target speed's and of the target lane's number by each action.
        speed_limit: Speed limit of every lane, m/s.
    """
    return _BUILDERS[layout.form](layout).road(sight, actions, speed_limit)
