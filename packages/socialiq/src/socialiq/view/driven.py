"""Episodes of a policy in any world as traffic of the page: gridworlds, roads, recorded ones."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from socialiq.audit.evidence.drive import actor_of
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.evidence.replay import GRID_PER_SECOND, numbered
from socialiq.audit.request import Trust, resolve_policy
from socialiq.errors import UserError
from socialiq.evaluation.simulate import simulate
from socialiq.foreign import one_line
from socialiq.types import Ending, Policy
from socialiq.view import View
from socialiq.worlds.enumerate import GridBatch
from socialiq.worlds.highway import render, shapes
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH, VEHICLE_WIDTH
from socialiq.worlds.highway.network import LANE_WIDTH
from socialiq.worlds.intersection.core.geometry import LANES
from socialiq.worlds.registry import open_world
from socialiq.worlds.world import World

FIRST_ANGLE = 45.0
"""Angle of a dial at the start, degrees."""
EPISODES = 8
"""Episodes that are driven, seeds 1 ff."""
CHUNK = 100
"""Frames in a part that the page fetches."""
CELL = 4.0
"""Metres as which a cell of a gridworld is drawn."""


class Place(NamedTuple):
    """Place of a road user: m to the east and north, rad counter-clockwise from east, m/s, m."""

    x: float
    y: float
    heading: float
    speed: float
    length: float = VEHICLE_LENGTH
    width: float = VEHICLE_WIDTH


Frame = dict[int, Place]
"""Places by identity; that of the ego is `EGO`."""
EGO = -1


@runtime_checkable
class Placed(Protocol):
    """Batch of a road that this page drives, which says where its users are after a decision."""

    def places(self) -> Iterator[tuple[int, tuple[float, ...]]]:
        """Yield the identity and the values of a `Place` of each road user of the first row."""
        ...

    def ways(self) -> list[np.ndarray]:
        """Return the centre lines of its lanes, m to the east and north, each (point, 2)."""
        ...


class Episode(NamedTuple):
    """One episode."""

    frames: list[Frame]
    rewards: list[list[float]]  # (r_env, r_social) of each decision
    ending: Ending


def driven_view(spec: str, name: str, angle: float | None, trust: Trust) -> View:
    """Return episodes of a policy in a world, as `open_world` names it, as content of the page.

    A dial drives at the angle in degrees, by default `FIRST_ANGLE`.

    Raises:
        UserError: If the world is unknown, or the policy belongs to another one or is no dial.
    """
    world: Any = open_world(name)
    batch = GridBatch(world.table(), 1) if world.is_exact else world.batch(1, traced=True)
    chosen = FIRST_ANGLE if angle is None else angle
    with resolve_policy(spec, world, chosen, trust) as loaded:
        if angle is not None and not loaded.record.kind.endswith("dial"):
            raise UserError(f"--angle is of a dial, which {one_line(spec)} is not: leave it out")
        seeds = range(1, 1 + EPISODES)
        episodes = [_driven(world, batch, loaded.policy, seed) for seed in seeds]
    options: Any = getattr(batch, "options", None)
    rate = GRID_PER_SECOND
    if options is not None:
        placed = isinstance(batch, Placed)
        rate = options.policy_frequency if placed else options.simulation_frequency
    frames, data = _as_traffic(episodes)
    shown = one_line(spec if ":" in spec else Path(spec).name, 60)
    env, social = np.mean([np.sum(episode.rewards, axis=0) for episode in episodes], axis=0)
    edges = [
        (left.round(2).tolist(), right.round(2).tolist()) for left, right in _lanes(world, batch)
    ]
    return View(
        kind="traffic",
        title=f"{shown} in {one_line(Path(name).name, 60)}",
        lead=f"{EPISODES} episodes, seeds 1 to {EPISODES}, one after another. Their means: own "
        f"progress {env:.2f}, effect on others {social:.2f}.",
        data=data
        | {
            "dt": 1 / rate,
            "lanes": [{"left": left, "right": right} for left, right in edges],
            "around": not world.is_exact,  # whether the view follows the ego
        },
        count=math.ceil(len(frames) / CHUNK),
        part=lambda number: {"frames": frames[number * CHUNK : (number + 1) * CHUNK]},
    )


def _as_traffic(episodes: list[Episode]) -> tuple[list[list[Any]], dict[str, Any]]:
    """Return the frames of all episodes, one after another, and what the page knows of them."""
    frames = list[list[Any]]()
    users = list[dict[str, Any]]()
    drivers = list[dict[str, Any]]()
    for seed, episode in enumerate(episodes, 1):
        per = len(episode.frames) // len(episode.rewards)
        first = len(frames)
        tracks = dict[int, int]()
        for frame in episode.frames:
            for identity, place in frame.items():
                if identity not in tracks:
                    tracks[identity] = len(users)
                    size = {"length": place.length, "width": place.width}
                    users.append({"name": f"seed {seed}"} | size)
            rows = [[tracks[number], *place[:4]] for number, place in frame.items()]
            frames.append([[round(value, 3) for value in row] for row in rows])
        starts = [first + per * number for number in range(len(episode.rewards))]
        driver = {"track": tracks[EGO], "frames": [*starts, len(frames)]}
        driver |= {"rewards": episode.rewards, "ending": episode.ending.name.lower()}
        drivers.append(driver)
    data = {"frames": len(frames), "chunk": CHUNK, "users": users, "drivers": drivers}
    return frames, data | {"conflicts": [], "driven": True}


def _driven(world: World, batch: Any, policy: Policy, seed: int) -> Episode:
    actor = actor_of(world, batch, Reference("policy", policy), True)
    frames = list[Frame]()
    states = list[int]()
    rewards = list[list[float]]()
    ending = Ending.NONE
    for step in simulate(batch, actor, np.array([seed])):
        rewards.append([round(float(reward[0]), 4) for reward in step.made.rewards])
        ending = Ending(int(step.made.ending[0]))
        if world.is_exact:
            states.append(int(step.observation[0]))
        elif isinstance(batch, Placed):
            frames.append({number: Place(*place) for number, place in batch.places()})
        else:
            frames += [_of_scene(scene) for scene in render.decision_scenes(batch)]
    if states:
        table: Any = world.table()
        size = {"length": 0.74 * CELL, "width": 0.44 * CELL}
        for poses in numbered(table, states):
            frames.append({
                number or EGO: Place(CELL * x, -CELL * y, -math.radians(degrees), 0.0, **size)
                for number, (x, y, degrees) in poses.items()
            })  # fmt: skip
    return Episode(frames, rewards, ending)


def _of_scene(scene: render.Scene) -> Frame:
    """Return vehicles and people of a road of highway-env, whose y points south."""
    frame = {
        EGO if slot == scene.ego else int(record["identity"]): _place(record)
        for slot, record in enumerate(scene.vehicles)
    }
    for person in scene.people:
        size = {name: float(person[name]) for name in ("length", "width")}
        frame[int(person["identity"])] = _place(person)._replace(**size)
    return frame


def _place(record: Any) -> Place:
    x, y, heading, speed = (float(record[name]) for name in ("x", "y", "heading", "speed"))
    return Place(x, -y, -heading, speed)


def _lanes(world: Any, batch: Any) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield both bounds of each lane, m to the east and north."""
    if world.is_exact:
        size = world.size
        middle = -CELL * (size // 2)
        ends = CELL * np.array([-0.5, size - 0.5])
        line = np.stack([ends, np.full(2, middle)], axis=1)
        yield from (shapes.edges(way, CELL) for way in (line, -line[:, ::-1]))
        return
    south = np.array([1.0, 1.0 if isinstance(batch, Placed) else -1.0])
    if isinstance(batch, Placed):
        ways = batch.ways()
    else:
        road = getattr(world, "scene", None)
        ways = [shapes.way(lane) for lane in (LANES if road is None else road.road.lanes)]
    for way in ways:
        left, right = shapes.edges(way, LANE_WIDTH)
        yield south * left, south * right
