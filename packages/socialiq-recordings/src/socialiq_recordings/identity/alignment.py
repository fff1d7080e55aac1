"""Rigid alignment of the lanes of two recordings, whatever frame each is written in.

Turns are proposed by the circular correlation of the histograms of lane directions, shifts by a
vote of all pairs of points with the same direction; both are refined by iterated closest points
with the distance to the line (Chen and Medioni 1992).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.spatial import KDTree

from socialiq_recordings.recording import Recording
from socialiq_recordings.road.network import STEP, RoadNetwork, every_step, lanelet_points

BESIDE = 0.5
"""m; points of one line lie at most this far beside those of the other. Maps of one site that were
drawn twice differ by less; lanes lie 3 m apart."""

_BESIDE_PATH = 1.5  # m; paths of vehicles scatter within their lane
_TURNED = np.radians(8.0)
_PROPOSALS = 4  # turns
_MOST_VOTES = 500  # points of a shape that vote
_REACHES = (3.0, 2.0, 1.0, 1.0)  # m; largest distance of a pair, by iteration
_ALIKE = 0.9  # share from which no better placement is looked for
_STRAIGHT = 0.02  # smallest share of directions across the main one that fixes a shift


@dataclass(frozen=True, eq=False)
class Shape:
    """Lines of a recording.

    Attributes:
        points: x, y in m and direction in rad, every `STEP` metres.
        of_road: Whether they are centre lines of lanelets; else paths of vehicles.
    """

    points: Float64[np.ndarray, "point 3"]
    of_road: bool


@dataclass(frozen=True, eq=False)
class Placement:
    """Rigid motion from one frame to another.

    Attributes:
        turn: rad, about the origin.
        shift: m, after the turn.
    """

    turn: float
    shift: Float64[np.ndarray, " 2"]

    def of(self, points: Float64[np.ndarray, "point 3"]) -> Float64[np.ndarray, "point 3"]:
        """Return x, y and direction in the other frame."""
        return np.column_stack(
            [points[:, :2] @ self._matrix.T + self.shift, points[:, 2:] + self.turn]
        )

    def back(self, points: Float64[np.ndarray, "point 3"]) -> Float64[np.ndarray, "point 3"]:
        """Return the points of the other frame in the first."""
        moved = (points[:, :2] - self.shift) @ self._matrix
        return np.column_stack([moved, points[:, 2:] - self.turn])

    @property
    def _matrix(self) -> np.ndarray:
        cos, sin = np.cos(self.turn), np.sin(self.turn)
        return np.array([[cos, -sin], [sin, cos]])


SAME_FRAME = Placement(0.0, np.zeros(2))


def shape_of(recording: Recording) -> Shape:
    """Return the centre lines of a recording's lanelets, or the paths of its tracks without any."""
    if recording.road.lanelets:
        return Shape(_of_road(recording.road), True)
    tracks = recording.tracks
    lines = np.split(np.column_stack([tracks.x, tracks.y]), tracks.starts[1:-1])
    points = np.concatenate([np.zeros((0, 3)), *(every_step(line) for line in lines)])
    # One point for each place and direction, however many vehicles passed it.
    cells = np.round(points / np.array([STEP, STEP, np.pi / 6])).astype(np.int64)
    return Shape(points[np.unique(cells, axis=0, return_index=True)[1]], False)


def _of_road(road: RoadNetwork) -> np.ndarray:
    lines = [lanelet_points(lanelet) for lanelet in road.lanelets.values()]
    return np.concatenate([np.zeros((0, 3)), *lines])


def shared(one: Shape, other: Shape) -> float:
    """Return the share of the smaller shape's points that lie on the other, best aligned.

    Shapes that are straight fit everywhere along themselves, and paths of vehicles scatter: both
    are compared in the frames that they are written in.
    """
    if not len(one.points) or not len(other.points):
        return 0.0
    beside = BESIDE if one.of_road and other.of_road else _BESIDE_PATH
    best = overlap(one.points, other.points, SAME_FRAME, beside)
    if best > _ALIKE or not (one.of_road and other.of_road):
        return best
    if min(_bends(one.points), _bends(other.points)) < _STRAIGHT:
        return best
    for turn in _turns(one, other):
        placement = _placed(one.points, other.points, turn)
        best = max(best, overlap(one.points, other.points, placement, beside))
        if best > _ALIKE:
            break
    return best


def overlap(
    one: Float64[np.ndarray, "point 3"],
    other: Float64[np.ndarray, "other 3"],
    placement: Placement,
    beside: float = BESIDE,
) -> float:
    """Return the larger of the two shares of points that lie on the other shape.

    Args:
        one: Points of the one.
        other: Points of the other.
        placement: From the other's frame to the one's.
        beside: m; largest distance from the other's line.
    """
    there = _on(placement.of(other), one, beside)
    return max(there, _on(placement.back(one), other, beside))


def _on(points: np.ndarray, lines: np.ndarray, beside: float) -> float:
    distance, nearest = KDTree(lines[:, :2]).query(points[:, :2], k=min(4, len(lines)))
    distance, nearest = distance.reshape(len(points), -1), nearest.reshape(len(points), -1)
    near = lines[nearest]
    apart = points[:, None, :2] - near[..., :2]
    lateral = apart[..., 1] * np.cos(near[..., 2]) - apart[..., 0] * np.sin(near[..., 2])
    turned = np.abs(_wrapped(points[:, None, 2] - near[..., 2])) < _TURNED
    match = (distance < 1.25 * STEP) & (np.abs(lateral) < beside) & turned
    return float(match.any(axis=1).mean())


def _bends(points: np.ndarray) -> float:
    """Return the smaller principal share of the lines' directions; 0 for parallel lines."""
    along = np.column_stack([np.cos(points[:, 2]), np.sin(points[:, 2])])
    return float(np.linalg.eigvalsh(along.T @ along / len(along))[0])


def _turns(one: Shape, other: Shape) -> list[float]:
    """Return proposals of the turn from the other's frame, rad: none, and the best correlations."""
    kernel = np.exp(-0.5 * (np.minimum(np.arange(360), 360 - np.arange(360)) / 1.5) ** 2)
    spectra = [np.fft.fft(_histogram(shape)) * np.fft.fft(kernel) for shape in (one, other)]
    correlation = np.real(np.fft.ifft(spectra[0] * np.conj(spectra[1])))
    turns = [0.0]
    for _ in range(_PROPOSALS):
        best = int(np.argmax(correlation))
        turns.append(np.radians(best))
        correlation[np.arange(best - 4, best + 5) % 360] = -np.inf
    return turns


def _histogram(shape: Shape) -> np.ndarray:
    degrees = np.floor(np.degrees(shape.points[:, 2]) % 360).astype(np.int64) % 360
    return np.bincount(degrees, minlength=360).astype(np.float64)


def _placed(one: np.ndarray, other: np.ndarray, turn: float) -> Placement:
    """Return the placement of the other's points on the one's with about this turn."""
    turned = Placement(turn, np.zeros(2)).of(other)
    few, voters = (points[:: 1 + len(points) // _MOST_VOTES] for points in (one, turned))
    same = np.abs(_wrapped(few[:, None, 2] - voters[None, :, 2])) < _TURNED / 2
    first, second = np.nonzero(same)
    if not len(first):
        return Placement(turn, np.zeros(2))
    votes = np.round((few[first, :2] - voters[second, :2]) / (STEP / 2)).astype(np.int64)
    low = votes.min(axis=0)
    width = int(np.ptp(votes[:, 1])) + 1
    cells, count = np.unique((votes - low) @ np.array([width, 1]), return_counts=True)
    most = np.array(divmod(int(cells[np.argmax(count)]), width)) + low
    return _refined(one, other, Placement(turn, most * (STEP / 2)))


def _refined(one: np.ndarray, other: np.ndarray, placement: Placement) -> Placement:
    tree = KDTree(one[:, :2])
    for reach in _REACHES:
        moved = placement.of(other)
        distance, nearest = tree.query(moved[:, :2])
        line = one[nearest]
        use = (distance < reach) & (np.abs(_wrapped(line[:, 2] - moved[:, 2])) < _TURNED)
        if use.sum() < 5:
            return placement
        moved, line = moved[use], line[use]
        across = np.column_stack([-np.sin(line[:, 2]), np.cos(line[:, 2])])
        arm = moved[:, :2] - moved[:, :2].mean(axis=0)
        matrix = np.column_stack([across, arm[:, 0] * across[:, 1] - arm[:, 1] * across[:, 0]])
        off = ((line[:, :2] - moved[:, :2]) * across).sum(axis=1)
        *step, turn = np.linalg.lstsq(matrix, off, rcond=None)[0]
        # The turn is about the middle of the pairs.
        middle = moved[:, :2].mean(axis=0)
        about = Placement(float(turn), np.zeros(2))
        shift = about.of(np.array([[*(placement.shift - middle), 0.0]]))[0, :2] + middle
        placement = Placement(placement.turn + float(turn), shift + np.array(step))
    return placement


def _wrapped(angle: np.ndarray) -> np.ndarray:
    return np.mod(angle + np.pi, 2 * np.pi) - np.pi
