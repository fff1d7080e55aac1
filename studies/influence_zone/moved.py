"""Vehicles around the ego, and which of them its choice moves, from branches of a world alone."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int, Int64

from socialiq.physics import ballistic, overlap_depth, wrapped
from socialiq.worlds.enumerate import Table
from socialiq.worlds.highway.batch import RoadBatch
from socialiq.worlds.highway.core import rewards
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH, VEHICLE_WIDTH, longitudinal
from socialiq.worlds.highway.effects import ABSENT, REPEAT
from socialiq.worlds.highway.options import settings_of
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.world import Actor

CHANGES = 0.3  # chance that `RandomActor` draws another action
MOVED = 1.0  # m in the decisions of a look ahead, from which a choice moves a vehicle
ROAD_FEATURES = ("ahead", "left", "distance", "speed_of_ego", "speed", "heading", "relation")
"""Of a vehicle seen from the ego: m, m, m, m/s, m/s, degrees, place in `effects.RELATIONS`."""
_TIMES = np.arange(0.25, 3.01, 0.25)  # s ahead, at which FeAR looks for contacts
_RATES = np.linspace(-6.0, 6.0, 13)  # m/s², actions of a vehicle in FeAR
_HALVES = (VEHICLE_LENGTH / 2, VEHICLE_WIDTH / 2) * 2

ActorOn = Callable[[RoadBatch], Actor]
"""Returns who drives a batch."""


class Decision(NamedTuple):
    """Vehicles around the egos before a decision, a row each, and what the decision brought."""

    episode: Int64[np.ndarray, " vehicle"]  # row of the batch
    features: Float64[np.ndarray, "vehicle feature"]  # `ROAD_FEATURES`
    in_hand_zone: Bool[np.ndarray, " vehicle"]  # whether Eq 4.2 counts the vehicle
    metres: Float64[np.ndarray, "vehicle action"]  # driven in the look ahead, by repeated action
    absent: Float64[np.ndarray, " vehicle"]  # the same without the ego
    chosen: Float64[np.ndarray, " vehicle"]  # the same with the action that was taken
    lost_actions: Float64[np.ndarray, " vehicle"]  # FeAR of the ego on the vehicle, -1 to 1
    signals: Mapping[str, np.ndarray]  # of the decision, (row,)
    running: Bool[np.ndarray, " row"]  # which rows the decision was taken in


class RandomActor:
    """Actor that repeats an action for some decisions, and then draws another one."""

    def __init__(self, batch: RoadBatch, seed: int) -> None:
        self._generator = np.random.default_rng(seed)
        self._n_actions = batch.n_actions
        self._action: np.ndarray | None = None

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Leave the state unchanged: the episodes begin together.

        Args:
            rows: Rows in which an episode begins.
            seeds: Seeds of these episodes.
        """

    def decide(self, observation: Any, running: np.ndarray) -> np.ndarray:  # noqa: ARG002
        """Return one action for each row.

        Args:
            observation: Not used.
            running: Whether each row's episode runs; its length is the number of rows.
        """
        size = len(running)
        fresh = self._generator.integers(0, self._n_actions, size)
        changes = self._generator.random(size) < CHANGES
        last = fresh if self._action is None else self._action
        self._action = np.where(changes, fresh, last)
        return self._action


def decisions(world: RoadWorld, actor_on: ActorOn, seeds: np.ndarray) -> Iterator[Decision]:
    """Drive an episode for each seed; yield each decision of those that run.

    Args:
        world: Road whose r_social is what the ego causes.
        actor_on: Returns the actor that drives a batch.
        seeds: Seed of each episode.
    """
    batch = world.batch(len(seeds))
    running = np.ones(len(seeds), bool)
    batch.reset(seeds)
    actor = actor_on(batch)
    ledger = batch.ledger
    assert ledger is not None
    actor.begin(np.arange(len(seeds)), seeds)
    while running.any():
        action = actor.decide(batch.observation, running)
        ahead = np.empty((*ledger.ahead.shape[:2], batch.n_actions + 1))
        for number in range(batch.n_actions):
            batch.measure(REPEAT + number, running)
            ahead[..., number] = ledger.ahead[..., 1]
        batch.measure(ABSENT, running)
        ahead[..., -1] = ledger.ahead[..., 1]
        row, slot, features = _vehicles(batch, running)
        vehicles = batch.buffers.vehicles
        egos = batch.buffers.episodes["controlled"][:, 0]
        metres = ahead[row, vehicles["identity"][row, slot]]
        stays = ~np.isnan(metres).any(axis=1)
        row = row[stays]
        slot = slot[stays]
        features = features[stays]
        metres = metres[stays]
        in_zone = np.array([_ego_in_zone(batch, number) for number in range(batch.size)])
        vehicle = vehicles[row, slot].copy()
        ego = vehicles[row, egos[row]].copy()
        result = batch.step(action, auto_reset=False, rows=running)
        target = batch.buffers.after[row, batch.buffers.present[row, 1]]["target_speed"]
        yield Decision(
            episode=row,
            features=features,
            in_hand_zone=in_zone[row] & (features[:, 2] <= world.options.conflict_distance),
            metres=metres[:, :-1],
            absent=metres[:, -1],
            chosen=metres[np.arange(len(row)), action[row]],
            lost_actions=feasible_action_reduction(ego, target, vehicle),
            signals=result.signals,
            running=running,
        )
        running = running & (result.ending == 0)


def _vehicles(batch: RoadBatch, running: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return row, slot and `ROAD_FEATURES` of all vehicles but the ego that have not crashed."""
    vehicles = batch.buffers.vehicles
    episodes = batch.buffers.episodes
    assert batch.ledger is not None
    slots = np.arange(vehicles.shape[1])
    present = running[:, None] & (slots < episodes["vehicles"][:, None])
    present &= (slots != episodes["controlled"][:, :1]) & ~vehicles["crashed"]
    row, slot = np.nonzero(present)
    ego = vehicles[row, episodes["controlled"][row, 0]]
    vehicle = vehicles[row, slot]
    dx = vehicle["x"] - ego["x"]
    dy = vehicle["y"] - ego["y"]
    east = np.cos(ego["heading"])
    north = np.sin(ego["heading"])
    columns = (
        dx * east + dy * north,
        dy * east - dx * north,
        np.hypot(dx, dy),
        ego["speed"],
        vehicle["speed"],
        np.degrees(wrapped(vehicle["heading"] - ego["heading"])),
        batch.ledger.relation[row, vehicle["identity"]],
    )
    return row, slot, np.column_stack(columns)


def _ego_in_zone(batch: RoadBatch, row: int) -> bool:
    """Whether an ego is in the influence zone of Eq 4.2, by the default zone of a road."""
    ego = batch.buffers.vehicles[row, batch.buffers.episodes["controlled"][:, 0][row]]
    lane: Any = batch.lanes.view(np.recarray)[ego["lane"]]
    settings: Any = settings_of(batch.options).view(np.recarray)[0]
    along = longitudinal(lane, ego["x"], ego["y"])
    return bool(rewards.in_zone(lane.kind, along, lane.length, 0.0, settings))


def feasible_action_reduction(
    ego: np.ndarray, target: Float64[np.ndarray, " vehicle"], vehicle: np.ndarray
) -> Float64[np.ndarray, " vehicle"]:
    """Return the share of a vehicle's actions that the ego's action makes infeasible.

    FeAR (George et al. 2023, arXiv:2305.15003): feasible actions if the ego keeps its speed, less
    those if it takes its action, over the former. All drive straight on. An action of the vehicle
    is a constant acceleration; it is feasible without a contact within 3 s.

    Args:
        ego: Records of the egos, (vehicle,).
        target: Speed that the ego's action selects, reached in 1 s, m/s, (vehicle,).
        vehicle: Records of the vehicles, (vehicle,).
    """
    at_same_speed = ego["speed"][:, None] * _TIMES
    rising = np.minimum(_TIMES, 1.0)
    change = (target - ego["speed"])[:, None]
    with_action = at_same_speed + change * (rising**2 / 2 + np.maximum(_TIMES - 1.0, 0.0))
    speed = np.maximum(vehicle["speed"], 0.0)[:, None, None]
    driven, _ = ballistic(speed, _RATES[:, None], _TIMES)

    def feasible(metres: np.ndarray) -> np.ndarray:
        """Count the vehicle's actions without a contact, given the ego's metres by time."""
        dx, dy = (
            (vehicle[name] - ego[name])[:, None, None]
            + driven * along(vehicle["heading"])[:, None, None]
            - (metres * along(ego["heading"])[:, None])[:, None]
            for name, along in (("x", np.cos), ("y", np.sin))
        )
        headings = (record["heading"][:, None, None] for record in (ego, vehicle))
        return (overlap_depth(dx, dy, *headings, *_HALVES) <= 0).all(axis=2).sum(axis=1)

    before = feasible(at_same_speed)
    return (before - feasible(with_action)) / np.maximum(before, 1)


GRID_FEATURES = ("x_ego", "v_ego", "place", "speed")
"""Of a vehicle in a gridworld: cells, and cells per step."""


def grid_vehicles(
    table: Table,
) -> tuple[Int[np.ndarray, "vehicle feature"], Bool[np.ndarray, " vehicle"]]:
    """Return `GRID_FEATURES`, and whether a choice moves the vehicle, of all states' vehicles.

    A choice moves it if its next place hinges on the action, in some chance outcome.
    """
    columns = []
    moved = []
    number_of = {feature.name: number for number, feature in enumerate(table.world.features)}
    for slot in range(1, len(number_of) // 2):
        numbers = [number_of[name] for name in ("x_ego", "v_ego", f"y_{slot}", f"v_{slot}")]
        place = table.states[:, numbers[2]]
        after = place[table.mdp.successor]  # (state, action, chance)
        present = place >= 0
        moved.append((after != after[:, :1]).any(axis=(1, 2))[present])
        columns.append(table.states[present][:, numbers])
    return np.concatenate(columns), np.concatenate(moved)
