"""Scenes of an episode, and pictures of them without rewards: one decision, and a filmstrip."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from socialiq.foreign import drawing
from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.highway import shapes
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH
from socialiq.worlds.highway.options import SIGNALS, WAITING, WALKING
from socialiq.worlds.highway.world import RoadBatch
from socialiq.worlds.pictures import EGO, OTHER

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
        """Return what is visible of a scene, in a filmstrip if `strip`; of one size in all."""
        ...

    def way(self, axes: Any, scene: Scene) -> None:
        """Draw the ego's influence zone and the rest of its way."""


def look(axes: Any, frame: Frame) -> None:
    """Show a part of the world in axes."""
    limits = {"xlim": (frame.west, frame.east), "ylim": (frame.south, frame.north)}
    axes.set(**limits, aspect="equal")


def traffic(axes: Any, scene: Scene, view: View) -> None:
    """Draw the ego's way and everybody in sight."""
    view.way(axes, scene)
    for record in scene.people:
        pose = shapes.Pose(float(record["x"]), float(record["y"]), float(record["heading"]))
        shapes.person(axes, pose, bool(record["lane"]))
    (west, east), (south, north), margin = axes.get_xlim(), axes.get_ylim(), VEHICLE_LENGTH / 2
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

    By default the title of a picture is its time.
    """
    ratio = view.frame(scenes[0], strip=True).ratio
    wide, most = (3.0, 3) if ratio > _LOW else (7.5, 1)
    columns = min(most, len(scenes))
    rows, high = -(-len(scenes) // columns), round(wide * ratio + 0.2, 2)
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
    """Return the current scene of one episode, with the rewards of its last decision."""
    buffers = batch.buffers
    episode = buffers.episodes[row]
    count, ego = int(episode["vehicles"]), int(episode["controlled"][0])
    vehicles = buffers.vehicles[row, :count].copy()
    charged = buffers.after["identity"][row][buffers.braking[row]]
    time = float(episode["time"])
    braking = np.isin(vehicles["identity"], charged) & (time > 0)
    people = _people(batch, buffers.vehicles[row])
    return Scene(vehicles, ego, braking, *_rewards(batch, row, time > 0), time, "", people)


def decision_scenes(batch: RoadBatch, row: int = 0) -> Iterator[Scene]:
    """Return the sub-steps of an episode's last decision; the batch must be `traced`."""
    buffers = batch.buffers
    count, ego = int(buffers.present[row, 0]), int(buffers.present[row, 1])
    rewards = _rewards(batch, row, True)
    end = float(buffers.episodes[row]["time"])
    for frame, vehicles in enumerate(buffers.trace[row]):
        time = end - (len(buffers.trace[row]) - 1 - frame) / batch.options.simulation_frequency
        braking = buffers.braking[row, :count].copy()
        people = _people(batch, vehicles)
        yield Scene(vehicles[:count].copy(), ego, braking, *rewards, time, "", people)


def _people(batch: RoadBatch, records: np.ndarray) -> np.ndarray:
    """Return the records of people who are there, of the records of an episode."""
    people = records[getattr(batch.options, "first_walker", len(records)) :]
    return people[np.isin(people["leg"], (WAITING, WALKING))] if len(people) else people


def _rewards(batch: RoadBatch, row: int, begun: bool) -> tuple[dict[str, float], RewardPair]:
    buffers = batch.buffers
    signals = {
        name: float(getattr(batch.options, f"{name}_weight") * value) if begun else 0.0
        for name, value in zip(SIGNALS, buffers.signals[row], strict=True)
    }
    return signals, RewardPair(*(buffers.rewards[row] * begun).tolist())


def episode_scenes(batch: RoadBatch, policy: Policy, seed: int) -> list[Scene]:
    """Run the episode of a seed in a `traced` batch of one; return its start and every sub-step."""
    batch.reset([seed])
    scenes, ending = [present_scene(batch)], Ending.NONE
    while ending == Ending.NONE:
        action, _ = policy.predict(batch.seen_by(policy))
        ending = Ending(int(batch.step(action, auto_reset=False).ending[0]))
        scenes += decision_scenes(batch)
    return [*scenes[:-1], scenes[-1]._replace(caption=ending.name.lower())]
