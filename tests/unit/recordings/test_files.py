import numpy as np
import pytest

from socialiq import storage
from socialiq.errors import UserError
from socialiq.recordings import files
from socialiq.recordings.recording import Recording
from socialiq.recordings.road.network import RoadNetwork


def test_a_recording_comes_back_to_the_last_bit(tmp_path, recording, same_road):
    path = tmp_path / "r.safetensors"
    sha256 = files.save(path, recording)
    back = files.load(path)
    for name, column in recording.tracks.arrays().items():
        np.testing.assert_array_equal(getattr(back.tracks, name), column)
    assert back.tracks.source == recording.tracks.source and back.tracks.dt == 0.1
    same_road(back.road, recording.road)
    assert files.save(tmp_path / "again.safetensors", back) == sha256


def test_a_recording_without_a_road(tmp_path, straight):
    path = tmp_path / "r.safetensors"
    files.save(path, Recording(straight([5.0]), RoadNetwork()))
    assert files.load(path).road.lanelets == {}


def changed(path, target, **columns):
    arrays, header = storage.load_arrays(path, files.KIND, files.SCHEMA_VERSION)
    plain = {name: one for name, one in header.items() if name not in ("kind", "version", "sha256")}
    arrays = {name: one for name, one in (arrays | columns).items() if one is not None}
    storage.save_arrays(target, files.KIND, files.SCHEMA_VERSION, arrays, plain)


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
