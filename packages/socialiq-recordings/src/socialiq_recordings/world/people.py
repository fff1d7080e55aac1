"""Recorded pedestrians and cyclists, replayed among the vehicles of a recorded junction, compiled.

They are where they were recorded at each sub-step, whatever the vehicles do, and gone when the
recording ends. Drivers brake for a person in what they sweep, or one that enters it within `LOOK` s
at its velocity, as for a vehicle ahead.
"""

import collections
import math
from typing import Any

from socialiq.worlds.highway.core.compile import entry_point, fingerprint, kernel
from socialiq_recordings.world.geometry import four, projected

LOOK = 2.0  # s
_SEEN = 60.0  # m from a vehicle's middle; drivers brake for no person further away

Person = collections.namedtuple(
    "Person", "x y heading along_x along_y speed length width kind present"
)
"""Person at a sub-step, with the names of a vehicle's record; `kind` is a `RoadUser`. A person that
is not in view is not `present`."""

NO_PERSON = Person(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, False)


@kernel
def person_at(road, number, step):
    """Return a person at a sub-step, a `Person`.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        number: Person, numbered over all recordings.
        step: Sub-step from the recording's first frame.
    """
    since = step - road.person_step[number]
    row = road.person_state_first[number] + since
    if since < 0 or row >= road.person_state_first[number + 1]:
        return NO_PERSON
    x, y, heading, speed = four(road.person_state, row)
    length = road.person_size[number, 0]
    width = road.person_size[number, 1]
    kind = road.person_class[number]
    along_x = math.cos(heading)
    along_y = math.sin(heading)
    return Person(x, y, heading, along_x, along_y, speed, length, width, kind, True)


@kernel
def people_of(road, episode):
    """Return the numbers of the people of an episode's recording.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record.
    """
    return range(road.person_first[episode.recording], road.person_first[episode.recording + 1])


@kernel
def ahead(road, episode, car):
    """Return the gap to the nearest person in a vehicle's way, m, and the speed along it, m/s.

    Args:
        road: Arrays of the world, `recorded_world.Road`.
        episode: EPISODE record.
        car: Record of the vehicle.

    Returns:
        The gap from the vehicle's front, infinite without a person; and a speed of at least 0.
    """
    gap = math.inf
    pace = 0.0
    for number in people_of(road, episode):
        person = person_at(road, number, episode.sub_steps)
        if not person.present or math.hypot(person.x - car.x, person.y - car.y) > _SEEN:
            continue
        at, left, direction = projected(road, car.way, person.x, person.y)
        speed = person.speed
        turned = person.heading - direction
        cos = math.cos(turned)
        sin = math.sin(turned)
        beside = 0.5 * (car.width + abs(cos) * person.width + abs(sin) * person.length)
        if abs(left) > beside:
            closing = -speed * sin if left > 0.0 else speed * sin
            if abs(left) - beside > LOOK * closing:
                continue
            at += (abs(left) - beside) / closing * speed * cos
        if at > car.along:
            half = 0.5 * (car.length + abs(cos) * person.length + abs(sin) * person.width)
            if at - car.along - half < gap:
                gap = at - car.along - half
                pace = max(speed * cos, 0.0)
    return gap, pace


def _near_entry(sources: int):
    @entry_point
    def run(episodes, vehicles, road, options, seconds, near, first, end):
        least = options[0].target_speeds[1]
        for row in range(first, end):
            car = vehicles[row, episodes[row].controlled[0]]
            gap, _ = ahead(road, episodes[row], car)
            near[row] = gap < seconds * max(car.speed, least)
        return sources

    return run


near: Any = _near_entry(fingerprint(__file__))
"""Write whether each ego reaches a person in its way within some seconds, (row,)."""
