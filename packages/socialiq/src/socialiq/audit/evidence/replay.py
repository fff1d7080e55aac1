"""Chosen episodes of the policy, run again one by one, with the way of every vehicle."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
from jaxtyping import Float32, Int64

from socialiq.audit.evidence.drive import actor_of
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.profile.environment import LARGEST_SEED
from socialiq.evaluation.simulate import GymActor, SoftPolicy, play, simulate
from socialiq.types import Policy, RewardPair
from socialiq.worlds.enumerate import GridBatch, Table
from socialiq.worlds.highway import render
from socialiq.worlds.highway.render import Scene
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.intersection.views import REACH
from socialiq.worlds.world import World

PER_SECOND = 5
"""Frames of a second on a road, fewer in episodes of more than `MOST_FRAMES`."""

MOST_FRAMES = 600

GRID_PER_SECOND = 2.0
"""Frames of a second in a gridworld, which has no unit of time: one for each step."""

_ROUNDING = 1e-9  # of an episode's sums of rewards

_NEAR = 1e-3
"""Largest difference of an episode's rewards where actions are continuous. Alone or among others, a
network's float32 sums differ in their last bits, and so do the actions and all that follows."""

SEEN = 1.3 * REACH  # m from the centre; vehicles further away are left out


class Pose(NamedTuple):
    """Place and heading of a vehicle in one frame.

    Attributes:
        x: Metres or cells to the east.
        y: Metres or cells to the south.
        heading: Degrees clockwise from east.
    """

    x: float
    y: float
    heading: float


@dataclass(frozen=True)
class Track:
    """Way of one vehicle.

    Attributes:
        ego: Whether it is the vehicle that the policy drives.
        crashed: Whether it has collided at the end.
        first: Number of its first frame.
        poses: "x y heading" of each frame from there on, divided by ";".
    """

    ego: bool
    crashed: bool
    first: int
    poses: str


@dataclass(frozen=True)
class Trace:
    """Ways of all vehicles in one episode.

    Attributes:
        per_second: Frames of a second.
        frames: Number of frames.
        tracks: Way of each vehicle, the ego's first.
        actions: Decisions on a road, a digit each; "" in a gridworld, and where actions are
            continuous.
    """

    per_second: float
    frames: int
    tracks: tuple[Track, ...]
    actions: str = ""


class ReplayedEpisode(NamedTuple):
    """An episode that was run again: its trace, decisions and sums of rewards.

    Attributes:
        trace: Ways of the vehicles.
        decisions: Number of decisions.
        totals: Sums of the rewards.
        near: Largest difference of the totals of the same episode.
    """

    trace: Trace
    decisions: int
    totals: RewardPair
    near: float = _ROUNDING

    def repeats(self, decisions: int, totals: RewardPair) -> bool:
        """Whether it is the same episode as in the evidence."""
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
        world: World of the declaration.
        policy: The policy under audit.
        deterministic: Whether it takes its best actions.
    """
    road = road_of(world)
    if road is not None:
        return lambda seed: _on_road(road, policy, seed, deterministic)
    if world.is_exact:
        return _grid_replayer(world, policy, deterministic)
    return None


class Road(NamedTuple):
    """Compiled road of a world.

    Attributes:
        world: The road.
        is_scene: Whether it is a scene of highway-env, whose episodes an audit drives one by one
            as those of any environment.
    """

    world: RoadWorld
    is_scene: bool

    def first_seed(self, seed: int) -> int:
        """Return the seed by which the episode of a seed begins."""
        return seed % LARGEST_SEED if self.is_scene else seed

    def as_asked(self, policy: Policy, deterministic: bool = True) -> Policy:
        """Return a policy for one episode, asked as it was for the evidence."""
        soft = not deterministic and isinstance(policy, SoftPolicy)
        return _OneByOne(policy, deterministic) if self.is_scene and not soft else policy


def road_of(world: World) -> Road | None:
    """Return the compiled road of a world; None for gridworlds and environments of other code."""
    scene = getattr(world, "scene_world", None)
    if scene is not None:
        return Road(scene, True)
    return Road(cast(RoadWorld, world), False) if world.view is not None else None


class _OneByOne:
    """A policy that is asked about one observation at a time, as in environments, for an episode.

    Args:
        policy: The policy.
        deterministic: Whether it takes its best actions.
    """

    def __init__(self, policy: Policy, deterministic: bool) -> None:
        self._actor = GymActor(policy, deterministic)
        self.n_features = getattr(policy, "n_features", None)

    def predict(
        self,
        observation: Float32[np.ndarray, "1 feature"],
        state: Any = None,
        episode_start: np.ndarray | None = None,  # noqa: ARG002  part of the protocol
        deterministic: bool = True,  # noqa: ARG002  the actor knows
    ) -> tuple[Int64[np.ndarray, " 1"], Any]:
        """Return the policy's action in an array of one."""
        return self._actor.decide([*observation], np.ones(1, np.bool_)), state


def _on_road(road: Road, policy: Policy, seed: int, deterministic: bool) -> ReplayedEpisode:
    world = road.world
    batch, continuous = world.batch(1, traced=True), world.action_size > 0
    recorded: list[Scene] = []
    totals, actions, decisions = np.zeros(2), "", 0
    driver, seeds = road.as_asked(policy, deterministic), np.array([road.first_seed(seed)])
    for step in play(batch, driver, seeds, deterministic):
        recorded += render.decision_scenes(batch)
        totals += [float(reward[0]) for reward in step.made.rewards]
        actions += "" if continuous else str(int(step.action[0]))
        decisions += 1
    rate = world.options.simulation_frequency
    every = max(1, rate // PER_SECOND, math.ceil(len(recorded) / MOST_FRAMES))
    chosen = [*recorded[:-1:every], recorded[-1]]
    tracks = _joined(_poses_of(frame, math.inf if road.is_scene else SEEN) for frame in chosen)
    last = chosen[-1].vehicles
    crashed = {int(vehicle["identity"]) for vehicle in last if vehicle["crashed"]}
    ego = int(last[chosen[-1].ego]["identity"])
    trace = Trace(rate / every, len(chosen), _tracks(tracks, ego, crashed), actions)
    near = _NEAR if continuous else _ROUNDING
    return ReplayedEpisode(trace, decisions, RewardPair(*totals.tolist()), near)


def _poses_of(scene: Scene, within: float) -> dict[int, Pose]:
    """Return the poses of the vehicles less than so many metres from the centre, by identity."""
    return {
        int(vehicle["identity"]): Pose(
            float(vehicle["x"]), float(vehicle["y"]), math.degrees(float(vehicle["heading"]))
        )
        for vehicle in scene.vehicles
        if max(abs(float(vehicle["x"])), abs(float(vehicle["y"]))) < within
    }


def _grid_replayer(
    world: World, policy: Policy, deterministic: bool
) -> Callable[[int], ReplayedEpisode]:
    batch = GridBatch(world.table(), 1)  # with the last states, from which none is reached

    def replay(seed: int) -> ReplayedEpisode:
        actor = actor_of(world, batch, Reference("policy", policy), deterministic)
        states, totals = [], np.zeros(2)
        for step in simulate(batch, actor, np.array([seed])):
            states = states or [int(step.observation[0])]
            states.append(int(step.made.state[0]))
            totals += [float(reward[0]) for reward in step.made.rewards]
        tracks = _joined(_numbered(batch.table, states))
        trace = Trace(GRID_PER_SECOND, len(states), _tracks(tracks, 0, set()))
        return ReplayedEpisode(trace, len(states) - 1, RewardPair(*totals.tolist()))

    return replay


def _numbered(table: Table, states: list[int]) -> Iterator[dict[int, Pose]]:
    """Yield the poses in each state; a vehicle that enters a slot again has another number."""
    world, height = table.world, table.world.size - 1
    before: dict[int, Pose] = {}
    numbers: dict[int, int] = {}
    following = len(world.features)
    for state in states:
        now = {
            vehicle.slot: Pose(float(vehicle.x), float(height - vehicle.y), -float(vehicle.heading))
            for vehicle in world.places(table.states[state].tolist())
        }
        for slot, pose in now.items():
            again = slot not in before or _along(pose) < _along(before[slot])
            if again and slot != 0:
                numbers[slot], following = following, following + 1
        yield {numbers.get(slot, 0): pose for slot, pose in now.items()}
        before = now


def _along(pose: Pose) -> float:
    """Return how far a vehicle has come on its way east or north."""
    return pose.x - pose.y


def _joined(frames: Iterable[dict[int, Pose]]) -> dict[int, tuple[int, list[Pose]]]:
    """Return the first frame and the poses of each vehicle."""
    ways: dict[int, tuple[int, list[Pose]]] = {}
    for number, frame in enumerate(frames):
        for identity, pose in frame.items():
            first, poses = ways.setdefault(identity, (number, []))
            if len(poses) == number - first:  # without gaps: it has not been away
                poses.append(pose)
    return ways


def _tracks(
    ways: dict[int, tuple[int, list[Pose]]], ego: int, crashed: set[int]
) -> tuple[Track, ...]:
    order = sorted(ways, key=lambda vehicle: (vehicle != ego, vehicle))
    return tuple(
        Track(vehicle == ego, vehicle in crashed, ways[vehicle][0], _text(ways[vehicle][1]))
        for vehicle in order
    )


def _text(poses: list[Pose]) -> str:
    headings = np.unwrap([pose.heading for pose in poses], period=360.0)
    return ";".join(
        f"{round(pose.x, 1) + 0.0:g} {round(pose.y, 1) + 0.0:g} {round(turned)}"
        for pose, turned in zip(poses, headings.tolist(), strict=True)
    )
