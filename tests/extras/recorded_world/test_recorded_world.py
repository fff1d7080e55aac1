import dataclasses
from pathlib import Path

import numpy as np
import pytest

from socialiq import storage
from socialiq.errors import UserError
from socialiq_recordings.world.recorded_world import KIND, SCHEMA_VERSION, RecordedWorld


def test_a_file_gives_the_same_world(made, world):
    for name, column in made.world.road._asdict().items():
        assert np.array_equal(getattr(world.road, name), column), name
    assert world.config == made.world.config
    assert world.max_speed == made.world.max_speed
    assert world.n_features == 7 * world.config.observed_vehicles


def resealed(world: RecordedWorld, path: Path, **changes: np.ndarray) -> Path:
    """Write a file with another content and the right hash of it."""
    header = {
        "config": dataclasses.asdict(world.config),
        "max_speed": world.max_speed,
        "provenance": world.provenance,
    }
    arrays = world.road._asdict() | changes
    storage.save_arrays(path, KIND, SCHEMA_VERSION, arrays, header)
    return path


@pytest.mark.parametrize(
    ("name", "value", "line"),
    [
        ("egos", np.array([7]), "ego that is no vehicle"),
        ("egos", np.zeros(0, np.int64), "ego that is no vehicle"),
        ("area_of", np.full(9, 99), "conflict area that isn't there"),
        ("line_first", np.array([0, 2, 1, 3]), "places in line_first"),
        ("pair_first", np.array([0, 4]), "places in pair_first"),
        ("length", np.full(3, -1.0), "vehicle without a size"),
        ("length", np.full(3, np.nan), "numbers in length that are not finite"),
        ("zone", np.zeros((2, 2)), "another number of rows in zone"),
        ("line", np.zeros((3, 3)), "lacks the column line"),
        ("drivers", np.zeros((6, 4)), "drivers without parameters"),
    ],
)
def test_a_file_whose_parts_do_not_agree_is_refused(world, tmp_path, name, value, line):
    path = resealed(world, tmp_path / "bad.safetensors", **{name: value})
    with pytest.raises(UserError, match=line):
        RecordedWorld.load(path)


def test_a_damaged_file_is_refused(world_file, tmp_path):
    content = bytearray(world_file.read_bytes())
    content[-5] ^= 1
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(content)
    with pytest.raises(UserError, match="damaged"):
        RecordedWorld.load(damaged)
