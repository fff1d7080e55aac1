"""Environments: each world's rules and rewards are written once; the rest is derived from them.

Here are their Gymnasium ids; the environments load when they are made.
"""

from __future__ import annotations

import gymnasium

from socialiq.worlds.highway.scenes import SCENES

IDS = {
    "crossing5": "socialiq/Crossing5-v1",
    "crossing7": "socialiq/Crossing7-v1",
    "intersection": "socialiq/Intersection-v1",
}

CONTINUOUS_IDS = {
    "continuous": "socialiq/IntersectionContinuous-v1",
    "continuous_steering": "socialiq/IntersectionContinuousSteering-v1",
}
"""The intersection with continuous actions, by the option `actions`."""

CONTINUOUS = {
    "intersection-continuous": "continuous",
    "intersection-continuous-steering": "continuous_steering",
}
"""The same by the name of the world: the option `actions`."""

NAMED = IDS | {name: CONTINUOUS_IDS[actions] for name, actions in CONTINUOUS.items()}
"""Gymnasium id of each world that commands name."""

SCENE_IDS = {name: f"socialiq/{name.title().replace('_', '')}-v1" for name in SCENES}
"""Other roads of highway-env, by the name of the scene."""

RECORDED_JUNCTION = "socialiq/RecordedJunction-v0"
"""Environment of a file of `socialiq data world`, which is named with `file`."""

WORLD_FILE = "recorded-world"
"""Kind of such a file."""

_GRID = "socialiq.worlds.gym:GridWorldEnv"
_INTERSECTION = "socialiq.worlds.intersection.gym:IntersectionEnv"
_INTERSECTIONS = "socialiq.worlds.intersection.gym:IntersectionVectorEnv"


_SCENE = "socialiq.worlds.highway.gym:SceneEnv"
_SCENE_VECTOR = "socialiq.worlds.highway.gym:SceneVectorEnv"
_RECORDED = "socialiq.recordings.world.gym:RecordedJunctionEnv"


def register() -> None:
    """Register every world with Gymnasium. Importing `socialiq` calls this function."""
    for world, name in IDS.items():
        if name in gymnasium.registry:
            continue
        if world == "intersection":
            gymnasium.register(name, _INTERSECTION, vector_entry_point=_INTERSECTIONS)
        else:
            gymnasium.register(name, _GRID, kwargs={"world": world})
    for actions, name in CONTINUOUS_IDS.items():
        if name not in gymnasium.registry:
            more = {"actions": actions}
            gymnasium.register(name, _INTERSECTION, vector_entry_point=_INTERSECTIONS, kwargs=more)
    for scene, name in SCENE_IDS.items():
        if name not in gymnasium.registry:
            more = {"scene": scene}
            gymnasium.register(name, _SCENE, vector_entry_point=_SCENE_VECTOR, kwargs=more)
    if RECORDED_JUNCTION not in gymnasium.registry:
        gymnasium.register(RECORDED_JUNCTION, _RECORDED)
