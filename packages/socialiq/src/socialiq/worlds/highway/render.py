"""Scenes of an episode, and pictures of them without rewards: one decision, and a filmstrip."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from socialiq.foreign import drawing
from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.highway import shapes
from socialiq.worlds.highway.batch import RoadBatch
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH
from socialiq.worlds.highway.options import SIGNALS
from socialiq.worlds.pictures import EGO, OTHER
from socialiq.worlds.road_users import MOVING, WAITING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from socialiq.worlds.highway.batch import RoadBatch

DPI = 100
"""Dots per inch of every picture."""


class Scene(NamedTuple):
    """Content of one picture."""

    vehicles: np.ndarray  # the vehicles present, records of the road
    ego: int  # index of the ego
    braking: np.ndarray  # whether each vehicle brakes because of the ego, bool, (vehicles,)
    # weighted contributions to the rewards of the decision so far, by name; those of
    # `SOCIAL_SIGNALS` belong to r_social, all others to r_env
    signals: Mapping[str, float]
    rewards: RewardPair  # the rewards of the decision so far
    time: float  # s since the reset
    caption: str  # A title
    people: np.ndarray = np.zeros(0)  # records of people who wait, walk or ride


class Frame(NamedTuple):
    """Visible part of the world, m; y grows to the south."""

    west: float
    east: float
    north: float
    south: float

    @property
    def ratio(self) -> float:
        """Height per width."""
        return (self.south - self.north) / (self.east - self.west)


@runtime_checkable
class View(Protocol):
    """Road as pictures show it."""

    # what the legend explains besides that of every road: "gives way", "obstacle"
    marks: tuple[str, ...]
    # place in m of the legend's first mark where the road leaves space for it; None puts the legend
    # above the picture
    corner: tuple[float, float] | None

    def ground(self, axes: Any) -> None:
        """Draw the empty road."""

    def frame(self, scene: Scene, strip: bool = False) -> Frame:
        """Return the part of the world that is visible in a picture; all have one size.

        Args:
            scene: Scene of the picture.
            strip: Whether the picture belongs to a filmstrip.
        """
        ...

    def way(self, axes: Any, scene: Scene) -> None:
        """Draw the ego's influence zone and the rest of its way.

        Args:
            axes: Axes to draw in.
            scene: Scene with the ego.
        """


def look(axes: Any, frame: Frame) -> None:
    """Show a part of the world in axes.

    Args:
        axes: Axes, which get equal scales with y growing downwards.
        frame: Part to show, m.
    """
    limits = {"xlim": (frame.west, frame.east), "ylim": (frame.south, frame.north)}
    axes.set(**limits, aspect="equal")


def traffic(axes: Any, scene: Scene, view: View) -> None:
    """Draw the ego's way and everybody in sight.

    Args:
        axes: Axes whose limits are set; vehicles outside of them are left out.
        scene: Scene to draw.
        view: Road of the scene.
    """
    view.way(axes, scene)
    for record in scene.people:
        pose = shapes.Pose(float(record["x"]), float(record["y"]), float(record["heading"]))
        shapes.person(axes, pose, float(record["length"]), float(record["width"]))
    west, east = axes.get_xlim()
    south, north = axes.get_ylim()
    margin = VEHICLE_LENGTH / 2
    for slot, record in enumerate(scene.vehicles):
        pose = shapes.Pose(float(record["x"]), float(record["y"]), float(record["heading"]))
        across = west - margin < pose.x < east + margin
        if not (across and north - margin < pose.y < south + margin):
            continue
        if record["crashed"]:
            shapes.burst(axes, pose)
        shapes.vehicle(axes, pose, EGO if slot == scene.ego else OTHER)
        if scene.braking[slot]:
            shapes.brake_lights(axes, pose)
        if "yielding" in (record.dtype.names or ()) and record["yielding"]:
            shapes.give_way(axes, *shapes.beside(pose, -2.2, 0.8, (1.7, 1.5)))
        speed = f"{float(record['speed']):.1f}"
        text = f"{speed} m/s" if slot == scene.ego else speed
        box = axes.get_position(original=True)
        paper = axes.figure.get_size_inches() * (box.width, box.height)
        metres = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
        per_metre = 72 * float((paper / metres).min())  # points on paper
        size = max(7.0, 1.9 * per_metre)
        tall = size / per_metre
        x, y = shapes.beside(pose, 1.2, 1.4, (0.31 * tall * len(text), 0.5 * tall))
        style = {"fontsize": size, "color": shapes.INK, "ha": "center", "va": "center"}
        axes.text(x, y, text, clip_on=True, zorder=9, **style)


def filmstrip(scenes: Sequence[Scene], view: View, captions: Sequence[str] | None = None) -> Figure:
    """Draw scenes as a row of pictures without rewards, three to a line, or one if they are wide.

    Args:
        scenes: Scenes in order; at least one.
        view: Road of the scenes.
        captions: Title of each picture; by default its time.
    """
    ratio = view.frame(scenes[0], strip=True).ratio
    wide, most = (3.0, 3) if ratio > _LOW else (7.5, 1)
    columns = min(most, len(scenes))
    rows = -(-len(scenes) // columns)
    high = round(wide * ratio + 0.2, 2)
    figure = drawing().Figure(figsize=(wide * columns, high * rows), layout="constrained", dpi=DPI)
    titles = captions or [f"t = {scene.time:.1f} s" for scene in scenes]
    for number, (scene, title) in enumerate(zip(scenes, titles, strict=True)):
        axes = figure.add_subplot(rows, columns, number + 1)
        axes.set_title(title, fontsize=10)
        axes.set_axis_off()
        view.ground(axes)
        look(axes, view.frame(scene, strip=True))
        traffic(axes, scene, view)
    return figure


_LOW = 0.6  # height per width below which a picture has a line of its own


def present_scene(batch: RoadBatch, row: int = 0) -> Scene:
    """Return the current scene of one episode, with the rewards of its last decision.

    Args:
        batch: Batch of the episode.
        row: Row of the episode.
    """
    buffers = batch.buffers
    episode = buffers.episodes[row]
    count = int(episode["vehicles"])
    ego = int(episode["controlled"][0])
    vehicles = buffers.vehicles[row, :count].copy()
    charged = buffers.after["identity"][row][buffers.braking[row]]
    time = float(episode["time"])
    braking = np.isin(vehicles["identity"], charged) & (time > 0)
    people = _there(buffers.people[row])
    return Scene(vehicles, ego, braking, *_rewards(batch, row, time > 0), time, "", people)


def decision_scenes(batch: RoadBatch, row: int = 0) -> Iterator[Scene]:
    """Yield the sub-steps of an episode's last decision.

    Args:
        batch: Batch of the episode; it must be `traced`.
        row: Row of the episode.

    Yields:
        A scene for each sub-step, each with the rewards of the whole decision.
    """
    buffers = batch.buffers
    count = int(buffers.present[row, 0])
    ego = int(buffers.present[row, 1])
    rewards = _rewards(batch, row, True)
    end = float(buffers.episodes[row]["time"])
    both = zip(buffers.trace[row], buffers.people_trace[row], strict=True)
    for frame, (vehicles, people) in enumerate(both):
        time = end - (len(buffers.trace[row]) - 1 - frame) / batch.options.simulation_frequency
        braking = buffers.braking[row, :count].copy()
        there = _there(people)
        yield Scene(vehicles[:count].copy(), ego, braking, *rewards, time, "", there)


def _there(people: np.ndarray) -> np.ndarray:
    """Return copies of the records of people who wait, walk or ride."""
    return people[np.isin(people["state"], (WAITING, MOVING))]


def _rewards(batch: RoadBatch, row: int, begun: bool) -> tuple[dict[str, float], RewardPair]:
    buffers = batch.buffers
    signals = {
        name: float(getattr(batch.options, f"{name}_weight") * value) if begun else 0.0
        for name, value in zip(SIGNALS, buffers.signals[row], strict=True)
    }
    return signals, RewardPair(*(buffers.rewards[row] * begun).tolist())


def episode_scenes(batch: RoadBatch, policy: Policy, seed: int) -> list[Scene]:
    """Run one episode, and return its scenes.

    Args:
        batch: A `traced` batch of one episode, which is reset.
        policy: Policy of the ego.
        seed: Seed of the episode.

    Returns:
        The start, then every sub-step; the caption of the last scene is the episode's ending.
    """
    batch.reset([seed])
    scenes = [present_scene(batch)]
    ending = Ending.NONE
    while ending == Ending.NONE:
        action, _ = policy.predict(batch.seen_by(policy))
        ending = Ending(int(batch.step(action, auto_reset=False).ending[0]))
        scenes += decision_scenes(batch)
    return [*scenes[:-1], scenes[-1]._replace(caption=ending.name.lower())]
