"""Observation along the ego's route: one vector for every road, computed from rows that are shown.

The kernels read the rows of road users that a sensor, a fault or a front end shows, the ego's own
route, speed control and clock, and the map. They don't read another driver's destination or
parameters. `highway.observation` names the columns that they write.
"""

import math
from typing import Any

import numpy as np

from socialiq.worlds.highway.core import geometry
from socialiq.worlds.highway.core.compile import (
    allocating_entry_point,
    fingerprint,
    inlined_kernel,
    kernel,
)
from socialiq.worlds.highway.core.vehicle import SPEED_GAIN, clip
from socialiq.worlds.highway.network import APPROACH, EXIT
from socialiq.worlds.highway.observation import AHEAD, MOTIONS, POINT, SECONDS

RANGE = 100.0  # m, beyond which no road user is observed
_MOTIONS = len(MOTIONS)
_COARSE = 4  # points of a route that a first search skips
_BEHIND = 40  # points behind and ahead of the ego among which others are placed
_BEFORE = 110
_CROSSES = 60  # points ahead among which a straight way may cross the route
_SIDE = 2.2  # m to the side of a line within which a road user follows it
_ALIGNED = 0.5  # cosine of the angle up to which a road user follows a line
_LEAST_SPEED = 0.3  # m/s, so that times are finite
_FAR = 1e4  # m
_PASSED = 3.0  # m behind a crossing from which the next one is observed
_ALONG = 12.0, 0.3  # m, and s of the fastest speed, along the route at which closeness is 0
_BESIDE = 2.5, 2.0  # m, and halves of the width, to the side of it at which closeness is 0


@kernel
def _nearest(points, x, y, first, last, stride):
    """Return the number of the nearest of some points of a route."""
    best = first
    least = math.inf
    for number in range(first, last + 1, stride):
        dx = points[number, 0] - x
        dy = points[number, 1] - y
        apart = dx * dx + dy * dy
        if apart < least:
            least = apart
            best = number
    return best


@kernel
def _projected(points, x, y, first, last):
    """Return the nearest point of a part of a route, the way along the route and the side, m."""
    coarse = _nearest(points, x, y, first, last, _COARSE)
    low = max(coarse - _COARSE, first)
    number = _nearest(points, x, y, low, min(coarse + _COARSE, last), 1)
    dx = x - points[number, 0]
    dy = y - points[number, 1]
    along = dx * points[number, 2] + dy * points[number, 3]
    beside = dy * points[number, 2] - dx * points[number, 3]
    return number, number * POINT + along, beside


@kernel
def _point(points, last, along):
    """Return a point of a route, which goes on straight at both ends, and its direction there."""
    number = min(max(int(along / POINT), 0), last)
    rest = along - number * POINT
    cos = points[number, 2]
    sin = points[number, 3]
    return points[number, 0] + rest * cos, points[number, 1] + rest * sin, cos, sin


@kernel
def _read(row, model, turn_cos, turn_sin, user):
    """Read a row of a road user in metres: x, y, cosine and sine of its heading, and speed.

    Args:
        row: The row, in the order of `FEATURES`, absolute.
        model: MODEL record with the scales.
        turn_cos: Cosine of the turn of the frame in which rows are shown.
        turn_sin: Sine of this turn.
        user: Numbers that are written, (5,).
    """
    user[0] = turn_cos * row[1] * model.x - turn_sin * row[2] * model.y
    user[1] = turn_sin * row[1] * model.x + turn_cos * row[2] * model.y
    cos = turn_cos * row[5] - turn_sin * row[6]
    sin = turn_sin * row[5] + turn_cos * row[6]
    norm = max(math.sqrt(cos * cos + sin * sin), 1e-6)
    user[2] = cos / norm
    user[3] = sin / norm
    east = turn_cos * row[3] * model.vx - turn_sin * row[4] * model.vy
    south = turn_sin * row[3] * model.vx + turn_cos * row[4] * model.vy
    user[4] = east * user[2] + south * user[3]


@kernel
def targets(speed, keep, model, reached):
    """Write the speeds that the ego aims at if it chooses slower, keep and faster, m/s.

    An ego that accelerates aims at the speed that it has after a second.

    Args:
        speed: Speed of the ego, m/s.
        keep: Its present target speed, m/s.
        model: MODEL record.
        reached: Speeds that are written, (3,).
    """
    if model.accelerates:
        reached[0] = clip(speed + model.brake, model.slowest, model.fastest)
        reached[1] = speed
        reached[2] = clip(speed + model.throttle, model.slowest, model.fastest)
        return
    number = np.rint((speed - model.slowest) / model.step)
    number = clip(number, 0.0, model.speeds - 1.0)
    reached[0] = model.slowest + model.step * max(number - 1.0, 0.0)
    reached[1] = keep
    reached[2] = model.slowest + model.step * min(number + 1.0, model.speeds - 1.0)


@inlined_kernel
def _write_ego(ego, agent, route, way, reached, model, count, out):
    """Write the quantities of the ego; see `observation.EGO`.

    Args:
        ego: Numbers of `_read`.
        agent: AGENT record.
        route: Nearest point of the route, the way along it and the side, m.
        way: Points of the route, its TASK record, and its last point.
        reached: Speeds of `targets`.
        model: MODEL record.
        count: Number of road users within `RANGE`.
        out: Quantities that are written.
    """
    number, along, beside = route
    points, task, last = way
    speed = ego[4]
    out[0] = speed
    out[1] = speed / model.fastest
    for motion in range(_MOTIONS):
        out[2 + motion] = reached[motion] - speed
    out[5] = model.fastest
    out[6] = agent.seconds_left
    arrival = task.arrival - along
    out[7] = agent.seconds_left - max(arrival, 0.0) / model.fastest
    out[8] = task.conflict - along
    out[9] = task.behind - along
    out[10] = arrival
    out[11] = out[8] - speed / SPEED_GAIN
    out[12] = beside
    out[13] = ego[3] * points[number, 2] - ego[2] * points[number, 3]
    out[14] = count
    out[15] = agent.left
    out[16] = agent.right
    written = 17
    for ahead in AHEAD:
        _, _, cos, sin = _point(points, last, along + ahead)
        out[written] = cos * ego[2] + sin * ego[3] - 1.0
        out[written + 1] = sin * ego[2] - cos * ego[3]
        written += 2
    strips = 0
    for strip in task.strips:
        if strips < 2 and -_PASSED < strip[1] - along < _FAR / 2:
            out[written] = 1.0
            out[written + 1] = strip[0] - along
            out[written + 2] = strip[1] - along
            written += 3
            strips += 1
    while strips < 2:
        out[written] = 0.0
        out[written + 1] = _FAR
        out[written + 2] = _FAR
        written += 3
        strips += 1


@kernel
def _lane_of(lanes, user):
    """Return the lane that a vehicle is on, or -1, and its coordinate along it, m."""
    if not len(lanes):
        return -1, 0.0
    heading = math.atan2(user[3], user[2])
    number = geometry.closest_lane(lanes, user[0], user[1], heading, 0, 0.0)
    lane = lanes[number]
    along = geometry.longitudinal(lane, user[0], user[1])
    turned = geometry.wrap_to_pi(heading - geometry.heading_at(lane, along))
    if abs(geometry.lateral(lane, user[0], user[1])) > _SIDE or math.cos(turned) < _ALIGNED:
        return -1, 0.0
    return number, along


@kernel
def _on_lane(lane, along):
    """Return the point of a lane at a coordinate; it goes on straight behind its end."""
    rest = max(along - lane.length, 0.0)
    x, y = geometry.position(lane, along - rest)
    if rest == 0.0:
        return x, y
    heading = geometry.heading_at(lane, lane.length)
    return x + rest * math.cos(heading), y + rest * math.sin(heading)


@kernel
def _close(x, y, reached, ego, way, along, second, model, half_width):
    """Return how close a point is to where each motion of the ego leads, and how far ahead of it.

    The closeness is a product of two hats, along the route and to its side.
    """
    points, last = way
    motion = reached - (reached - ego[4]) * math.exp(-second * SPEED_GAIN)
    driven = reached * second - (motion - ego[4]) / SPEED_GAIN
    place_x, place_y, cos, sin = _point(points, last, along + driven)
    dx = x - place_x
    dy = y - place_y
    ahead = dx * cos + dy * sin
    beside = dy * cos - dx * sin
    close = max(1.0 - abs(ahead) / (_ALONG[0] + _ALONG[1] * model.fastest), 0.0)
    return close * max(1.0 - abs(beside) / (_BESIDE[0] + _BESIDE[1] * half_width), 0.0), ahead


@inlined_kernel
def _write_closeness(user, half_width, ego, along, way, road, on_route, reached, model, out):
    """Write the closeness by motion and second, then the mean metres ahead by motion.

    A road user that follows the ego's route is predicted along it; one on another lane along this
    lane, and behind it along each lane that follows with equal weight; any other straight on.

    Args:
        user: Numbers of `_read`.
        half_width: Half its width, m.
        ego: Numbers of `_read` of the ego.
        along: The ego's coordinate on its route, m.
        way: Points of the route and the last one.
        road: LANE records, and the first lanes of the roads that follow each road.
        on_route: Coordinate on the ego's route and the side, m; whether it follows the route; its
            lane or -1, and the coordinate along that.
        reached: Speeds of `targets`.
        model: MODEL record.
        out: Quantities that are written, zeros before.
    """
    user_along, beside, follows, lane, on_lane = on_route
    points, last = way
    lanes, successors = road
    for number, second in enumerate(SECONDS):
        go = user[4] * second
        branches = 1
        beyond = 0.0
        if lane >= 0 and not follows:
            beyond = on_lane + go - lanes[lane].length
            branches = 0
            while beyond > 0.0 and branches < successors.shape[1]:
                if successors[lanes[lane].road, branches] < 0:
                    break
                branches += 1
        for branch in range(max(branches, 1)):
            if follows:
                x, y, cos, sin = _point(points, last, user_along + go)
                x -= beside * sin
                y += beside * cos
            elif lane < 0:
                x = user[0] + go * user[2]
                y = user[1] + go * user[3]
            elif branches == 0:
                x, y = _on_lane(lanes[lane], on_lane + go)
            else:
                first = successors[lanes[lane].road, branch]
                following = first + min(lanes[lane].number, lanes[first].lanes - 1)
                x, y = _on_lane(lanes[following], beyond)
            for motion in range(_MOTIONS):
                close, ahead = _close(
                    x, y, reached[motion], ego, way, along, second, model, half_width
                )
                close = close / max(branches, 1)
                out[motion * len(SECONDS) + number] += close
                out[_MOTIONS * len(SECONDS) + motion] += close * clip(ahead / 10.0, -1.0, 1.0)


@kernel
def _crossing(user, half_length, half_width, points, begin, last):
    """Return the first point of the route that a straight way leads to, or -1, and its metres."""
    for number in range(begin, min(begin + _CROSSES, last) + 1):
        dx = points[number, 0] - user[0]
        dy = points[number, 1] - user[1]
        ahead = dx * user[2] + dy * user[3]
        if ahead > -half_length and abs(dy * user[2] - dx * user[3]) < half_width + 1.5:
            return number, max(ahead, 0.0)
    return -1, 0.0


@inlined_kernel
def _write_user(user, kind, size, ego, route, way, task, road, reached, model, out):
    """Write the quantities of a road user; see `observation.USER`.

    Args:
        user: Numbers of `_read`.
        kind: 0 for a vehicle, 1 for a person on foot, 2 for one who rides.
        size: Half its length and half its width, m.
        ego: Numbers of `_read` of the ego.
        route: Nearest point of the route to the ego, and its way along it, m.
        way: Points of the route and the last one.
        task: TASK record of the route.
        road: LANE records, and the first lanes of the roads that follow each road.
        reached: Speeds of `targets`.
        model: MODEL record.
        out: Quantities that are written, zeros before.
    """
    begin, along = route
    points, last = way
    lanes, _ = road
    half_length, half_width = size
    out[0] = 1.0
    out[1 + kind] = 1.0
    dx = user[0] - ego[0]
    dy = user[1] - ego[1]
    out[4] = dx * ego[2] + dy * ego[3]
    out[5] = dy * ego[2] - dx * ego[3]
    out[8] = user[2] * ego[2] + user[3] * ego[3]
    out[9] = user[3] * ego[2] - user[2] * ego[3]
    out[6] = user[4] * out[8] - ego[4]
    out[7] = user[4] * out[9]
    out[10] = user[4]
    out[11] = half_length
    out[12] = half_width
    low = max(begin - _BEHIND, 0)
    number, user_along, beside = _projected(
        points, user[0], user[1], low, min(begin + _BEFORE, last)
    )
    cos = user[2] * points[number, 2] + user[3] * points[number, 3]
    out[13] = user_along - along
    out[14] = beside
    out[15] = cos
    out[16] = user[3] * points[number, 2] - user[2] * points[number, 3]
    at_end = abs(user_along - number * POINT) > 6.0
    follows = abs(beside) < _SIDE and cos > _ALIGNED and not at_end
    out[17] = follows
    lane = -1
    on_lane = 0.0
    if kind == 0:
        lane, on_lane = _lane_of(lanes, user)
    if lane >= 0:
        out[18] = np.sign(lanes[lane].priority - task.priority)
        out[19] = APPROACH < lanes[lane].kind < EXIT
        out[20] = lanes[lane].kind == EXIT
    if not follows:
        meets, away = _crossing(user, half_length, half_width, points, begin, last)
        if meets >= 0:
            to_there = max(meets * POINT - along, 0.0)
            seconds = away / max(user[4], _LEAST_SPEED)
            out[21] = 1.0 - min(to_there / 50.0, 1.0)
            out[22] = 1.0 - min(seconds / 6.0, 1.0)
            if seconds < 12.0:
                out[23] = clip(seconds - to_there / max(ego[4], _LEAST_SPEED), -3.0, 3.0)
    on_route = user_along, beside, follows, lane, on_lane
    _write_closeness(user, half_width, ego, along, way, road, on_route, reached, model, out[24:])


@kernel
def _scaled(quantities, columns, out):
    """Write quantities in their scales, as COLUMN records say."""
    for number in range(len(columns)):
        column = columns[number]
        value = quantities[column.quantity] / column.scale
        out[number] = clip(value, column.low, column.high)


def _entry(sources: int):
    @allocating_entry_point
    def run(rows, agents, routes, lanes, successors, classes, models, columns, out, first, end):
        points, lengths, tasks = routes
        of_ego, of_user = columns
        model = models[0]
        most = (out.shape[1] - len(of_ego)) // len(of_user)
        users = np.empty((rows.shape[1], 5))
        nearest = np.empty(rows.shape[1], np.int64)
        distances = np.empty(rows.shape[1])
        quantities = np.empty(24 + _MOTIONS * (len(SECONDS) + 1))
        reached = np.empty(_MOTIONS)
        for row in range(first, end):
            out[row] = 0.0
            if rows[row, 0, 0] == 0.0:
                continue
            agent = agents[row]
            way = points[agent.way]
            last = lengths[agent.way] - 1
            task = tasks[agent.way]
            ego = users[0]
            _read(rows[row, 0], model, agent.cos, agent.sin, ego)
            visible = 0
            for slot in range(1, rows.shape[1]):
                if rows[row, slot, 0] == 0.0:
                    continue
                if max(abs(rows[row, slot, 1]), abs(rows[row, slot, 2])) >= 1.0:  # it is clipped
                    continue
                _read(rows[row, slot], model, agent.cos, agent.sin, users[slot])
                apart = geometry.distance(users[slot, 0], users[slot, 1], ego[0], ego[1])
                if apart > RANGE:
                    continue
                rank = visible
                while rank > 0 and distances[rank - 1] > apart:
                    nearest[rank] = nearest[rank - 1]
                    distances[rank] = distances[rank - 1]
                    rank -= 1
                nearest[rank] = slot
                distances[rank] = apart
                visible += 1
            route = _projected(way, ego[0], ego[1], 0, last)
            targets(ego[4], agent.target_speed, model, reached)
            _write_ego(ego, agent, route, (way, task, last), reached, model, visible, quantities)
            _scaled(quantities, of_ego, out[row])
            for place in range(min(visible, most)):
                slot = nearest[place]
                kind = int(rows[row, slot, 0]) - 1
                size = classes[kind, 1], classes[kind, 2]
                quantities[:] = 0.0
                _write_user(
                    users[slot], int(classes[kind, 0]), size, ego, route[:2], (way, last), task,
                    (lanes, successors), reached, model, quantities,
                )  # fmt: skip
                begin = len(of_ego) + place * len(of_user)
                _scaled(quantities, of_user, out[row, begin : begin + len(of_user)])
        return sources

    return run


run: Any = _entry(fingerprint(__file__))
"""Write the observation along the route of some agents.

Args:
    rows: Rows of road users that each agent is shown, float32 (agent, row, 7).
    agents: AGENT record of each agent.
    routes: Points, lengths and TASK records of the routes.
    lanes: LANE records of the map; none: others are predicted straight on.
    successors: First lanes of the roads that follow each road, (road, most).
    classes: Kind, half length and half width of the road users of each code less 1, (code, 3).
    models: MODEL record in an array of one.
    columns: COLUMN records of the ego, and of a road user.
    out: Observations that are written, float32 (agent, feature); zeros where the agent has left.
    first: First agent of the part to do, up to `end`.
"""
