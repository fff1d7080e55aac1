"""One decision of an episode of any road, and the scenes of highway-env, which run through it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from socialiq.types import Ending
from socialiq.worlds.highway.core import drivers, rewards, stream
from socialiq.worlds.highway.core.compile import entry_point, fingerprint, kernel
from socialiq.worlds.highway.core.effects import effects_of
from socialiq.worlds.highway.core.geometry import closest_lane, distance, longitudinal, on_lane
from socialiq.worlds.highway.core.vehicle import advance, collide
from socialiq.worlds.highway.network import EXIT
from socialiq.worlds.highway.options import DECIDE, DECIDE_AND_RESET, RESET, SKIP, Contact

_NO_ENDING, _NO_CONTACT = int(Ending.NONE), int(Contact.NONE)


class RoadKernels(NamedTuple):
    """Kernels by which a road differs from others; `road` is its tables."""

    lane: Callable[..., Any]  # (number, road) -> record of a lane
    coordinate: Callable[..., Any]  # (vehicle, road) -> its metres along the task
    # (vehicles, slot, ego, road) -> whether it entered by the ego's approach
    same_origin: Callable[..., Any]
    arrived: Callable[..., Any]  # (vehicle, road) -> whether it has arrived
    sight: Callable[..., Any]  # (road) -> SIGHT record
    # (episode, vehicles, action, road, settings): begin an action of the ego
    choose: Callable[..., Any]
    sub_step: Callable[..., Any]  # (episode, vehicles, road, settings): advance all by a sub-step
    # (episode, vehicles, road, settings): remove and add vehicles after a decision
    renew: Callable[..., Any]
    # (episode, vehicles, road, settings): start an episode from its stream
    reset: Callable[..., Any]
    # (count, vehicles) -> number of records in use, obstacles among them
    records: Callable[..., Any]
    leaves: Callable[..., Any]  # (vehicle, road) -> whether it is removed after a decision
    # (episode, vehicles, road, settings): make the ego a driver like the others
    release: Callable[..., Any]
    remove: Callable[..., Any]  # (episode, vehicles, slot): take a vehicle off the road
    # (vehicle, slot, ego, road) -> place of a vehicle in `effects.RELATIONS`
    relation: Callable[..., Any]


@kernel
def _copy(vehicles, count, target):
    for slot in range(count):
        target[slot] = vehicles[slot]


def carry_out_of(kernels: RoadKernels) -> Callable[..., Any]:
    """Return the kernel (buffers, row, command, action, road, settings) of a road's commands."""
    lane_of, sight, records = kernels.lane, kernels.sight, kernels.records
    coordinate, choose, sub_step = kernels.coordinate, kernels.choose, kernels.sub_step
    renew, reset = kernels.renew, kernels.reset

    @kernel
    def observe(vehicles, count, ego, road, settings, observation):
        lane, along = lane_of(vehicles[ego].lane, road), np.empty(count)
        for slot in range(count):
            along[slot] = longitudinal(lane, vehicles[slot].x, vehicles[slot].y)
        rewards.observe(vehicles, count, ego, along, settings.tie, sight(road), observation)

    annotate = _annotate_of(kernels, observe)

    @kernel
    def decide(buffers, row, action, road, settings):
        """Run the sub-steps of one decision; write snapshots before and after them."""
        episode, vehicles = buffers.episodes[row], buffers.vehicles[row]
        _copy(vehicles, records(episode.vehicles, vehicles), buffers.before[row])
        episode.time += settings.decision
        choose(episode, vehicles, action, road, settings)
        for frame in range(settings.frames):
            sub_step(episode, vehicles, road, settings)
            if len(buffers.trace):
                _copy(vehicles, records(episode.vehicles, vehicles), buffers.trace[row, frame])
        _copy(vehicles, records(episode.vehicles, vehicles), buffers.after[row])
        buffers.present[row, 0], buffers.present[row, 1] = episode.vehicles, episode.ego

    @kernel
    def carry_out(buffers, row, command, action, road, settings):
        if command == SKIP:
            return
        episode, vehicles, ending = buffers.episodes[row], buffers.vehicles[row], _NO_ENDING
        deciding = command in (DECIDE, DECIDE_AND_RESET)
        if deciding:
            decide(buffers, row, action, road, settings)
        if command != RESET:
            ending = annotate(buffers, row, road, settings)
            # Assigning whole arrays compiles NumPy's broadcasting and its messages, for seconds.
            for slot in range(buffers.reached.shape[1]):
                for feature in range(buffers.reached.shape[2]):
                    buffers.observation[row, slot, feature] = buffers.reached[row, slot, feature]
        if deciding:
            renew(episode, vehicles, road, settings)
        if command == RESET or (command == DECIDE_AND_RESET and ending != _NO_ENDING):
            reset(episode, vehicles, road, settings)
            episode.start = coordinate(vehicles[episode.ego], road)
            count = records(episode.vehicles, vehicles)
            observe(vehicles, count, episode.ego, road, settings, buffers.observation[row])

    return carry_out


def _annotate_of(kernels: RoadKernels, observe: Callable[..., Any]) -> Callable[..., Any]:
    """Return the kernel that writes a decision's results from its two snapshots."""
    arrived, records, same_origin = kernels.arrived, kernels.records, kernels.same_origin
    lane_of, coordinate = kernels.lane, kernels.coordinate

    @kernel
    def is_on_road(vehicle, road):
        return on_lane(lane_of(vehicle.lane, road), vehicle.x, vehicle.y, 0.0)

    @kernel
    def write_signals(before, after, count, slot_of_ego, start, ending, road, settings, row):
        signals, braking = row
        ego = after[slot_of_ego]
        reached = coordinate(ego, road)
        advanced = reached - coordinate(before[slot_of_ego], road)
        rewards.env_signals(advanced, is_on_road(ego, road), ego.speed, ending, settings, signals)
        lane = lane_of(ego.lane, road)
        along, travelled = longitudinal(lane, ego.x, ego.y), reached - start
        within = rewards.in_zone(lane.kind, along, lane.length, travelled, settings)
        counted, lost = np.empty(count, np.bool_), np.empty(count)
        for slot in range(count):
            vehicle = after[slot]
            apart = distance(vehicle.x, vehicle.y, ego.x, ego.y)
            same = same_origin(after, slot, slot_of_ego, road)
            counts = rewards.counts(apart, same, lane_of(vehicle.target_lane, road).kind, settings)
            counted[slot] = slot != slot_of_ego and counts
            lost[slot] = before[slot].speed - vehicle.speed
        rewards.social_signals(ego.speed, within, counted, lost, ending, settings, signals, braking)

    @kernel
    def annotate(buffers, row, road, settings):
        episode, before, after = buffers.episodes[row], buffers.before[row], buffers.after[row]
        count, slot = buffers.present[row, 0], buffers.present[row, 1]
        ego = after[slot]
        observe(after, records(count, after), slot, road, settings, buffers.reached[row])
        left = settings.offroad_terminal and not is_on_road(ego, road)
        late = episode.time >= settings.duration
        ending = rewards.ending_of(ego.crashed, left, arrived(ego, road), late)
        signals = buffers.signals[row]
        written = signals, buffers.braking[row]
        write_signals(before, after, count, slot, episode.start, ending, road, settings, written)
        r_env, r_social = rewards.pair(signals, settings)
        buffers.rewards[row, 0], buffers.rewards[row, 1] = r_env, r_social
        on_road = np.empty(count, np.bool_)
        for number in range(count):
            on_road[number] = is_on_road(after[number], road)
        ego_reward, neighbours = rewards.classical(before, after, on_road, count, slot, settings)
        buffers.classical[row, 0], buffers.classical[row, 1] = ego_reward, neighbours
        buffers.speed[row], buffers.ending[row] = ego.speed, ending
        buffers.contact[row] = episode.contact if ego.crashed else _NO_CONTACT
        touched = episode.touched if ego.crashed else -1
        crashed = rewards.neighbours_collided(before, after, count, slot, touched)
        buffers.neighbours_collided[row] = crashed
        return ending

    return annotate


@kernel
def _sub_step(episode, cars, road, settings):
    """Advance by a sub-step: decisions in the order of entry, motion, then collisions."""
    count = episode.vehicles
    for slot in range(count):
        if slot == episode.ego:
            drivers.control(cars[slot], road)
        else:
            drivers.drive(cars, count, slot, road)
    for slot in range(count):
        car = cars[slot]
        car.timer += settings.dt
        advance(car, settings.dt)
        car.lane = closest_lane(road.lanes, car.x, car.y, car.heading, car.lane)
    contact, touched = episode.contact, episode.touched
    struck = collide(cars, count, len(cars), 0, settings.dt, 0.0, contact, touched)
    episode.contact, episode.touched = struck


@kernel
def _lane(number, road):
    return road.lanes[number]


@kernel
def _coordinate(car, road):
    """Return the metres of the task up to a vehicle, by the first lane of its target road."""
    lane = road.lanes[car.target_lane]
    along = longitudinal(lane, car.x, car.y)
    return lane.before + along * (road.lanes[lane.first].length / lane.length)


@kernel
def _same_origin(_cars, slot, ego, road):
    roads, entries = road.lanes, road.entries
    return roads[entries[slot].lane].road == roads[entries[ego].lane].road


@kernel
def _arrived(ego, road):
    lane = road.lanes[ego.lane]
    return lane.kind == EXIT and longitudinal(lane, ego.x, ego.y) > road.sight[0].arrival


@kernel
def _sight(road):
    return road.sight[0]


@kernel
def _renew(_episode, _cars, _road, _settings):
    """Leave the vehicles as they are."""


@kernel
def _records(_count, cars):
    return len(cars)


@kernel
def _leaves(_car, _road):
    return False


@kernel
def _release(episode, _cars, _road, _settings):
    episode.ego = -1


_FAR = 1e6  # m, where removed vehicles stand


@kernel
def _remove(_episode, cars, slot):
    """Put a vehicle out of reach of all others: entries belong to slots."""
    car = cars[slot]
    car.x, car.y, car.speed, car.target_speed = _FAR * (2 + slot), _FAR, 0.0, 0.0
    car.steering, car.acceleration, car.pushed = 0.0, 0.0, False


@kernel
def _relation(car, slot, _ego, road):
    return 0 if _same_origin(car, slot, 0, road) else 2


_TABLES = _lane, _coordinate, _same_origin, _arrived, _sight
_CHANGES = drivers.choose, _sub_step, _renew, drivers.reset
_KERNELS = RoadKernels(*_TABLES, *_CHANGES, _records, _leaves, _release, _remove, _relation)
_carry_out = carry_out_of(_KERNELS)
_effects = effects_of(_KERNELS)


def _entry(sources: int):
    @entry_point
    def run(buffers, commands, entropy, seeded, actions, options, road, first, end):
        for row in range(first, end):
            if seeded[row]:
                stream.seed(buffers.episodes[row], entropy[row])
            _carry_out(buffers, row, commands[row], actions[row], road, options[0])
        return sources  # so that the cache depends on the sources; see `compile.fingerprint`

    return run


def _effects_entry(sources: int):
    @entry_point
    def run(command, buffers, ledger, rows, options, road, effects, first, end):
        for row in range(first, end):
            if rows[row]:
                _effects(command, buffers, ledger, row, road, options[0], effects[0])
        return sources

    return run


run: Any = _entry(fingerprint())
"""Carry out a command for every episode of a batch; the intersection has an equal entry point.

Args:
    buffers: Arrays read and written, `options.Buffers`.
    commands: One of `options`' commands for each episode, int8.
    entropy: Seed of each episode's stream, uint64; it begins where `seeded`, bool.
    actions: The ego's actions, int64. Continuous ones are held in its record instead.
    options: SETTINGS record in an array of one.
    road: Tables of the scene, `scenes.Road`; of the intersection 0.
    first: First episode of the part to do, up to `end`.
"""


effects: Any = _effects_entry(fingerprint())
"""Carry out a command of `core.effects` for some rows of a traced batch, bool (batch,).

Ledger and record are of `highway.effects`; the other arguments are those of `run`.
"""


def _off_road_entry(sources: int):
    @entry_point
    def run(lanes, vehicles, present, off_road, first, end):
        for row in range(first, end):
            ego = vehicles[row, present[row, 1]]
            off_road[row] = not on_lane(lanes[ego.lane], ego.x, ego.y, 0.0)
        return sources

    return run


off_road: Any = _off_road_entry(fingerprint())
"""Write whether each ego's centre is beyond its closest lane, on any road, bool (batch,)."""
