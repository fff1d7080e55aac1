"""Environments: each world's rules and rewards are written once; the rest is derived from them.

Here are their Gymnasium ids; the environments load when they are made.
"""

from typing import Any

import gymnasium

from socialiq.worlds.highway.scenes import SCENES

IDS = {
    "crossing5": "socialiq/Crossing5-v1",
    "crossing7": "socialiq/Crossing7-v1",
    "crosswalk7": "socialiq/Crosswalk7-v1",
    "intersection": "socialiq/Intersection-v1",
}

CONTINUOUS: dict[str, dict[str, Any]] = {
    "intersection-continuous": {"actions": "continuous"},
    "intersection-continuous-steering": {"actions": "continuous_steering"},
    "intersection-continuous-steering-offroad": {
        "actions": "continuous_steering",
        "offroad_terminal": True,
    },
}
"""The intersection with continuous actions by the name of the world: the options it stands for."""

CONTINUOUS_IDS = {
    "intersection-continuous": "socialiq/IntersectionContinuous-v1",
    "intersection-continuous-steering": "socialiq/IntersectionContinuousSteering-v1",
    "intersection-continuous-steering-offroad": "socialiq/IntersectionContinuousSteeringOffroad-v1",
}

WALKED_IDS = {"intersection-crosswalk": "socialiq/IntersectionCrosswalk-v1"}
"""The intersection with people on foot, by the name of the world."""

NAMED = IDS | CONTINUOUS_IDS | WALKED_IDS
"""Gymnasium id of each world that commands name."""

SCENE_IDS = {name: f"socialiq/{name.title().replace('_', '')}-v1" for name in SCENES}
"""Other roads of highway-env, by the name of the scene."""


def scene_named(name: str) -> str | None:
    """Return the scene of a world's name or Gymnasium id; None if it is another world's."""
    return next((scene for scene, identity in SCENE_IDS.items() if name in (scene, identity)), None)


SUMO_IDS = {"sumo": "socialiq/Sumo-v1", "sumo-row": "socialiq/SumoRow-v1"}
"""Worlds in SUMO, by name: a crossing, and a row of three junctions."""

SUMO_NET = ".net.xml"
"""Ending of the file of a network of SUMO, which names a world too."""


def in_sumo(name: str) -> bool:
    """Whether a world's name or Gymnasium id is that of one in SUMO, or of a network."""
    return name in (*SUMO_IDS, *SUMO_IDS.values()) or name.endswith(SUMO_NET)


UNSEEN = "in SUMO policies observe vehicles and bicycles, and no pedestrians"
"""Line of commands in a world in SUMO."""

RECORDED_JUNCTION = "socialiq/RecordedJunction-v0"
"""Environment of a file of `socialiq data world`, which is named with `file`."""

WORLD_FILE = "recorded-world"
"""Kind of such a file."""

_GRID = "socialiq.worlds.gym:GridWorldEnv"
_ROAD, _ROADS = "socialiq.worlds.gym:RoadEnv", "socialiq.worlds.gym:RoadVectorEnv"
_SUMO = "socialiq.worlds.sumo.gym:SumoEnv"
_RECORDED = "socialiq_recordings.world.gym:RecordedJunctionEnv"


def register() -> None:
    """Register every world with Gymnasium. Importing `socialiq` calls this function."""
    roads = {IDS["intersection"]: {}}
    roads |= {name: CONTINUOUS[world] for world, name in CONTINUOUS_IDS.items()}
    roads |= {name: {"scene": scene} for scene, name in (SCENE_IDS | WALKED_IDS).items()}
    for name, options in roads.items():
        if name not in gymnasium.registry:
            gymnasium.register(name, _ROAD, vector_entry_point=_ROADS, kwargs=options)
    for world in ("crossing5", "crossing7", "crosswalk7"):
        if IDS[world] not in gymnasium.registry:
            gymnasium.register(IDS[world], _GRID, kwargs={"world": world})
    row = {"net": "row", "start": "WC0", "end": "C2N2", "duration": 60.0}
    for world, options in (("sumo", {}), ("sumo-row", row)):
        if SUMO_IDS[world] not in gymnasium.registry:
            gymnasium.register(SUMO_IDS[world], _SUMO, kwargs=options)
    if RECORDED_JUNCTION not in gymnasium.registry:
        gymnasium.register(RECORDED_JUNCTION, _RECORDED)
