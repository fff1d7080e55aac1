"""Attainable reward pairs of a horizon: the convex polygon and its Pareto front (thesis 4.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from socialiq.errors import UserError
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.mdp.tabular import TabularMDP
from socialiq.physics import wrapped
from socialiq.types import RewardPair

# Relative to the largest coordinate: far above the rounding of backward induction (1e-14).
_TOLERANCE = 1e-9
# Two policies whose scores differ by less than rounding are equally good.
_TIE = 1e-12
# In degrees; wider than the rounding of an edge's normal, narrower than any grid of angles.
_ANGLE_TOLERANCE = 1e-7


class Optimum(NamedTuple):
    """Best attainable pair for an angle."""

    vertex: int  # row of the pair in `AttainableSet.vertices`
    point: RewardPair  # expected sums (E Σ r_env, E Σ r_social)
    value: float  # J*(α) = cos α · point.env + sin α · point.social


@dataclass(frozen=True, eq=False)
class AttainableSet:
    """Set of (E Σ r_env, E Σ r_social) of all time-aware randomised policies: a convex polygon.

    It may degenerate to a segment (two vertices) or a point (one vertex).
    """

    # extreme points, counter-clockwise, the best one for r_env first; each is attained by a
    # deterministic policy
    vertices: Float[np.ndarray, "vertex 2"]

    @property
    def scale(self) -> float:
        """Largest absolute coordinate of the set. Tolerances are relative to it."""
        return float(np.abs(self.vertices).max())

    def front(self) -> Float[np.ndarray, "front 2"]:
        """Return the Pareto-optimal vertices, from egoistic to altruistic.

        They are the vertices that are optimal for an angle strictly between 0 and 90 degrees. A
        vertex that ties at 0 or 90 degrees only is dominated, and omitted.
        """
        spans = [self.supporting_interval(vertex) for vertex in range(len(self.vertices))]
        efficient = [
            (low, vertex)
            for vertex, (low, high) in enumerate(spans)
            if low < 90.0 - _ANGLE_TOLERANCE and high > _ANGLE_TOLERANCE
        ]
        return self.vertices[[vertex for _, vertex in sorted(efficient)]]

    def optimum(self, angle: float) -> Optimum:
        """Return the best vertex for R(α) of Eq 4.3, α in degrees.

        Of vertices that tie, it is the one with the larger sum, at 0 and 90 degrees Pareto-optimal.
        """
        values = self.vertices @ direction(angle)
        tied = values >= values.max() - _TIE * self.scale
        vertex = int(np.where(tied, self.vertices.sum(axis=1), -np.inf).argmax())
        return Optimum(vertex, RewardPair(*map(float, self.vertices[vertex])), float(values.max()))

    def supporting_interval(self, vertex: int) -> tuple[float, float]:
        """Return the interval of angles in degrees at which a vertex is optimal.

        Its low end is in [-180, 180); its high end may exceed 180. A single point: (-180, 180).
        """
        if len(self.vertices) == 1:
            return -180.0, 180.0
        before, after = self._edges()[[vertex - 1, vertex]]
        low, high = (np.degrees(np.arctan2(-edge[0], edge[1])) for edge in (before, after))
        low = wrapped(low, 180.0)
        return float(low), float(low + (high - low) % 360.0)

    def radius(self, angle: float) -> float:
        """Return the largest r >= 0 for which r (cos, sin) of an angle in degrees is attainable.

        It is 0 if the ray meets the set in the origin only.

        Raises:
            UserError: If the ray does not meet the set: no policy has this angle.
        """
        ray = direction(angle)
        normals, offsets = self._half_planes()
        slack = _TIE * self.scale
        slopes = normals @ ray
        level = np.abs(slopes) <= _TIE
        with np.errstate(divide="ignore", invalid="ignore"):
            limits = offsets / slopes
        longest = limits[~level & (slopes > 0.0)].min(initial=np.inf)
        shortest = limits[~level & (slopes < 0.0)].max(initial=0.0)
        if (offsets[level] < -slack).any() or longest < shortest - slack:
            raise UserError(f"no policy's expected sums lie at {angle:g} degrees: choose another")
        return float(max(longest, 0.0))

    def contains(self, point: RewardPair, tolerance: float = _TOLERANCE) -> bool:
        """Whether some policy has these expected sums.

        Args:
            point: (E Σ r_env, E Σ r_social).
            tolerance: Distance that is allowed outside, relative to the set's largest coordinate.
        """
        normals, offsets = self._half_planes()
        outside = normals @ np.array([point.env, point.social], np.float64) - offsets
        return bool((outside <= tolerance * self.scale).all())

    def _edges(self) -> Float[np.ndarray, "vertex 2"]:
        return np.roll(self.vertices, -1, axis=0) - self.vertices

    def _half_planes(self) -> tuple[Float[np.ndarray, "side 2"], Float[np.ndarray, " side"]]:
        """Return unit outward normals and offsets of half-planes whose intersection is the set."""
        edges = self._edges()
        if len(edges) == 1:
            edges = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
        if len(self.vertices) == 2:
            # A segment's two edges bound its line; its ends need a normal each.
            normals = np.concatenate([normals, edges])
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        return normals, (normals @ self.vertices.T).max(axis=1)


def attainable_set(
    mdp: TabularMDP, horizon: int, allowed: Bool[np.ndarray, "*time state action"] | None = None
) -> AttainableSet:
    """Compute all vertices of the attainable set of a finite horizon.

    The method is dichotomic search (Cohon 1978; Roijers et al. 2015). It starts from the extreme
    points of four directions. The optimum for the normal of the chord between two neighbours
    either lies beyond the chord, or proves that the chord is an edge.
    A vertex counts if it lies more than 1e-9 of the largest coordinate beyond its neighbours.
    `allowed` restricts the actions as in `horizon_optimum`.

    Raises:
        UserError: If the horizon is not positive, or `allowed` has another shape.
    """
    # About fifty optima are computed; in the 7x7 world only 276 of 12,096 states are reachable.
    mdp, states = mdp.reachable_part()
    choices = None if allowed is None else allowed[..., states, :]

    def best(weights: np.ndarray) -> np.ndarray:
        """Return the pair of an optimal policy for weights of r_env and r_social."""
        scored = weights[0] * mdp.rewards.env + weights[1] * mdp.rewards.social
        policy = horizon_optimum(mdp, scored, horizon, allowed=choices).probabilities(mdp.n_actions)
        return np.array(horizon_evaluation(mdp, policy, horizon).totals)

    corners = [best(np.array(d)) for d in ((1.0, 0), (0, 1.0), (-1.0, 0), (0, -1.0))]
    tolerance = _TOLERANCE * float(np.abs(corners).max())
    points: list[np.ndarray] = []
    for start, end in zip(corners, [*corners[1:], corners[0]], strict=True):
        # A stack in place of recursion: `pending` holds the points ahead, counter-clockwise.
        last = start
        pending = [end]
        while pending:
            along = pending[-1] - last
            length = np.linalg.norm(along)
            if length > tolerance:
                normal = np.array([along[1], -along[0]]) / length
                farthest = best(normal)
                if normal @ (farthest - last) > tolerance:  # beyond the chord, which is no edge
                    pending.append(farthest)
                    continue
            points.append(last)
            last = pending.pop()
    return AttainableSet(_extreme_points(points, tolerance))


def direction(angle: float) -> Float[np.ndarray, " xy"]:
    """Return (cos α, sin α) of an angle in degrees (Eq 4.3)."""
    radians = np.deg2rad(angle)
    return np.array([np.cos(radians), np.sin(radians)])


def _extreme_points(points: list[np.ndarray], tolerance: float) -> Float[np.ndarray, "vertex 2"]:
    """Drop repeated points and points inside an edge, which ties between actions produce.

    A point beyond the ends of its neighbours' chord is kept: a segment's end lies on their line,
    and they may even coincide.
    """
    followed = zip(points, [*points[1:], points[0]], strict=True)
    corners = [point for point, after in followed if np.linalg.norm(after - point) > tolerance]
    corners = corners or points[:1]
    index = 0
    while len(corners) > 2 and index < len(corners):
        before = corners[index - 1]
        after = corners[(index + 1) % len(corners)]
        chord = after - before
        offset = corners[index] - before
        length = np.linalg.norm(chord)
        is_on_chord = False
        if length > tolerance:
            along = chord / length
            normal = np.array([chord[1], -chord[0]]) / length
            is_on_chord = 0.0 <= along @ offset <= length and normal @ offset <= tolerance
        if is_on_chord:
            corners.pop(index)
            index = max(index - 1, 0)
        else:
            index += 1
    array = np.array(corners)
    best = array[:, 0] >= array[:, 0].max() - tolerance
    return np.roll(array, -int(np.where(best, array[:, 1], -np.inf).argmax()), axis=0)
