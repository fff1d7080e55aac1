import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.nn.actor import Actor, TwinCritics
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.storage import load_arrays, save_arrays

SEEN = np.random.default_rng(0).normal(size=(7, 3)).astype(np.float32)


def actor(inputs: int = 3, stochastic: bool = True, scale: float = 1.0) -> Actor:
    shape = (inputs, (8, 8), 2, "relu", scale)
    return Actor.initialise(jax.random.key(0), *shape, stochastic=stochastic)


@pytest.mark.parametrize("scale", [1.0, 0.1])
@pytest.mark.parametrize("stochastic", [True, False])
def test_the_policy_is_the_network(stochastic, scale):
    network = actor(stochastic=stochastic, scale=scale)
    policy = ActorPolicy.of(network, {})
    mean = np.asarray(jax.vmap(network)(jnp.asarray(SEEN))[0])
    actions, state = policy.predict(SEEN, "kept")
    np.testing.assert_allclose(actions, np.tanh(mean), atol=1e-6)
    assert state == "kept" and actions.dtype == np.float32 and actions.shape == (7, 2)
    assert policy.predict(SEEN[0])[0] == pytest.approx(actions[0], abs=1e-6)
    assert policy.is_stochastic == stochastic
    np.testing.assert_allclose(
        jax.vmap(policy.network())(jnp.asarray(SEEN))[0], mean, rtol=1e-4, atol=1e-6
    )


def test_draws_have_mean_and_deviation_of_the_network():
    policy = ActorPolicy.of(actor(), {})
    mean, deviation = policy.gaussian(SEEN[:1])
    drawn = policy.predict(np.repeat(SEEN[:1], 20_000, axis=0), deterministic=False)[0]
    u = np.arctanh(drawn.astype(np.float64))
    np.testing.assert_allclose(u.mean(axis=0), mean[0], atol=0.05)
    np.testing.assert_allclose(u.std(axis=0), deviation[0], rtol=0.05)


def test_a_saved_policy_comes_back(tmp_path):
    policy = ActorPolicy.of(actor(), {"made": "here"})
    policy.save(tmp_path / "one.safetensors")
    again = ActorPolicy.load(tmp_path / "one.safetensors")
    np.testing.assert_array_equal(again.predict(SEEN)[0], policy.predict(SEEN)[0])
    assert again.provenance == {"made": "here"} and again.sha256


def test_a_dial_is_its_network_at_the_angle(tmp_path):
    network = actor(5)
    ActorDial(ActorPolicy.of(network, {}), 0.0, 90.0).save(tmp_path / "dial.safetensors")
    dial = ActorDial.load(tmp_path / "dial.safetensors")
    assert (dial.n_features, dial.action_size) == (3, 2)
    turned = np.column_stack([SEEN, np.tile(np.cos(np.pi / 3), 7), np.tile(np.sin(np.pi / 3), 7)])
    mean = np.asarray(jax.vmap(network)(jnp.asarray(turned, jnp.float32))[0])
    np.testing.assert_allclose(dial.at(60.0).predict(SEEN)[0], np.tanh(mean), atol=1e-5)
    assert dial.at(60.0).provenance["angle"] == 60.0
    with pytest.raises(UserError, match="outside this dial's range"):
        dial.at(91.0)


def drives(rows: int = 5, times: int = 4) -> np.ndarray:
    """Observations of three vehicles, some of them absent, and of the time."""
    rng = np.random.default_rng(1)
    seen = rng.normal(size=(rows, 3, 7)).astype(np.float32)
    seen[:, :, 0] = rng.random((rows, 3)) < 0.7
    return np.column_stack([seen.reshape(rows, 21), rng.integers(0, times, rows)])


def test_an_actor_with_a_view_is_its_policy_and_its_dial(tmp_path):
    seen = drives().astype(np.float32)
    shape = (jax.random.key(0), 24, (8, 8), 1)
    network = Actor.initialise(*shape, view="set", times=4, extra=2)
    turned = np.column_stack([seen, np.full(5, np.sqrt(0.5)), np.full(5, np.sqrt(0.5))])
    mean = np.asarray(jax.vmap(network)(jnp.asarray(turned, jnp.float32))[0])
    ActorDial(ActorPolicy.of(network, {}), 0.0, 90.0).save(tmp_path / "dial.safetensors")
    dial = ActorDial.load(tmp_path / "dial.safetensors")
    assert (dial.n_features, dial.at(45.0).n_features) == (22, 22)
    np.testing.assert_allclose(dial.at(45.0).predict(seen)[0], np.tanh(mean), atol=1e-5)
    dial.at(45.0).save(tmp_path / "at45.safetensors")
    again = ActorPolicy.load(tmp_path / "at45.safetensors")
    np.testing.assert_allclose(again.predict(seen)[0], np.tanh(mean), atol=1e-5)
    trainable = jax.vmap(again.network())(jnp.asarray(seen))[0]
    np.testing.assert_allclose(trainable, mean, rtol=1e-4, atol=1e-5)


def test_twin_critics_with_a_view_ignore_the_order_of_vehicles():
    critics = TwinCritics.initialise(jax.random.key(0), 22, (8,), 1, view="set", times=4)
    seen = drives().astype(np.float32)
    swapped = seen.copy()
    swapped[:, 7:14], swapped[:, 14:21] = seen[:, 14:21], seen[:, 7:14]
    action = jnp.zeros((5, 1))
    found, other = (jax.vmap(critics)(jnp.asarray(one), action) for one in (seen, swapped))
    assert found.shape == (5, 2)
    np.testing.assert_allclose(found, other, atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"action_size": 3}, "has layers that don't follow one another"),
        ({"action_size": 0}, "has layers that don't follow one another"),
        ({"action_size": "2"}, "has a header that doesn't fit its arrays"),
        ({"activation": "sine"}, "has layers that don't follow one another"),
        ({"squash": "none"}, "has layers that don't follow one another"),
        ({"layers": 9}, "has a header that doesn't fit its arrays"),
        ({"layers": 0}, "must have 1 to 100 layers"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(tmp_path, changes, says):
    path = tmp_path / "bad.safetensors"
    arrays, header = ActorPolicy.of(actor(), {}).content()
    save_arrays(path, "actor", 1, arrays, header | changes)
    with pytest.raises(UserError, match=re.escape(f"{path} {says}: make the file again")):
        ActorPolicy.load(path)


def test_a_dial_without_a_range_is_refused(tmp_path):
    path = tmp_path / "bad.safetensors"
    arrays, header = ActorPolicy.of(actor(5), {}).content()
    save_arrays(path, "actor-dial", 1, arrays, header | {"low": 90.0, "high": 0.0})
    with pytest.raises(UserError, match="no range of angles"):
        ActorDial.load(path)
    assert load_arrays(path, "actor-dial", 1)[1]["high"] == 0.0


def test_bad_observations_are_refused():
    policy = ActorPolicy.of(actor(), {})
    for bad, says in (
        (np.zeros(4), "this policy takes (3,)"),
        (np.full(3, np.nan), "holds NaN or infinity"),
        ({"a": 1}, "is a dict"),
    ):
        with pytest.raises(UserError, match=re.escape(says)):
            policy.predict(bad)
