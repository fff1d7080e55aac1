from dataclasses import replace

import numpy as np
import pytest

from socialiq import storage
from socialiq.errors import UserError
from socialiq_recordings import files
from socialiq_recordings.recording import Recording
from socialiq_recordings.road.network import Colour, Cycle, RoadNetwork


def test_a_recording_comes_back_to_the_last_bit(tmp_path, recording, same_road):
    path = tmp_path / "r.safetensors"
    sha256 = files.save(path, recording)
    back = files.load(path)
    for name, column in recording.tracks.arrays().items():
        np.testing.assert_array_equal(getattr(back.tracks, name), column)
    assert back.tracks.source == recording.tracks.source and back.tracks.dt == 0.1
    same_road(back.road, recording.road)
    assert files.save(tmp_path / "again.safetensors", back) == sha256


@pytest.fixture(name="lit")
def with_a_light(recording):
    lanelets = dict(recording.road.lanelets)
    cycle = Cycle(((Colour.RED, 30), (Colour.GREEN, 20)), offset=-7)
    lanelets[2] = replace(lanelets[2], cycle=cycle)
    return Recording(recording.tracks, RoadNetwork(lanelets))


def test_cycles_of_lights_come_back(tmp_path, lit, recording, same_road):
    path = tmp_path / "r.safetensors"
    files.save(path, lit)
    same_road(files.load(path).road, lit.road)
    assert storage.load_arrays(path, files.KIND, 2)[1]["version"] == 2
    # Without a cycle the file is that of before.
    files.save(path, recording)
    assert storage.load_arrays(path, files.KIND, 1)[1]["version"] == 1


@pytest.mark.parametrize(
    ("columns", "line"),
    [
        ({"light": None}, "lacks a column"),
        ({"light": np.array([[9, 0]])}, "cycles of lights"),
        ({"light_phase": np.array([[2, 9, 30]])}, "cycles of lights"),
        ({"light_phase": np.array([[2, 1, 0]])}, "cycles of lights"),
        ({"light_phase": np.zeros((0, 3), np.int64)}, "cycles of lights"),
        ({"light_phase": np.zeros((1, 2), np.int64)}, "array light_phase has another type"),
    ],
)
def test_cycles_that_are_none_are_refused(tmp_path, lit, columns, line):
    path, target = tmp_path / "r.safetensors", tmp_path / "bad.safetensors"
    files.save(path, lit)
    changed(path, target, version=2, **columns)
    with pytest.raises(UserError, match=line):
        files.load(target)


def test_a_recording_without_a_road(tmp_path, straight):
    path = tmp_path / "r.safetensors"
    files.save(path, Recording(straight([5.0]), RoadNetwork()))
    assert files.load(path).road.lanelets == {}


def changed(path, target, version=files.SCHEMA_VERSION, **columns):
    arrays, header = storage.load_arrays(path, files.KIND, version)
    plain = {name: one for name, one in header.items() if name not in ("kind", "version", "sha256")}
    arrays = {name: one for name, one in (arrays | columns).items() if one is not None}
    storage.save_arrays(target, files.KIND, version, arrays, plain)


@pytest.mark.parametrize(
    ("columns", "line"),
    [
        ({"vx": None}, "lacks a column"),
        ({"heading": np.full(30, 9.0)}, "column heading, row 0"),
        ({"sign": np.array([0, 0, 9], np.int8)}, "don't fit together"),
        ({"lanelet": np.array([1, 1, 3])}, "don't fit together"),
        ({"lanelet_points": np.array([2, 2, 4])}, "don't fit together"),
        ({"successor": np.array([[8, 1]])}, "don't fit together"),
        ({"speed_limit": np.zeros(3, np.float32)}, "array speed_limit has another type"),
        ({"left": np.full((7, 2), np.nan)}, "lanelet 1: a point of its bounds"),
    ],
)
def test_content_that_is_no_recording_is_refused(tmp_path, recording, columns, line):
    path, target = tmp_path / "r.safetensors", tmp_path / "bad.safetensors"
    files.save(path, recording)
    changed(path, target, **columns)
    with pytest.raises(UserError, match=line) as caught:
        files.load(target)
    assert str(target) in str(caught.value)
