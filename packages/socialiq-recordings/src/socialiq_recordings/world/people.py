"""Recorded pedestrians and cyclists, replayed among the vehicles of a recorded junction, compiled.

They are where they were recorded at each sub-step, whatever the vehicles do, and gone when the
recording ends. Drivers brake for a person in what they sweep, or one that enters it within `LOOK` s
at its velocity, as for a vehicle ahead.
"""

import math

from socialiq.physics import overlap_depth
from socialiq.worlds.highway.core.compile import inlined_kernel, kernel
from socialiq.worlds.highway.options import Contact
from socialiq_recordings.world.geometry import place_of, projected

LOOK = 2.0  # s
_SEEN = 60.0  # m from a vehicle's middle; drivers brake for no person further away
_UNTOUCHED, _STRUCK, _WAS_STRUCK = (int(kind) for kind in Contact)


@kernel
def state_at(road, person, step):
    """Return the row of a person's state at a sub-step, -1 if the person isn't in view.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        person: Person, numbered over all recordings.
        step: Sub-step from the recording's first frame.
    """
    since = step - road.person_step[person]
    row = road.person_state_first[person] + since
    return row if since >= 0 and row < road.person_state_first[person + 1] else -1


@kernel
def ahead(road, recording, step, vehicle, along):
    """Return the gap to the nearest person in a vehicle's way, m, and the speed along it, m/s.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        recording: Number of the recording.
        step: Sub-step from the recording's first frame.
        vehicle: Vehicle, numbered over all recordings.
        along: Coordinate of its middle on its way, m.

    Returns:
        The gap from the vehicle's front, infinite without a person; and a speed of at least 0.
    """
    gap = math.inf
    pace = 0.0
    first = road.person_first[recording]
    end = road.person_first[recording + 1]
    if first == end:
        return gap, pace
    x, y, _ = place_of(road.line_first, road.line, vehicle, along)
    state = road.person_state
    for person in range(first, end):
        row = state_at(road, person, step)
        if row < 0:
            continue
        px = state[row, 0]
        py = state[row, 1]
        speed = state[row, 3]
        if math.hypot(px - x, py - y) > _SEEN:
            continue
        at, left, direction = projected(road.line_first, road.line, vehicle, px, py)
        turned = state[row, 2] - direction
        cos = math.cos(turned)
        sin = math.sin(turned)
        length = road.person_size[person, 0]
        width = road.person_size[person, 1]
        beside = 0.5 * (road.width[vehicle] + abs(cos) * width + abs(sin) * length)
        if abs(left) > beside:
            closing = -speed * sin if left > 0.0 else speed * sin
            if abs(left) - beside > LOOK * closing:
                continue
            at += (abs(left) - beside) / closing * speed * cos
        if at > along:
            half = 0.5 * (road.length[vehicle] + abs(cos) * length + abs(sin) * width)
            if at - along - half < gap:
                gap = at - along - half
                pace = max(speed * cos, 0.0)
    return gap, pace


@kernel
def met(road, recording, step, vehicle, along, slack):
    """Return the person that overlaps a vehicle, and how both head for each other.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        recording: Number of the recording.
        step: Sub-step from the recording's first frame.
        vehicle: Vehicle, numbered over all recordings.
        along: Coordinate of its middle on its way, m.
        slack: Length by which the vehicle is narrower and shorter than recorded, m.

    Returns:
        The person, numbered over all recordings, -1 if no person overlaps it; the vector from the
        vehicle's middle to the person's, projected on the vehicle's heading, m; and the same vector
        projected on the person's heading, times the person's speed, m²/s.
    """
    x, y, angle = place_of(road.line_first, road.line, vehicle, along)
    half = max(road.length[vehicle] - slack, 0.1) / 2
    side = max(road.width[vehicle] - slack, 0.1) / 2
    for person in range(road.person_first[recording], road.person_first[recording + 1]):
        row = state_at(road, person, step)
        if row < 0:
            continue
        heading = road.person_state[row, 2]
        speed = road.person_state[row, 3]
        length = road.person_size[person, 0]
        width = road.person_size[person, 1]
        dx = road.person_state[row, 0] - x
        dy = road.person_state[row, 1] - y
        if math.hypot(dx, dy) > half + side + length + width:
            continue
        if overlap_depth(dx, dy, angle, heading, half, side, length / 2, width / 2) > 0.0:
            approach = math.cos(angle) * dx + math.sin(angle) * dy
            return person, approach, speed * (math.cos(heading) * dx + math.sin(heading) * dy)
    return -1, 0.0, 0.0


@inlined_kernel
def touched(road, traffic, row, base, slack):
    """Return the ego's contact with a person, and write the person's class to `hit`.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        traffic: Episodes, `gym.Traffic`.
        row: Episode.
        base: First vehicle of its recording.
        slack: Length by which vehicles are narrower and shorter than recorded, m.

    Returns:
        A `Contact` as an integer.
    """
    ego = traffic.ego[row]
    recording = traffic.recording[row]
    step = traffic.step[row]
    along = traffic.along[row, ego]
    person, approach, closing = met(road, recording, step, base + ego, along, slack)
    if person < 0:
        return _UNTOUCHED
    traffic.hit[row] = road.person_class[person]
    return _STRUCK if traffic.speed[row, ego] * approach >= -closing else _WAS_STRUCK


@inlined_kernel
def others_touched(road, traffic, row, base, slack):
    """Count the vehicles, without the ego, that touch a person for the first time.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        traffic: Episodes, `gym.Traffic`, in whose `met` the vehicles are marked.
        row: Episode.
        base: First vehicle of its recording.
        slack: Length by which vehicles are narrower and shorter than recorded, m.
    """
    count = 0
    recording = traffic.recording[row]
    step = traffic.step[row]
    for slot in range(traffic.n_present[row]):
        number = traffic.present[row, slot]
        if number == traffic.ego[row] or traffic.met[row, number]:
            continue
        along = traffic.along[row, number]
        if met(road, recording, step, base + number, along, slack)[0] >= 0:
            traffic.met[row, number] = 1
            count += 1
    return count
