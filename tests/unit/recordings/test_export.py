"""Export in another layout is read back, to the last bit where its units are ours."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.recordings import write_csv

from socialiq.errors import UserError
from socialiq_recordings.export import write_commonroad
from socialiq_recordings.readers.column_map import read_map
from socialiq_recordings.readers.commonroad import read_commonroad
from socialiq_recordings.readers.csv_recording import read_csv
from socialiq_recordings.recording import Recording
from socialiq_recordings.road.network import Colour, Cycle, RoadNetwork

EXACT = ("track", "frame", "x", "y", "vx", "vy", "identity", "road_user", "length", "width")


@pytest.mark.parametrize("layout", ["ind", "interaction"])
def test_layouts_are_read_back(tmp_path, recording, layout):
    tracks = recording.tracks
    path = write_csv(tracks, layout, tmp_path)
    back = read_csv(path, read_map(layout))[0].recording.tracks
    for name in EXACT:
        np.testing.assert_array_equal(getattr(back, name), getattr(tracks, name))
    np.testing.assert_allclose(back.heading, tracks.heading, rtol=1e-14)
    if layout == "interaction":
        np.testing.assert_array_equal(back.heading, tracks.heading)
    assert back.dt == tracks.dt
    if layout == "ind":
        assert back.recording == tracks.recording


def test_ngsim_has_feet_and_fronts(tmp_path, straight):
    tracks = straight([8.0, 9.0], heading=0.3)
    back = read_csv(write_csv(tracks, "ngsim", tmp_path), read_map("ngsim"))[0].recording.tracks
    for name in ("frame", "identity", "road_user"):
        np.testing.assert_array_equal(getattr(back, name), getattr(tracks, name))
    for name in ("x", "y", "heading", "vx", "vy", "length", "width"):
        np.testing.assert_allclose(getattr(back, name), getattr(tracks, name), atol=1e-9)


def test_what_a_layout_cannot_hold_is_refused(tmp_path, recording, straight):
    with pytest.raises(UserError, match="unknown layout 'waymo'"):
        write_csv(recording.tracks, "waymo", tmp_path)
    with pytest.raises(UserError, match="10 frames a second, not 5"):
        write_csv(replace(recording.tracks, dt=0.2), "interaction", tmp_path)
    walk = straight([1.0], road_user=np.array([5], np.int8))
    with pytest.raises(UserError, match="no class for PEDESTRIAN"):
        write_csv(walk, "ngsim", tmp_path)


def test_commonroad_is_read_back(tmp_path, recording, same_road):
    path = tmp_path / "s.xml"
    write_commonroad(recording, path)
    imported = read_commonroad(path)
    back, tracks = imported.recording.tracks, recording.tracks
    for name in ("track", "frame", "x", "y", "heading", "identity", "road_user", "length", "width"):
        np.testing.assert_array_equal(getattr(back, name), getattr(tracks, name))
    for name in ("vx", "vy"):
        np.testing.assert_allclose(getattr(back, name), getattr(tracks, name), atol=2e-15 * 10)
    assert back.recording == tracks.recording and imported.refused == ()
    same_road(imported.recording.road, recording.road)


def test_cycles_of_lights_are_written(tmp_path, recording, same_road):
    lanelets = dict(recording.road.lanelets)
    cycle = Cycle(tuple((colour, 3 + colour) for colour in Colour), offset=-7)
    lanelets[2] = replace(lanelets[2], cycle=cycle)
    road = RoadNetwork(lanelets)
    write_commonroad(Recording(recording.tracks, road), tmp_path / "s.xml")
    same_road(read_commonroad(tmp_path / "s.xml").recording.road, road)


def test_small_numbers_are_written_without_exponents(tmp_path, straight):
    path = tmp_path / "s.xml"
    tracks = straight([5.0], x=np.arange(10) * 0.5 + 1e-9)
    write_commonroad(Recording(tracks, RoadNetwork()), path)
    assert "<x>0.000000001</x>" in path.read_text()
    np.testing.assert_array_equal(read_commonroad(path).recording.tracks.x, tracks.x)


def test_one_number_for_two_things_is_refused(tmp_path, recording):
    tracks = replace(recording.tracks, identity=np.array([1, 101, 102]))
    with pytest.raises(UserError, match="number 1 has two elements"):
        write_commonroad(Recording(tracks, recording.road), tmp_path / "s.xml")
