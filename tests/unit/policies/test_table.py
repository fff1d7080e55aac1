import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.policies.load import load_policy
from socialiq.storage import save_arrays
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import TabularPolicy

WORLD = make_grid("crossing5")
STATES = int(np.prod(WORLD.shape))
SIZES = (WORLD.n_features, WORLD.n_actions)


def chances():
    return np.random.default_rng(0).dirichlet(np.ones(WORLD.n_actions), STATES)


def test_table_is_the_one_that_was_saved(tmp_path):
    policy = TabularPolicy(WORLD, chances())
    sha256 = policy.save(tmp_path / "t.safetensors")
    loaded = load_policy(str(tmp_path / "t.safetensors"), *SIZES)
    states = np.asarray(WORLD.states()).astype(np.float32)
    np.testing.assert_array_equal(loaded.policy.predict(states)[0], policy.predict(states)[0])
    assert loaded.record.kind == "table"
    assert loaded.record.details == {"content_sha256": sha256, "world": "crossing5"}


def refused(tmp_path, match, array=None, sizes=SIZES, **header):
    said = {"world": "crossing5", "description": WORLD.description} | header
    path = tmp_path / "t.safetensors"
    save_arrays(path, "table", 1, {"probabilities": chances() if array is None else array}, said)
    with pytest.raises(UserError, match=match):
        load_policy(str(path), *sizes)


def test_other_worlds_are_refused(tmp_path):
    refused(tmp_path, "not for a world", world="intersection")
    refused(tmp_path, "not for a world", world=["crossing5"])
    refused(tmp_path, "other options", description="crossing5 otherwise")
    refused(tmp_path, "the world has 70 and 3", sizes=(70, 3))


def test_rows_must_be_distributions(tmp_path):
    refused(tmp_path, "not a distribution", chances() * 0.9)
    refused(tmp_path, "not a distribution", np.full((STATES, SIZES[1]), np.nan))
    negative = np.zeros((STATES, SIZES[1]))
    negative[:, :2] = [2.0, -1.0]
    refused(tmp_path, "not a distribution", negative)
    refused(tmp_path, "must hold float64", chances()[1:])
    refused(tmp_path, "must hold float64", chances().astype(np.float32))
    refused(tmp_path, "must hold float64", np.zeros(0))
