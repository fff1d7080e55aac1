"""Front of r_env and two classes of r_social: optima of every direction (a, b) of an octant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.mdp.tabular import StateActionArray, TabularMDP

# Relative to the largest coordinate; the rounding of a hull's planes is about 1e-13.
_TOLERANCE = 1e-9
_FAR = 1e3  # times the largest coordinate, where dominated points are put


@dataclass(frozen=True, eq=False)
class OctantFront:
    """Expected sums of (r_env, r_vehicle, r_vulnerable) that are the best in some direction.

    Directions are (cos a, sin a cos b, sin a sin b), both angles from 0 to 90 degrees. The vertices
    are those of the attainable set that no other policy dominates, the best for r_env first; each
    is attained by a deterministic, time-dependent policy.
    """

    vertices: Float[np.ndarray, "vertex 3"]

    def best(self, direction: Sequence[float]) -> tuple[int, float]:
        """Return the number of the best vertex of a direction, three weights, and its value J*."""
        values = self.vertices @ np.array(direction)
        return int(values.argmax()), float(values.max())


def octant_front(mdp: TabularMDP, parts: tuple[StateActionArray, ...], horizon: int) -> OctantFront:
    """Compute every vertex of the front of a finite horizon.

    The method is optimistic linear support (Roijers et al. 2015): a point beyond a plane of the
    hull of the points so far is found by optimising its normal, until no plane has one.

    Args:
        mdp: The MDP; its own rewards are not used.
        parts: Expected r_env, r_vehicle and r_vulnerable, each (state, action).
        horizon: Number of steps.
    """

    def best(normal: np.ndarray) -> np.ndarray:
        reward = np.tensordot(normal, np.array(parts), 1)
        policy = horizon_optimum(mdp, reward, horizon).probabilities(mdp.n_actions)
        visits = horizon_evaluation(mdp, policy, horizon).visits
        return np.array([(visits * part).sum() for part in parts])

    points = np.array([best(np.where(axis, 1.0, 1e-6)) for axis in np.eye(3, dtype=bool)])
    return OctantFront(_supported(best, points))


def _supported(
    best: Callable[[np.ndarray], np.ndarray], points: Float[np.ndarray, "point 3"]
) -> Float[np.ndarray, "vertex 3"]:
    """Add the optimum of every plane's normal until all planes are sides of the front."""
    known = set[tuple[float, ...]]()
    while True:
        scale = float(np.abs(points).max())
        # From every point all dominated directions, so that the normals of the sides that count
        # are not negative.
        dominated = (points[:, None] - _FAR * scale * np.eye(3)).reshape(-1, 3)
        hull = ConvexHull(np.concatenate([points, dominated]))
        normals = hull.equations[:, :3]
        offsets = -hull.equations[:, 3]
        sides = (normals >= -_TOLERANCE).all(axis=1)
        planes = np.unique(np.column_stack([normals, offsets])[sides].round(12), axis=0)
        added = list[np.ndarray]()
        for *normal, offset in planes.tolist():
            if (plane := (*normal, offset)) in known:
                continue
            known.add(plane)
            weights = np.maximum(normal, 0.0)
            point = best(weights)
            if weights @ point > offset + _TOLERANCE * scale:
                added.append(point)
        if not added:
            corners = hull.vertices[hull.vertices < len(points)]
            return points[corners[np.argsort(-points[corners, 0], kind="stable")]]
        points = np.concatenate([points, added])
