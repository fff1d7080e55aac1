"""Every world has the capabilities of `worlds.world`, and its batches branch."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds.files import is_world_file
from socialiq.worlds.registry import open_world
from socialiq.worlds.world import Batch, World

NAMES = ("crossing5", "crossing7", "intersection", "intersection-continuous", "merge")


@pytest.fixture(params=NAMES)
def world(request):
    return open_world(request.param)


def test_a_world_says_what_it_is(world):
    assert isinstance(world, World)
    assert world.n_features > 0
    assert bool(world.action_size) != hasattr(world.action_space, "n")
    assert {"env", "social", "units"} <= set(world.reward)
    assert world.reward_id.startswith("socialiq/")
    assert set(world.references) <= set(world.drivers)


def test_only_gridworlds_have_tables(world):
    if world.is_exact:
        assert world.table().world is world
    else:
        with pytest.raises(UserError, match="can't be listed"):
            world.table()


def test_copies_of_a_batch_go_on_alike(world):
    batch = world.batch(2)
    assert isinstance(batch, Batch)
    batch.reset(np.array([5, 6]))
    action = np.zeros((2, world.action_size), np.float32) if world.action_size else np.zeros(2, int)
    batch.step(action, auto_reset=False)
    copies = batch.branch(np.array([1, 0, 1]))
    there = copies.step(action[[1, 0, 1]], auto_reset=False)
    here = batch.step(action, auto_reset=False)
    for mine, theirs in zip(here.rewards, there.rewards, strict=True):
        np.testing.assert_array_equal(mine[[1, 0, 1]], theirs)
    np.testing.assert_array_equal(copies.time, 2.0)
    assert set(here.ending.tolist()) <= set(map(int, Ending))


def test_a_file_without_a_world_is_refused(tmp_path):
    path = tmp_path / "junction.safetensors"
    path.write_bytes(b"nothing")
    assert not is_world_file(str(path))
    with pytest.raises(UserError, match="do not react"):
        open_world(str(path))
    with pytest.raises(UserError, match="no options"):
        open_world(str(path), duration=3.0)
