"""Scenarios in the layout of Argoverse 2, written here (extra `parquet`)."""

import json

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="extra `parquet` is not installed")

import pyarrow as pa
import pyarrow.parquet as pq

from socialiq.errors import UserError
from socialiq_recordings.readers import import_file
from socialiq_recordings.readers.argoverse import read_map
from socialiq_recordings.recording import RoadUser

NAME = "0a0a2bb7-c4f4-44cd-958a-9ee15cb34aca"


def scenario(folder, **changes):
    """A car with 8 m/s, a cyclist seen with a gap, and a cone, over 50 steps."""
    rows = [("AV", "vehicle", t, 0.8 * t, 0.0, 0.0, 8.0, 0.0) for t in range(50)] + [
        ("42", "cyclist", t, 5.0, 0.4 * t + 9, np.pi / 2, 0.0, 4.0) for t in range(50) if t != 9
    ]
    rows += [("77", "construction", t, 3.0, 3.0, 0.0, 0.0, 0.0) for t in range(50)]
    names = ("track_id", "object_type", "timestep", "position_x", "position_y", "heading")
    names = (*names, "velocity_x", "velocity_y")
    table = dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))
    count = len(rows)
    table |= {
        "observed": [True] * count,
        "object_category": [1] * count,
        "scenario_id": [NAME] * count,
        "start_timestamp": [315966070522000000.0] * count,
        "end_timestamp": [315966075422000000.0] * count,
        "num_timestamps": [50] * count,
        "focal_track_id": ["42"] * count,
        "city": ["austin"] * count,
    } | changes
    path = folder / f"scenario_{NAME}.parquet"
    pq.write_table(pa.table({name: one for name, one in table.items() if one is not None}), path)
    return path


def lane_map(folder):
    def line(y, *xs):
        return [{"x": x, "y": y, "z": 12.0} for x in xs]

    def segment(number, first, last, **more):
        return {
            "id": number, "is_intersection": False, "lane_type": "VEHICLE",
            "left_lane_boundary": line(1.8, first, last),
            "right_lane_boundary": line(-1.8, first, (first + last) / 2, last),
            "left_lane_mark_type": "NONE", "right_lane_mark_type": "NONE",
            "left_neighbor_id": None, "right_neighbor_id": None,
            "predecessors": [], "successors": [],
        } | more  # fmt: skip

    segments = [segment(1, 0, 20, successors=[2]), segment(2, 20, 40, predecessors=[1])]
    segments += [segment(3, 0, 20, lane_type="BIKE")]
    content = {
        "pedestrian_crossings": {}, "drivable_areas": {},
        "lane_segments": {str(one["id"]): one for one in segments},
    }  # fmt: skip
    path = folder / f"log_map_archive_{NAME}.json"
    path.write_text(json.dumps(content))
    return path


def test_a_scenario_with_its_map(tmp_path):
    lane_map(tmp_path)
    [found] = import_file(scenario(tmp_path), "argoverse")
    tracks = found.recording.tracks
    assert (tracks.recording, tracks.dt, tracks.n_tracks) == (NAME, 0.1, 1)
    assert tracks.road_user[0] == RoadUser.CAR and tracks.source["track_ids"] == ["AV"]
    np.testing.assert_allclose(tracks.x, 0.8 * np.arange(50))
    assert found.skipped == {"construction": 50}
    assert [(one.identity, one.reason[:17]) for one in found.refused] == [
        ("42", "row 60: frame 10 ")
    ]
    road = found.recording.road.lanelets
    assert list(road) == [1, 2] and road[1].successors == (2,)
    np.testing.assert_allclose(road[1].left, [[0, 1.8], [10, 1.8], [20, 1.8]])


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"heading": None}, "no column heading"),
        ({"object_type": ["dragon"] * 149}, "object type 'dragon' is unknown"),
        ({"timestep": ["x"] * 149}, "as Parquet"),
        ({"position_x": [np.nan] * 149}, "no track can be used; the first, 42: "),
    ],
)
def test_damaged_scenarios_are_one_line(tmp_path, changes, line):
    with pytest.raises(UserError, match=line):
        import_file(scenario(tmp_path, **changes), "argoverse")


def test_damaged_maps_are_one_line(tmp_path):
    path, place = scenario(tmp_path), lane_map(tmp_path)
    for content in ("", "[]", '{"lane_segments": {"1": {}}}', '{"lane_segments": {"1": 3}}'):
        place.write_text(content)
        with pytest.raises(UserError) as error:
            import_file(path, "argoverse")
        assert "\n" not in str(error.value)
    path.write_bytes(b"PAR1" + b"\0" * 50)
    with pytest.raises(UserError, match="cannot read"):
        import_file(path, "argoverse")


def test_a_lane_segment_is_named_once_in_a_message(tmp_path) -> None:
    line = [{"x": 0.0, "y": 0.0}, {"x": 1e9, "y": 0.0}]
    one = {"id": 7, "lane_type": "VEHICLE", "successors": [], "predecessors": []}
    one |= {f"{side}_lane_boundary": line for side in ("left", "right")}
    one |= {f"{side}_neighbor_id": None for side in ("left", "right")}
    (tmp_path / "map.json").write_text(json.dumps({"lane_segments": {"7": one}}))
    with pytest.raises(UserError, match="json: lane segment 7: a bound is longer than 100 km"):
        read_map(tmp_path / "map.json")
