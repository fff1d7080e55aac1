import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.nn.one_hot import OneHot
from socialiq.nn.q_network import QNetwork, affine_layers
from socialiq.nn.q_policy import QPolicy

PLACES = OneHot.of(((0, 3), (-1, 2)))


@pytest.mark.parametrize("xp", [np, jnp])
def test_each_value_has_a_place_of_its_own(xp) -> None:
    rows = xp.asarray(np.array([[0, -1], [2, 0]], np.float32))
    expected = [[1, 0, 0, 1, 0], [0, 0, 1, 0, 1]]
    np.testing.assert_array_equal(PLACES(rows), expected)
    np.testing.assert_array_equal(PLACES(rows[0]), expected[0])
    assert (PLACES.n_features, PLACES.width) == (2, 5)


def test_a_value_outside_its_range_has_no_place() -> None:
    assert PLACES(np.array([7.0, 0.0], np.float32)).tolist() == [0, 0, 0, 0, 1]


def test_features_without_values_are_refused() -> None:
    with pytest.raises(UserError, match="one_hot needs"):
        OneHot.of(())
    with pytest.raises(UserError, match="one_hot needs"):
        OneHot.of(((0, 0),))


def test_a_policy_keeps_its_places_in_its_file(tmp_path) -> None:
    network = QNetwork(affine_layers(jax.random.key(0), (5, 8, 3)), "relu", PLACES)
    policy = QPolicy.of(network, 1.0, {})
    rows = np.array([[0, -1], [2, 0], [1, 0]], np.float32)
    np.testing.assert_allclose(policy.q_values(rows), jax.vmap(network)(rows), atol=1e-6)
    policy.save(tmp_path / "policy.safetensors")
    again = QPolicy.load(tmp_path / "policy.safetensors")
    assert again.n_features == 2
    np.testing.assert_array_equal(again.q_values(rows), policy.q_values(rows))
