"""Maps of recordings that bring none: CommonRoad XML, Lanelet2 OSM, or another recording."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from socialiq.errors import UserError
from socialiq_recordings.readers.commonroad_road import road_of
from socialiq_recordings.readers.lanelet2_road import read_lanelet2
from socialiq_recordings.road.network import RoadNetwork


def map_of(path: Path, source: Mapping[str, Any]) -> RoadNetwork:
    """Read a map in the frame of a recording's tracks.

    Args:
        path: CommonRoad XML, a recording, or a Lanelet2 map (.osm).
        source: The recording's provenance; `utm_origin` is the origin of the frame of inD's tracks.

    Raises:
        UserError: If it can't be read, or holds no lanelet.
    """
    if path.suffix.lower() != ".osm":
        return road_of(path)
    origin = source.get("utm_origin")
    if origin is None:
        return read_lanelet2(path)
    try:
        x, y = (float(one) for one in origin)
    except (TypeError, ValueError) as error:
        raise UserError("the recording's utm_origin is not two numbers: import it again") from error
    return read_lanelet2(path, (x, y))
