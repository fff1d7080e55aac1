"""A crossing made by hand, as files in the layouts of inD and INTERACTION with Lanelet2 maps.

Cars come from the west with priority and from the south with a yield sign, one every 12 s each, and
meet in the middle 3 s apart; every second one from the south stops before it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

ORIGIN = (295000.0, 5629000.0)  # m, UTM zone 32, as in a recordingMeta.csv
ENDS = (-60.0, -8.0, 8.0, 60.0)
WIDTH = 1.75
SECONDS, PAIRS = 60, 4

_IND_TRACKS = (
    "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,"
    "yVelocity,xAcceleration,yAcceleration,lonVelocity,latVelocity,lonAcceleration,latAcceleration"
)
_IND_META = (
    "recordingId,locationId,frameRate,speedLimit,weekday,startTime,duration,numTracks,numVehicles,"
    "numVRUs,latLocation,lonLocation,xUtmOrigin,yUtmOrigin,orthoPxToMeter"
)


def _places() -> list[tuple[float, float, bool]]:
    """Return the map's points: along, to the left, whether the road goes east."""
    return [(along, side, east) for east in (True, False) for along in ENDS for side in (-1, 1)]


def crossing_map(path: Path, kind: str) -> None:
    """Write the Lanelet2 map: three lanelets from west to east, three from south to north."""
    import lanelet2

    if kind == "ind":
        zone = lanelet2.io.Origin(50.78, 6.07)
        projector: Any = lanelet2.projection.UtmProjector(zone, False, False)
        x0, y0 = ORIGIN
    else:
        projector = lanelet2.projection.UtmProjector(lanelet2.io.Origin(0.0, 0.0))
        x0, y0 = 0.0, 0.0
    lines = ["<?xml version='1.0' encoding='UTF-8'?>", "<osm version='0.6' generator='JOSM'>"]
    for number, (along, side, east) in enumerate(_places(), 1):
        x, y = (along, side * WIDTH) if east else (-side * WIDTH, along)
        gps = projector.reverse(lanelet2.core.BasicPoint3d(x + x0, y + y0, 0.0))
        lines.append(
            f"<node id='{number}' visible='true' version='1' lat='{gps.lat:.12f}' "
            f"lon='{gps.lon:.12f}' />"
        )
    thin = "<tag k='type' v='line_thin' /><tag k='subtype' v='solid' /></way>"
    for road in (0, 1):
        for piece in range(3):
            for side in (0, 1):
                first = 1 + 8 * road + 2 * piece + side
                lines.append(
                    f"<way id='{100 + first}' visible='true' version='1'><nd ref='{first}' />"
                    f"<nd ref='{first + 2}' />{thin}"
                )
    tags = {"type": "lanelet", "subtype": "road", "location": "urban", "one_way": "yes"}
    text = "".join(f"<tag k='{key}' v='{value}' />" for key, value in tags.items())
    for road in (0, 1):
        for piece in range(3):
            right = 101 + 8 * road + 2 * piece
            rule = "<member type='relation' ref='2001' role='regulatory_element' />"
            lines.append(
                f"<relation id='{1001 + 3 * road + piece}' visible='true' version='1'>"
                f"<member type='way' ref='{right + 1}' role='left' />"
                f"<member type='way' ref='{right}' role='right' />"
                f"{rule if piece == 0 else ''}{text}</relation>"
            )
    lines.append(
        "<relation id='2001' visible='true' version='1'>"
        "<member type='relation' ref='1004' role='yield' />"
        "<member type='relation' ref='1001' role='right_of_way' />"
        "<tag k='type' v='regulatory_element' /><tag k='subtype' v='right_of_way' /></relation>"
    )
    path.write_text("\n".join([*lines, "</osm>"]))


def cars(rate: int, seed: int = 0) -> list[dict[str, Any]]:
    """Return the cars: first frame, x, y, speed and heading at each frame.

    Args:
        rate: Frames per second.
        seed: Seed of speeds and of a measurement error of 2 cm.
    """
    rng, found = np.random.default_rng(seed), []
    for number in range(2 * PAIRS):
        east, meets = number % 2 == 0, 12.0 * (number // 2) + (5.0 if number % 2 == 0 else 8.0)
        fastest = rng.uniform(8.0, 11.0)
        time = np.arange(SECONDS * rate) / rate
        speed = np.full(len(time), fastest)
        there = meets, 0.0
        if not east and number % 4 == 3:  # stops 12 m before the middle for 2 s
            there = meets - 4.0, -12.0
            speed = np.clip(2.0 * np.abs(time - there[0]) - 2.0, 0.0, fastest)
        along = np.cumsum(speed) / rate
        along += there[1] - np.interp(there[0], time, along)
        inside = np.flatnonzero((along > -55.0) & (along < 55.0))
        along, speed = along[inside] + rng.normal(0, 0.02, len(inside)), speed[inside]
        side = rng.normal(0, 0.02, len(inside))
        x, y = (along, side) if east else (side, along)
        found.append({"first": int(inside[0]), "x": x, "y": y, "speed": speed, "east": east})
    return found


def ind_files(folder: Path, recording: int = 7) -> Path:
    """Write a recording with the headers of inD and its map; return its NN_tracks.csv."""
    made, rows, meta = cars(25, recording), [], []
    for number, one in enumerate(made):
        heading, count = 0.0 if one["east"] else 90.0, len(one["x"])
        for place in range(count):
            v = one["speed"][place]
            vx, vy = (v, 0.0) if one["east"] else (0.0, v)
            rows.append(
                f"{recording},{number},{one['first'] + place},{place},{one['x'][place]:.5f},"
                f"{one['y'][place]:.5f},{heading},1.8,4.5,{vx:.5f},{vy:.5f},0,0,{v:.5f},0,0,0"
            )
        last = one["first"] + count - 1
        meta.append(f"{recording},{number},{one['first']},{last},{count},1.8,4.5,car")
    stem = folder / f"{recording:02d}"
    (folder / f"{stem.name}_tracks.csv").write_text("\n".join([_IND_TRACKS, *rows]) + "\n")
    (folder / f"{stem.name}_tracksMeta.csv").write_text(
        "\n".join(
            ["recordingId,trackId,initialFrame,finalFrame,numFrames,width,length,class", *meta]
        )
        + "\n"
    )
    (folder / f"{stem.name}_recordingMeta.csv").write_text(
        f"{_IND_META}\n{recording},2,25.0,13.89,wednesday,9.0,{SECONDS},{len(made)},{len(made)},0,"
        f"50.78,6.07,{ORIGIN[0]},{ORIGIN[1]},0.00814\n"
    )
    crossing_map(folder / "location2.osm", "ind")
    return folder / f"{stem.name}_tracks.csv"


def interaction_files(folder: Path) -> Path:
    """Write a recording with the header of INTERACTION and its map; return vehicle_tracks_000."""
    rows = ["track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"]
    for number, one in enumerate(cars(10), 1):
        psi = 0.0 if one["east"] else np.pi / 2
        for place in range(len(one["x"])):
            frame, v = one["first"] + place + 1, one["speed"][place]
            vx, vy = (v, 0.0) if one["east"] else (0.0, v)
            rows.append(
                f"{number},{frame},{100 * frame},car,{one['x'][place]:.3f},{one['y'][place]:.3f},"
                f"{vx:.3f},{vy:.3f},{psi:.3f},4.5,1.8"
            )
    (folder / "vehicle_tracks_000.csv").write_text("\n".join(rows) + "\n")
    crossing_map(folder / "map.osm", "interaction")
    return folder / "vehicle_tracks_000.csv"
