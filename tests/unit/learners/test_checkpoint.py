"""The resumable state: what is restored equals what was saved, and nothing else is accepted."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners import fit
from socialiq.learners.state import History, Runs, TrainState
from socialiq.nn.q_network import QNetwork
from socialiq.storage import load_arrays, save_arrays


def runs_of(seed):
    def one(key):
        zero = jnp.zeros((), jnp.int32)
        state = TrainState.of(QNetwork.initialise(key, 2, (4,), 2))
        return Runs(state, key, zero, zero - 1, zero - 1)

    return jax.vmap(one)(jax.random.split(jax.random.key(seed), 2))


@pytest.fixture
def saved(tmp_path):
    place = tmp_path / "state.safetensors"
    history = History([5, 9], {"loss": [np.ones(2), np.zeros(2)]})
    fit.save_checkpoint(place, "print", runs_of(0), history)
    return place


def plain(leaf):
    is_key = jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
    return np.asarray(jax.random.key_data(leaf) if is_key else leaf)


def test_the_same_state_comes_back(saved):
    runs, history = fit.load_checkpoint(saved, "print", runs_of(1))
    pairs = zip(jax.tree.leaves(runs), jax.tree.leaves(runs_of(0)), strict=True)
    assert all((plain(a) == plain(b)).all() for a, b in pairs)
    assert history.updates == [5, 9]
    np.testing.assert_array_equal(history.values["loss"], [[1, 1], [0, 0]])


def test_another_run_is_refused(saved):
    with pytest.raises(UserError, match="belongs to a run of other settings or data"):
        fit.load_checkpoint(saved, "other", runs_of(0))


def without_leaf(arrays):
    del arrays["leaf_001"]


def other_shape(arrays):
    arrays["leaf_000"] = arrays["leaf_000"][:1]


def other_kind(arrays):
    arrays["leaf_000"] = arrays["leaf_000"].astype(np.float64)


def shorter_history(arrays):
    arrays["history_loss"] = arrays["history_loss"][:1]


@pytest.mark.parametrize("change", [without_leaf, other_shape, other_kind, shorter_history])
def test_a_state_that_is_not_of_the_run_is_refused(saved, change):
    arrays, header = load_arrays(saved, "checkpoint", fit.CHECKPOINT_VERSION)
    change(arrays)
    kept = {"fingerprint": header["fingerprint"]}
    save_arrays(saved, "checkpoint", fit.CHECKPOINT_VERSION, arrays, kept)
    with pytest.raises(UserError, match="is not the state of this run: remove it"):
        fit.load_checkpoint(saved, "print", runs_of(0))
