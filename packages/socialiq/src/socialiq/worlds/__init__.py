"""Environments: each world's rules and rewards are written once; the rest is derived from them.

Here are their Gymnasium ids; the environments load when they are made.
"""

import gymnasium

from socialiq.worlds.highway.scenes import SCENES

IDS = {
    "crossing5": "socialiq/Crossing5-v1",
    "crossing7": "socialiq/Crossing7-v1",
    "crosswalk7": "socialiq/Crosswalk7-v1",
    "intersection": "socialiq/Intersection-v1",
}

OLD_IDS = {
    "intersection-continuous": "socialiq/IntersectionContinuous-v1",
    "intersection-continuous-steering": "socialiq/IntersectionContinuousSteering-v1",
    "intersection-continuous-steering-offroad": "socialiq/IntersectionContinuousSteeringOffroad-v1",
    "intersection-crosswalk": "socialiq/IntersectionCrosswalk-v1",
}
"""Gymnasium ids that spell options, by the name of 0.3.0."""

SCENE_IDS = {name: f"socialiq/{name.title().replace('_', '')}-v1" for name in (*SCENES, "road")}
"""Other roads of highway-env and generated roads, by the name of the scene."""


SUMO_IDS = {"sumo": "socialiq/Sumo-v1", "sumo-row": "socialiq/SumoRow-v1"}
"""Worlds in SUMO, by name: a crossing, and a row of three junctions."""

SUMO_NET = ".net.xml"
"""Ending of the file of a network of SUMO, which names a world too."""

_ID = r"[A-Za-z0-9_./-]+-v[0-9]+"
ENVIRONMENT_PATTERN = rf"(?:{_ID}|[A-Za-z0-9_./-]+:(?:{_ID}|[A-Za-z_][A-Za-z0-9_]*))"
"""A Gymnasium id, MODULE:ID or MODULE:FUNCTION; MODULE may be the path of a file."""

UNSEEN = "in SUMO policies observe vehicles and bicycles, and no pedestrians"
"""Line of commands in a world in SUMO."""

RECORDED_JUNCTION = "socialiq/RecordedJunction-v0"
"""Environment of a file of `socialiq data world`, which is named with `file`."""

WORLD_FILE = "recorded-world"
"""Kind of such a file."""

_GRID = "socialiq.worlds.gym:GridWorldEnv"
_ROAD = "socialiq.worlds.gym:RoadEnv"
_ROADS = "socialiq.worlds.gym:RoadVectorEnv"
_SUMO = "socialiq.worlds.sumo.gym:SumoEnv"
_RECORDED = "socialiq_recordings.world.gym:RecordedJunctionEnv"


def register() -> None:
    """Register every world with Gymnasium. Importing `socialiq` calls this function."""
    roads = {"intersection": IDS["intersection"]} | SCENE_IDS | OLD_IDS
    for scene, name in roads.items():
        if name not in gymnasium.registry:
            gymnasium.register(name, _ROAD, vector_entry_point=_ROADS, kwargs={"scene": scene})
    for world in ("crossing5", "crossing7", "crosswalk7"):
        if IDS[world] not in gymnasium.registry:
            gymnasium.register(IDS[world], _GRID, kwargs={"world": world})
    row = {"net": "row", "start": "WC0", "end": "C2N2", "duration": 60.0}
    for world, options in (("sumo", {}), ("sumo-row", row)):
        if SUMO_IDS[world] not in gymnasium.registry:
            gymnasium.register(SUMO_IDS[world], _SUMO, kwargs=options)
    if RECORDED_JUNCTION not in gymnasium.registry:
        gymnasium.register(RECORDED_JUNCTION, _RECORDED)
