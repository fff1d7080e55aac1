"""Chosen episodes of the policy, run again one by one: the way of every vehicle, and films."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
from jaxtyping import Float32, Int64

from socialiq.audit.evidence.drive import actor_of
from socialiq.audit.evidence.outcomes import Evidence, Reference
from socialiq.audit.evidence.table import kind_of_ending
from socialiq.audit.profile.environment import LARGEST_SEED
from socialiq.errors import UserError
from socialiq.evaluation.simulate import GymActor, SoftPolicy, play, simulate
from socialiq.foreign import drawing
from socialiq.types import Files, Json, Memoryless, Policy, RewardPair, Row
from socialiq.worlds.catalogue import ROADS
from socialiq.worlds.enumerate import GridBatch, Table
from socialiq.worlds.highway import render, sheet
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.intersection.views import REACH
from socialiq.worlds.world import World

_SELECTED = 3

Chosen = Mapping[str, Sequence[Json]]
"""Rows of chosen episodes by "median" and "worst": the result of `selected`, or its JSON."""


def selected(evidence: Evidence, angle: float) -> dict[str, list[Row]]:
    """Return rows of the policy's median and worst episodes by R(α).

    Args:
        evidence: Evidence with the policy's episodes.
        angle: Angle α in degrees.

    Returns:
        At most three rows each by "median" and "worst", by rising R(α), and equal values in the
        order of the episodes. A row has the episode's number, seed (as text), rewards, R(α), ending
        and number of decisions.
    """
    policy = evidence.policy
    values = evidence.policy.values(angle)
    order = np.argsort(values, kind="stable")
    count = min(_SELECTED, len(order))
    first = (len(order) - count) // 2
    chosen = {"median": order[first : first + count], "worst": order[:count]}
    return {
        kind: [
            {
                "episode": episode,
                # Text, since many readers of JSON keep no more than 53 bits of a number.
                "seed": str(int(evidence.seeds[episode])),
                "r_env": float(policy.episodes.r_env[episode]),
                "r_social": float(policy.episodes.r_social[episode]),
                "value": float(values[episode]),
                "ending": kind_of_ending(policy, episode),
                "decisions": int(policy.episodes.length[episode]),
            }
            for episode in episodes.tolist()
        ]
        for kind, episodes in chosen.items()
    }


PER_SECOND = 5  # frames of a second on a road, fewer in episodes of more than `MOST_FRAMES`
MOST_FRAMES = 600

GRID_PER_SECOND = 2.0
"""Frames of a second in a gridworld, which has no unit of time: one for each step."""

_ROUNDING = 1e-9  # of an episode's sums of rewards

_NEAR = 1e-3
"""Largest difference of an episode's rewards where actions are continuous. Alone or among others, a
network's float32 sums differ in their last bits, and so do the actions and all that follows."""

SEEN = 1.3 * REACH  # m from the centre; vehicles further away are left out


class Pose(NamedTuple):
    """Place of a vehicle, in metres or cells to the east and south; degrees clockwise from east."""

    x: float
    y: float
    heading: float


@dataclass(frozen=True)
class Track:
    """Way of one vehicle."""

    ego: bool  # whether it is the vehicle that the policy drives
    crashed: bool  # whether it has collided at the end
    first: int  # number of its first frame
    poses: str  # "x y heading" of each frame from there on, divided by ";"


@dataclass(frozen=True)
class Trace:
    """Ways of all vehicles in one episode."""

    per_second: float  # frames
    frames: int
    tracks: tuple[Track, ...]  # way of each vehicle, the ego's first
    actions: str = ""  # decisions on a road where they are discrete, a digit each


class ReplayedEpisode(NamedTuple):
    """An episode that was run again: ways of the vehicles, number of decisions, sums of rewards.

    `near` is the largest difference of the totals of the same episode.
    """

    trace: Trace
    decisions: int
    totals: RewardPair
    near: float = _ROUNDING

    def repeats(self, decisions: int, totals: RewardPair) -> bool:
        """Whether it is the same episode as in the evidence.

        Args:
            decisions: Number of decisions in the evidence.
            totals: Sums of rewards in the evidence; they may differ by `near`.
        """
        near = (
            math.isclose(*pair, abs_tol=self.near) for pair in zip(self.totals, totals, strict=True)
        )
        return self.decisions == decisions and all(near)


def replayer(
    world: World, policy: Policy, deterministic: bool = True
) -> Callable[[int], ReplayedEpisode] | None:
    """Return a function that runs the episode of a seed again; None for other environments.

    A driver that answers a single observation otherwise than one among many, or that draws its
    actions in order, gives another episode than in the evidence (`ReplayedEpisode.repeats`).

    Args:
        world: World of the episodes.
        policy: The policy.
        deterministic: Whether it takes its best actions.

    Returns:
        A function of the seed of an episode; None for environments of other code.
    """
    road = road_of(world)
    if road is not None:
        return lambda seed: _on_road(road, policy, seed, deterministic)
    if not world.is_exact:
        return None
    batch = GridBatch(world.table(), 1)  # with the last states, from which none is reached

    def replay(seed: int) -> ReplayedEpisode:
        actor = actor_of(world, batch, Reference("policy", policy), deterministic)
        states = []
        totals = np.zeros(2)
        for step in simulate(batch, actor, np.array([seed])):
            states = states or [int(step.observation[0])]
            states.append(int(step.made.observation[0]))
            totals += [float(reward[0]) for reward in step.made.rewards]
        tracks = _tracks(numbered(batch.table, states), 0, set())
        trace = Trace(GRID_PER_SECOND, len(states), tracks)
        return ReplayedEpisode(trace, len(states) - 1, RewardPair(*totals.tolist()))

    return replay


class Road(NamedTuple):
    """Compiled road of a world.

    An audit drives the episodes of a scene of highway-env one by one, as those of any environment.
    """

    world: RoadWorld
    is_scene: bool

    def first_seed(self, seed: int) -> int:
        """Return the seed by which the episode of a seed begins."""
        return seed % LARGEST_SEED if self.is_scene else seed

    def as_asked(self, policy: Policy, deterministic: bool = True) -> Policy:
        """Return a policy for one episode, asked as it was for the evidence.

        Args:
            policy: The policy.
            deterministic: Whether it took its best actions.
        """
        soft = not deterministic and isinstance(policy, SoftPolicy)
        return _OneByOne(policy, deterministic) if self.is_scene and not soft else policy


def road_of(world: World) -> Road | None:
    """Return the compiled road of a world; None for gridworlds and environments of other code."""
    scene = getattr(world, "scene_world", None)
    if scene is not None:
        return Road(scene, True)
    return Road(cast(RoadWorld, world), False) if world.view is not None else None


class _OneByOne(Memoryless):
    """A policy that is asked about one observation at a time in an episode, as in environments."""

    def __init__(self, policy: Policy, deterministic: bool) -> None:
        self._actor = GymActor(policy, deterministic)
        self.n_features = getattr(policy, "n_features", None)

    def choose(
        self, observation: Float32[np.ndarray, "1 feature"], _deterministic: bool, /
    ) -> Int64[np.ndarray, " 1"]:
        """Return the policy's action in an array of one.

        Args:
            observation: A batch of one observation, shape (1, features).
        """
        return self._actor.decide([*observation], np.ones(1, np.bool_))


def _on_road(road: Road, policy: Policy, seed: int, deterministic: bool) -> ReplayedEpisode:
    world = road.world
    batch = world.batch(1, traced=True)
    continuous = world.action_size > 0
    recorded: list[render.Scene] = []
    totals = np.zeros(2)
    actions = ""
    decisions = 0
    driver = road.as_asked(policy, deterministic)
    seeds = np.array([road.first_seed(seed)])
    for step in play(batch, driver, seeds, deterministic):
        recorded += render.decision_scenes(batch)
        totals += [float(reward[0]) for reward in step.made.rewards]
        actions += "" if continuous else str(int(step.action[0]))
        decisions += 1
    rate = world.options.simulation_frequency
    within = math.inf if road.is_scene else SEEN
    every = max(1, rate // PER_SECOND, math.ceil(len(recorded) / MOST_FRAMES))
    chosen = [*recorded[:-1:every], recorded[-1]]
    frames = (
        {
            int(vehicle["identity"]): Pose(
                float(vehicle["x"]), float(vehicle["y"]), math.degrees(float(vehicle["heading"]))
            )
            for vehicle in scene.vehicles
            if max(abs(float(vehicle["x"])), abs(float(vehicle["y"]))) < within
        }
        for scene in chosen
    )
    last = chosen[-1].vehicles
    crashed = {int(vehicle["identity"]) for vehicle in last if vehicle["crashed"]}
    ego = int(last[chosen[-1].ego]["identity"])
    trace = Trace(rate / every, len(chosen), _tracks(frames, ego, crashed), actions)
    near = _NEAR if continuous else _ROUNDING
    return ReplayedEpisode(trace, decisions, RewardPair(*totals.tolist()), near)


def numbered(table: Table, states: list[int]) -> Iterator[dict[int, Pose]]:
    """Yield the poses of the vehicles in each state of a gridworld.

    Args:
        table: Table of the gridworld.
        states: Rows of the table, in the order of time.

    Yields:
        Poses by number of the vehicle; the ego is 0. A vehicle that enters a slot again has another
        number.
    """
    world = table.world
    height = table.world.size - 1
    before: dict[int, Pose] = {}
    numbers: dict[int, int] = {}
    following = len(world.features)
    for state in states:
        now = {
            vehicle.slot: Pose(float(vehicle.x), float(height - vehicle.y), -float(vehicle.heading))
            for vehicle in world.places(table.states[state].tolist())
        }
        for slot, pose in now.items():
            # x - y is how far it has come on its way east or north.
            again = slot not in before or pose.x - pose.y < before[slot].x - before[slot].y
            if again and slot != 0:
                numbers[slot] = following
                following = following + 1
        yield {numbers.get(slot, 0): pose for slot, pose in now.items()}
        before = now


def _tracks(frames: Iterable[dict[int, Pose]], ego: int, crashed: set[int]) -> tuple[Track, ...]:
    """Return the way of each vehicle, as far as it has no gaps; the ego's first."""
    ways: dict[int, tuple[int, list[Pose]]] = {}
    for number, frame in enumerate(frames):
        for identity, pose in frame.items():
            first, poses = ways.setdefault(identity, (number, []))
            if len(poses) == number - first:  # it has not been away
                poses.append(pose)
    tracks = []
    for vehicle in sorted(ways, key=lambda vehicle: (vehicle != ego, vehicle)):
        first, poses = ways[vehicle]
        headings = np.unwrap([pose.heading for pose in poses], period=360.0)
        text = ";".join(
            f"{round(pose.x, 1) + 0.0:g} {round(pose.y, 1) + 0.0:g} {round(turned)}"
            for pose, turned in zip(poses, headings.tolist(), strict=True)
        )
        tracks.append(Track(vehicle == ego, vehicle in crashed, first, text))
    return tuple(tracks)


Traces = Mapping[str, Sequence[Trace | Json | None]]
"""Traces of the chosen episodes, or their JSON, by "median" and "worst"."""


def traces_of(
    world: World,
    policy: Policy,
    chosen: Chosen,
    deterministic: bool = True,
) -> Traces:
    """Run the episodes of `selected` again, one by one, and return the ways of all vehicles.

    Args:
        world: World of the episodes.
        policy: The policy.
        chosen: Result of `selected`.
        deterministic: Whether the policy takes its best actions.

    Returns:
        A trace for each row by "median" and "worst". It is None where the policy drives another
        episode than in the evidence, and in an environment.
    """
    again = replayer(world, policy, deterministic)

    def traced(row: Json) -> Trace | None:
        if again is None:
            return None
        played = again(int(row["seed"]))
        same = played.repeats(row["decisions"], RewardPair(row["r_env"], row["r_social"]))
        return played.trace if same else None

    return {kind: [traced(row) for row in rows] for kind, rows in chosen.items()}


def path_of(kind: str, number: int) -> str:
    """Return the path of a film in the report's folder.

    Args:
        kind: "median" or "worst".
        number: Number of the episode of this kind, from 1.
    """
    return f"episodes/{kind}-{number}.gif"


def check_filmed(world: World) -> Road:
    """Return the road of a world; `UserError` if it is no road, so that films can't be drawn."""
    road = road_of(world)
    if road is None:
        roads = ", ".join(ROADS)
        raise UserError(f"films are drawn of roads alone ({roads}): leave out --films")
    drawing()
    return road


def films_of(world: World, policy: Policy, chosen: Chosen) -> Files:
    """Run the episodes of `selected` again with the policy's best actions, and draw them.

    Args:
        world: World of the episodes.
        policy: The policy.
        chosen: Result of `selected`.

    Returns:
        GIF files by path in the report's folder.

    Raises:
        UserError: If the world is no road of highway-env.
    """
    films = {}
    road = check_filmed(world)
    # Every sub-step would take three times as long to draw.
    every = max(1, road.world.options.simulation_frequency // PER_SECOND)
    batch = road.world.batch(1, traced=True)
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder) / "film.gif"
        for kind, rows in chosen.items():
            for number, row in enumerate(rows, 1):
                seed = road.first_seed(int(row["seed"]))
                played = render.episode_scenes(batch, road.as_asked(policy), seed)
                frames = [*played[:-1:every], played[-1]]
                sheet.save(film, frames, road.world.view, PER_SECOND)
                films[path_of(kind, number)] = film.read_bytes()
    return films
