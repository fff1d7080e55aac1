"""Lanelet2 maps as inD and INTERACTION bring them, read by lanelet2 (extra `lanelet2`)."""

import json

import numpy as np
import pytest

pytest.importorskip("lanelet2", reason="extra `lanelet2` is not installed")

import lanelet2

from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq_recordings import files
from socialiq_recordings.readers.lanelet2_road import read_lanelet2
from socialiq_recordings.road.network import Sign

ORIGIN = (295000.0, 5629000.0)  # UTM zone 32, as in a recordingMeta.csv
POINTS = {
    1: (0, 0), 2: (20, 0), 3: (40, 0), 4: (0, 3), 5: (20, 3), 6: (40, 3), 7: (0, 6), 8: (20, 6),
    9: (40, 6), 10: (30, 0),
}  # fmt: skip
WAYS = {
    101: (1, 2), 102: (4, 5), 103: (2, 10, 3), 104: (5, 6), 105: (7, 8, 9), 106: (4, 5, 6),
    107: (2, 5),
}  # fmt: skip
# Lanelet 1001 leads to 1002; 1003 beside them goes both ways; a sidewalk is not for vehicles.
LANES = {
    1001: (102, 101, {"speed_limit": "30"}),
    1002: (104, 103, {}),
    1003: (105, 106, {"one_way": "no"}),
    1004: (105, 106, {"subtype": "walkway"}),
}


def osm(path, projector, origin=(0.0, 0.0)):
    """The map of a street in the layout that JOSM writes, as the data sets have it."""
    lines = ["<?xml version='1.0' encoding='UTF-8'?>", "<osm version='0.6' generator='JOSM'>"]
    for number, (x, y) in POINTS.items():
        there = lanelet2.core.BasicPoint3d(x + origin[0], y + origin[1], 0.0)
        gps = projector.reverse(there)
        lines.append(
            f"<node id='{number}' visible='true' version='1' lat='{gps.lat:.12f}' "
            f"lon='{gps.lon:.12f}' />"
        )
    for number, nodes in WAYS.items():
        refs = "".join(f"<nd ref='{one}' />" for one in nodes)
        kind = "stop_line" if number == 107 else "line_thin"
        lines.append(
            f"<way id='{number}' visible='true' version='1'>{refs}<tag k='type' v='{kind}' />"
            "<tag k='subtype' v='dashed' /></way>"
        )
    rule = "<member type='relation' ref='2001' role='regulatory_element' />"
    for number, (left, right, more) in LANES.items():
        tags = {"type": "lanelet", "subtype": "road", "location": "urban", "one_way": "yes"} | more
        text = "".join(f"<tag k='{key}' v='{value}' />" for key, value in tags.items())
        lines.append(
            f"<relation id='{number}' visible='true' version='1'>"
            f"<member type='way' ref='{left}' role='left' />"
            f"<member type='way' ref='{right}' role='right' />"
            f"{rule if number == 1001 else ''}{text}</relation>"
        )
    lines.append(
        "<relation id='2001' visible='true' version='1'>"
        "<member type='relation' ref='1001' role='yield' />"
        "<member type='relation' ref='1003' role='right_of_way' />"
        "<member type='way' ref='107' role='ref_line' />"
        "<tag k='type' v='regulatory_element' /><tag k='subtype' v='right_of_way' /></relation>"
    )
    path.write_text("\n".join([*lines, "</osm>"]))


def of_ind(path):
    zone = lanelet2.io.Origin(50.78, 6.07)
    osm(path, lanelet2.projection.UtmProjector(zone, False, False), ORIGIN)


@pytest.mark.parametrize("kind", ["ind", "interaction"])
def test_a_map_comes_in_the_frame_of_the_tracks(tmp_path, kind):
    path = tmp_path / "map.osm"
    if kind == "ind":
        of_ind(path)
    else:
        osm(path, lanelet2.projection.UtmProjector(lanelet2.io.Origin(0.0, 0.0)))
    road = read_lanelet2(path, ORIGIN if kind == "ind" else None)
    first, second, third = (road.lanelets[number] for number in (1001, 1002, 1003))
    np.testing.assert_allclose(first.left, [[0, 3], [20, 3]], atol=1e-3)
    np.testing.assert_allclose(second.right, [[20, 0], [30, 0], [40, 0]], atol=1e-3)
    assert len(second.left) == len(second.right)
    assert first.successors == (1002,) and second.predecessors == (1001,)
    assert first.speed_limit == pytest.approx(30 / 3.6)
    assert first.sign == Sign.YIELD and first.stop_line is not None
    # Both ways: a lanelet of its own against the first, and no sidewalk.
    assert len(road.lanelets) == 4 and 1004 not in road.lanelets
    [back] = [one for number, one in road.lanelets.items() if number > 2000 or number == 1005]
    np.testing.assert_allclose(back.centre[0], third.centre[-1], atol=1e-3)


def ind(folder):
    """07_tracks.csv and its two neighbours with the headers of inD; a car, and one that stands."""
    head = (
        "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,"
        "yVelocity,xAcceleration,yAcceleration,lonVelocity,latVelocity,lonAcceleration,"
        "latAcceleration"
    )
    rows = [
        f"7,{number},{frame},{frame},{x + v * frame / 25:.5f},1.5,0.0,1.8,4.5,{v},0.0,0,0,{v},0,0,0"
        for number, x, v in ((0, 2.0, 8.0), (1, 30.0, 0.0))
        for frame in range(60)
    ]
    (folder / "07_tracks.csv").write_text("\n".join([head, *rows]) + "\n")
    (folder / "07_tracksMeta.csv").write_text(
        "recordingId,trackId,initialFrame,finalFrame,numFrames,width,length,class\n"
        "7,0,0,59,60,1.8,4.5,car\n7,1,0,59,60,1.8,4.5,truck_bus\n"
    )
    (folder / "07_recordingMeta.csv").write_text(
        "recordingId,locationId,frameRate,speedLimit,weekday,startTime,duration,numTracks,"
        "numVehicles,numVRUs,latLocation,lonLocation,xUtmOrigin,yUtmOrigin,orthoPxToMeter\n"
        f"7,2,25.0,13.89,wednesday,9.0,2.4,2,2,0,50.78,6.07,{ORIGIN[0]},{ORIGIN[1]},0.00814\n"
    )
    return folder / "07_tracks.csv"


def test_ind_with_its_map_from_the_command_line(tmp_path, capsys):
    of_ind(tmp_path / "location2.osm")
    states, out = ind(tmp_path), tmp_path / "out"
    ask = ["data", "import", "csv", str(states), "--columns", "ind", "--out", str(out), "--json"]
    assert main([*ask, "--road", str(tmp_path / "location2.osm")]) == 0
    [told] = json.loads(capsys.readouterr().out)["recordings"]
    found = files.load(out / told["file"])
    assert len(found.road.lanelets) == 4 and found.tracks.source["utm_origin"] == list(ORIGIN)
    np.testing.assert_allclose(found.road.lanelets[1001].left[0], [0, 3], atol=1e-3)


@pytest.mark.parametrize(
    "content",
    [
        b"", b"<osm>", b"\0" * 100, b"<osm></osm>", b"<osm><node id='1' lat='9e99' lon='0'/></osm>",
        b"<osm><node id='1' lat='50' lon='6'/></osm>", b"<!DOCTYPE x><osm/>",
        b"<osm><node id='1' lat='x' lon='6'/></osm>",
        b"<osm><node id='" + b"9" * 30 + b"' lat='50' lon='6'/></osm>",
    ],
)  # fmt: skip
def test_damaged_maps_are_one_line(tmp_path, content):
    path = tmp_path / "map.osm"
    path.write_bytes(content)
    with pytest.raises(UserError) as error:
        read_lanelet2(path, ORIGIN)
    assert "\n" not in str(error.value)


def test_a_map_of_another_zone_needs_the_origin_of_the_tracks(tmp_path):
    path = tmp_path / "map.osm"
    zone = lanelet2.io.Origin(48.16, 11.57)
    osm(path, lanelet2.projection.UtmProjector(zone))
    with pytest.raises(UserError, match=r"map.osm: its first node, .*UTM zone .* --origin"):
        read_lanelet2(path)
    road = read_lanelet2(path, origin=(48.16, 11.57))
    np.testing.assert_allclose(road.lanelets[1001].left, [[0, 3], [20, 3]], atol=1e-3)


def with_local(text, local, place=None):
    """Return a map with local coordinates.

    Args:
        text: The map.
        local: Places of the points to the east of those of `POINTS`, m.
        place: Attributes in the place of lat and lon; None keeps both.
    """
    for number, (x, y) in POINTS.items():
        tags = f"<tag k='local_x' v='{x + local}'/><tag k='local_y' v='{y}'/></node>"
        head, _, tail = text.partition(f"<node id='{number}' ")
        node, _, tail = tail.partition(" />")
        if place is not None:
            node = f"visible='true' version='1' {place}"
        text = f"{head}<node id='{number}' {node}>{tags}{tail}"
    return text


def test_local_coordinates_need_no_origin(tmp_path):
    path = tmp_path / "map.osm"
    osm(path, lanelet2.projection.UtmProjector(lanelet2.io.Origin(48.16, 11.57)))
    path.write_text(with_local(path.read_text(), 5))
    road = read_lanelet2(path)
    np.testing.assert_allclose(road.lanelets[1001].left, [[5, 3], [25, 3]], atol=1e-9)


@pytest.mark.parametrize("place", ["", "lat='' lon=''"])
@pytest.mark.parametrize("local", [5, -80_000, 4_000_000])
def test_a_map_without_lat_and_lon_is_read_by_its_local_coordinates(tmp_path, place, local):
    path = tmp_path / "map.osm"
    osm(path, lanelet2.projection.UtmProjector(lanelet2.io.Origin(0.0, 0.0)))
    expected = read_lanelet2(path)
    path.write_text(with_local(path.read_text(), local, place))
    road = read_lanelet2(path)
    assert road.lanelets.keys() == expected.lanelets.keys()
    for number, lanelet in road.lanelets.items():
        other = expected.lanelets[number]
        np.testing.assert_allclose(lanelet.centre - (local, 0), other.centre, atol=1e-3)
        for name in ("successors", "predecessors", "adjacent_left", "adjacent_right", "sign"):
            assert getattr(lanelet, name) == getattr(other, name), name
    with pytest.raises(UserError, match=r"no node has lat and lon.*leave out --origin"):
        read_lanelet2(path, origin=(48.16, 11.57))
    path.write_text(path.read_text().replace(f"k='local_y' v='{POINTS[5][1]}'", "k='z' v='0'"))
    with pytest.raises(UserError, match="node 4 has no numbers local_x and local_y"):
        read_lanelet2(path)


def test_a_relation_without_ways_is_left_out_and_named(tmp_path):
    path = tmp_path / "map.osm"
    osm(path, lanelet2.projection.UtmProjector(lanelet2.io.Origin(0.0, 0.0)))
    broken = (
        "<relation id='1009' visible='true' version='1'><member type='way' ref='911' role='left'/>"
        "<member type='way' ref='912' role='right'/><tag k='type' v='lanelet'/></relation></osm>"
    )
    path.write_text(path.read_text().replace("</osm>", broken))
    road = read_lanelet2(path)
    assert 1001 in road.lanelets and 1009 not in road.lanelets
    assert any("nonexistent member 911" in fault.reason for fault in road.faults)
    assert "lanelet 1009" in [fault.identity for fault in road.faults]
