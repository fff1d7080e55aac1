"""The words of CommonRoad XML that a recording needs: kinds of obstacles, numbers of signs."""

from __future__ import annotations

from socialiq.recordings.road import Sign
from socialiq.recordings.tracks import RoadUser

VERSIONS = ("2018b", "2020a")

TYPES = {
    "car": RoadUser.CAR,
    "taxi": RoadUser.CAR,
    "parkedVehicle": RoadUser.CAR,
    "truck": RoadUser.TRUCK,
    "bus": RoadUser.BUS,
    "motorcycle": RoadUser.MOTORCYCLE,
    "bicycle": RoadUser.BICYCLE,
    "pedestrian": RoadUser.PEDESTRIAN,
    "priorityVehicle": RoadUser.OTHER,
    "train": RoadUser.OTHER,
    "unknown": RoadUser.OTHER,
}
"""What may move. An emergency vehicle is no ordinary car: others make way for it."""

TYPES_WRITTEN = {
    RoadUser.CAR: "car",
    RoadUser.TRUCK: "truck",
    RoadUser.BUS: "bus",
    RoadUser.MOTORCYCLE: "motorcycle",
    RoadUser.BICYCLE: "bicycle",
    RoadUser.PEDESTRIAN: "pedestrian",
    RoadUser.OTHER: "unknown",
}

SIGNS = {
    "205": Sign.YIELD,
    "206": Sign.STOP,
    "301": Sign.PRIORITY,
    "306": Sign.PRIORITY,
    "R1-1": Sign.STOP,
    "R1-2": Sign.YIELD,
    "r1": Sign.YIELD,
    "r2": Sign.STOP,
}
"""Numbers of signs that say who goes first, as Germany (and the made-up country ZAM), the USA,
Australia and Spain number them; no two countries give one number two meanings."""

SPEED_LIMITS = ("274", "R2-1", "R15", "r301", "3.24", "C43", "B14", "B31", "Ρ-32")
"""Signs whose value is a speed limit, in m/s."""

LIGHT = "light"
SPEED_LIMIT_NUMBER = "274"
SIGN_NUMBERS = {Sign.PRIORITY: "306", Sign.YIELD: "205", Sign.STOP: "206", Sign.LIGHT: LIGHT}
"""What is written."""
