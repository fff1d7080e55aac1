"""One decision of an episode of any road, and the scenes of highway-env, which run through it."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from socialiq.types import Ending
from socialiq.worlds.highway.core import drivers, rewards, stream
from socialiq.worlds.highway.core.compile import allocating_kernel, entry_point, fingerprint, kernel
from socialiq.worlds.highway.core.effects import effects_of
from socialiq.worlds.highway.core.geometry import closest_lane, distance, longitudinal, on_lane
from socialiq.worlds.highway.core.vehicle import advance, collide
from socialiq.worlds.highway.network import EXIT
from socialiq.worlds.highway.options import DECIDE, DECIDE_AND_RESET, RESET, SKIP, Contact

_NO_ENDING, _COLLIDED, _NO_CONTACT = int(Ending.NONE), int(Ending.COLLISION), int(Contact.NONE)


class RoadKernels(NamedTuple):
    """Kernels by which a road differs from others; `road` is its tables."""

    lane: Callable[..., Any]  # (number, road) -> record of a lane
    coordinate: Callable[..., Any]  # (vehicle, road) -> its metres along the task
    # (vehicles, slot, agent's slot, road) -> whether it entered by the agent's approach
    same_origin: Callable[..., Any]
    arrived: Callable[..., Any]  # (vehicle, road) -> whether it has arrived
    sight: Callable[..., Any]  # (road) -> SIGHT record
    turns: Callable[..., Any]  # (vehicle, road, settings) -> quarter turns of its view
    choose: Callable[..., Any]  # (vehicle, action, road, settings): begin an agent's action
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
    # (vehicles, slot of the agent, SIGHT record, quarter turns, settings, observation): write the
    # rows of people on foot, if the road has any
    observe_people: Callable[..., Any]


@kernel
def _copy(vehicles, count, target):
    for slot in range(count):
        target[slot] = vehicles[slot]


def carry_out_of(kernels: RoadKernels) -> Callable[..., Any]:
    """Return the kernel (buffers, row, command, actions, road, settings) of a road's commands.

    Agents' results and actions have a row each, those of an episode in turn.
    """
    lane_of, sight, turns = kernels.lane, kernels.sight, kernels.turns
    renew, remove, observe_people = kernels.renew, kernels.remove, kernels.observe_people

    @allocating_kernel
    def observe(vehicles, count, slot_of_agent, people, road, settings, observation):
        agent, along = vehicles[slot_of_agent], np.empty(count)
        lane, turned = lane_of(agent.lane, road), turns(agent, road, settings)
        for slot in range(count):
            along[slot] = longitudinal(lane, vehicles[slot].x, vehicles[slot].y)
        view = along, settings.tie, sight(road), turned, settings.observed_vehicles
        rewards.observe(vehicles, count, slot_of_agent, view, observation)
        if settings.walkers:
            observe_people(people, slot_of_agent, sight(road), turned, settings, observation)

    decide, begin = _decide_of(kernels), _begin_of(kernels, observe)
    annotate = _annotate_of(kernels, observe)

    @kernel
    def depart(episode, vehicles):
        """Remove wrecks, and agents that have arrived."""
        for slot in range(episode.vehicles - 1, -1, -1):
            number = vehicles[slot].agent
            if vehicles[slot].crashed or (number >= 0 and episode.ended[number] != _NO_ENDING):
                remove(episode, vehicles, slot)

    @kernel
    def carry_out(buffers, row, command, actions, road, settings):
        if command == SKIP:
            return
        episode, vehicles, ended = buffers.episodes[row], buffers.vehicles[row], False
        deciding = command in (DECIDE, DECIDE_AND_RESET)
        if deciding:
            decide(buffers, row, actions, road, settings)
        if command != RESET:
            ended = annotate(buffers, row, road, settings)
            # Assigning whole arrays compiles NumPy's broadcasting and its messages, for seconds.
            for result in range(row * settings.agents, (row + 1) * settings.agents):
                for slot in range(buffers.reached.shape[1]):
                    for feature in range(buffers.reached.shape[2]):
                        reached = buffers.reached[result, slot, feature]
                        buffers.observation[result, slot, feature] = reached
        if deciding:
            if settings.each:
                depart(episode, vehicles)
            renew(episode, vehicles, road, settings)
        if command == RESET or (command == DECIDE_AND_RESET and ended):
            begin(buffers, row, road, settings)

    return carry_out


def _decide_of(kernels: RoadKernels) -> Callable[..., Any]:
    """Return the kernel of a decision's sub-steps."""
    choose, sub_step, records = kernels.choose, kernels.sub_step, kernels.records

    @kernel
    def decide(buffers, row, actions, road, settings):
        """Run the sub-steps of one decision; write snapshots before and after them."""
        episode, vehicles = buffers.episodes[row], buffers.vehicles[row]
        _copy(vehicles, records(episode.vehicles, vehicles), buffers.before[row])
        episode.time += settings.decision
        for number in range(settings.agents):
            slot = episode.controlled[number]
            if slot >= 0:
                choose(vehicles[slot], actions[row * settings.agents + number], road, settings)
        for frame in range(settings.frames):
            sub_step(episode, vehicles, road, settings)
            if len(buffers.trace):
                _copy(vehicles, records(episode.vehicles, vehicles), buffers.trace[row, frame])
                for slot in range(settings.first_walker, settings.first_walker + settings.walkers):
                    buffers.trace[row, frame, slot] = vehicles[slot]
        _copy(vehicles, records(episode.vehicles, vehicles), buffers.after[row])
        buffers.present[row, 0] = episode.vehicles
        for number in range(settings.agents):
            buffers.present[row, 1 + number] = episode.controlled[number]

    return decide


def _begin_of(kernels: RoadKernels, observe: Callable[..., Any]) -> Callable[..., Any]:
    """Return the kernel that starts an episode."""
    coordinate, reset, records = kernels.coordinate, kernels.reset, kernels.records

    @kernel
    def begin(buffers, row, road, settings):
        episode, vehicles = buffers.episodes[row], buffers.vehicles[row]
        for number in range(settings.agents):
            episode.controlled[number], episode.ended[number] = -1, _NO_ENDING
            episode.contact[number], episode.touched[number] = _NO_CONTACT, -1
        reset(episode, vehicles, road, settings)
        count = records(episode.vehicles, vehicles)
        for number in range(settings.agents):
            slot, result = episode.controlled[number], row * settings.agents + number
            episode.start[number] = coordinate(vehicles[slot], road)
            seen_by_agent = buffers.observation[result]
            observe(vehicles, count, slot, vehicles, road, settings, seen_by_agent)

    return begin


@kernel
def _clear(buffers, result):
    """Write the results of an agent that has left."""
    for slot in range(buffers.reached.shape[1]):
        for feature in range(buffers.reached.shape[2]):
            buffers.reached[result, slot, feature] = 0.0
    for slot in range(buffers.braking.shape[1]):
        buffers.braking[result, slot] = False
    for signal in range(buffers.signals.shape[1]):
        buffers.signals[result, signal] = 0.0
    for side in range(2):
        buffers.rewards[result, side], buffers.classical[result, side] = 0.0, 0.0
    buffers.speed[result], buffers.contact[result] = 0.0, _NO_CONTACT
    buffers.neighbours_collided[result] = 0


def _signals_of(kernels: RoadKernels) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return the kernels that tell whether a vehicle is on the road, and write the signals."""
    lane_of, coordinate, same_origin = kernels.lane, kernels.coordinate, kernels.same_origin

    @kernel
    def is_on_road(vehicle, road):
        return on_lane(lane_of(vehicle.lane, road), vehicle.x, vehicle.y, 0.0)

    @allocating_kernel
    def write_signals(before, after, count, slot_of_agent, start, ending, road, settings, row):
        signals, braking = row
        ego = after[slot_of_agent]
        reached = coordinate(ego, road)
        earlier = before[slot_of_agent]
        advanced = reached - coordinate(earlier, road)
        if math.isnan(advanced):  # elsewhere than on the task's way
            advanced = distance(ego.x, ego.y, earlier.x, earlier.y)
        rewards.env_signals(advanced, is_on_road(ego, road), ego.speed, ending, settings, signals)
        lane = lane_of(ego.lane, road)
        along, travelled = longitudinal(lane, ego.x, ego.y), reached - start
        within = rewards.in_zone(lane.kind, along, lane.length, travelled, settings)
        counted, lost = np.empty(count, np.bool_), np.empty(count)
        for slot in range(count):
            vehicle = after[slot]
            apart = distance(vehicle.x, vehicle.y, ego.x, ego.y)
            same = same_origin(after, slot, slot_of_agent, road)
            counts = rewards.counts(apart, same, lane_of(vehicle.target_lane, road).kind, settings)
            counted[slot] = slot != slot_of_agent and counts
            lost[slot] = before[slot].speed - vehicle.speed
        rewards.social_signals(ego.speed, within, counted, lost, ending, settings, signals, braking)

    return is_on_road, write_signals


def _annotate_of(kernels: RoadKernels, observe: Callable[..., Any]) -> Callable[..., Any]:
    """Return the kernel that writes a decision's results from its two snapshots."""
    arrived, records = kernels.arrived, kernels.records
    is_on_road, write_signals = _signals_of(kernels)

    @kernel
    def annotate_agent(buffers, row, number, result, on_road, road, settings):
        """Write an agent's results, and return its ending; what follows its ending pays nothing."""
        episode, before, after = buffers.episodes[row], buffers.before[row], buffers.after[row]
        count, slot = buffers.present[row, 0], buffers.present[row, 1 + number]
        earlier = episode.ended[number]
        if slot < 0:
            _clear(buffers, result)
            return earlier
        ego = after[slot]
        people, reached = buffers.vehicles[row], buffers.reached[result]
        observe(after, records(count, after), slot, people, road, settings, reached)
        left = settings.offroad_terminal and not on_road[slot]
        late = episode.time >= settings.duration
        ending = rewards.ending_of(ego.crashed, left, arrived(ego, road), late)
        signals, start = buffers.signals[result], episode.start[number]
        written = signals, buffers.braking[result]
        write_signals(before, after, count, slot, start, ending, road, settings, written)
        if earlier == _NO_ENDING:
            episode.ended[number] = ending
        else:
            for signal in range(len(signals)):
                signals[signal] = 0.0
        r_env, r_social = rewards.pair(signals, settings)
        buffers.rewards[result, 0], buffers.rewards[result, 1] = r_env, r_social
        ego_reward, neighbours = rewards.classical(before, after, on_road, count, slot, settings)
        buffers.classical[result, 0], buffers.classical[result, 1] = ego_reward, neighbours
        buffers.speed[result] = ego.speed
        buffers.contact[result] = episode.contact[number] if ego.crashed else _NO_CONTACT
        touched = episode.touched[number] if ego.crashed else -1
        crashed = rewards.neighbours_collided(before, after, count, slot, touched)
        buffers.neighbours_collided[result] = crashed
        return ending

    @allocating_kernel
    def annotate(buffers, row, road, settings):
        """Write the results of all agents, and return whether the episode has ended."""
        after, count = buffers.after[row], buffers.present[row, 0]
        on_road = np.empty(count, np.bool_)
        for slot in range(count):
            on_road[slot] = is_on_road(after[slot], road)
        driving, crashed = 0, False
        for number in range(settings.agents):
            result = row * settings.agents + number
            ending = annotate_agent(buffers, row, number, result, on_road, road, settings)
            buffers.ending[result] = ending
            driving += ending == _NO_ENDING
            crashed |= ending == _COLLIDED
        return driving == 0 or (crashed and not settings.each)

    return annotate


@kernel
def _sub_step(episode, cars, road, settings):
    """Advance by a sub-step: decisions in the order of entry, motion, then collisions."""
    count = episode.vehicles
    for slot in range(count):
        if cars[slot].agent >= 0:
            drivers.control(cars[slot], road)
        else:
            drivers.drive(cars, count, slot, road)
    for slot in range(count):
        car = cars[slot]
        car.timer += settings.dt
        advance(car, settings.dt)
        car.lane = closest_lane(road.lanes, car.x, car.y, car.heading, car.lane)
    collide(episode, cars, len(cars), settings.agents, settings.dt, 0.0)


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
def _turns(_car, _road, _settings):
    return 0


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
def _release(episode, cars, _road, _settings):
    cars[0].agent, episode.controlled[0] = -1, -1


_FAR = 1e6  # m, where removed vehicles stand


@kernel
def _remove(episode, cars, slot):
    """Put a vehicle out of reach of all others: entries belong to slots."""
    car = cars[slot]
    if car.agent >= 0:
        episode.controlled[car.agent] = -1
    car.x, car.y, car.speed, car.target_speed = _FAR * (2 + slot), _FAR, 0.0, 0.0
    car.steering, car.acceleration, car.pushed = 0.0, 0.0, False


@kernel
def _relation(car, slot, _ego, road):
    return 0 if _same_origin(car, slot, 0, road) else 2


_TABLES = _lane, _coordinate, _same_origin, _arrived, _sight, _turns
_CHANGES = drivers.choose, _sub_step, _renew, drivers.reset


@kernel
def _observe_people(_vehicles, _slot, _sight, _turns, _settings, _observation):
    pass


_REST = _records, _leaves, _release, _remove, _relation, _observe_people
_KERNELS = RoadKernels(*_TABLES, *_CHANGES, *_REST)
_carry_out = carry_out_of(_KERNELS)
_effects = effects_of(_KERNELS)


def _entry(sources: int):
    @entry_point
    def run(buffers, commands, entropy, seeded, actions, options, road, first, end):
        for row in range(first, end):
            if seeded[row]:
                stream.seed(buffers.episodes[row], entropy[row])
            _carry_out(buffers, row, commands[row], actions, road, options[0])
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
    actions: The agents' actions, int64. Continuous ones are held in their records instead.
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
            for number in range(present.shape[1] - 1):
                slot, left = present[row, 1 + number], False
                if slot >= 0:
                    car = vehicles[row, slot]
                    left = not on_lane(lanes[car.lane], car.x, car.y, 0.0)
                off_road[row, number] = left
        return sources

    return run


off_road: Any = _off_road_entry(fingerprint())
"""Write whether each agent is beyond its closest lane, on any road, bool (batch, agents)."""
