import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.nn.q_network import QNetwork, network_of


def test_layers_and_output_have_the_asked_shapes():
    network = QNetwork.initialise(jax.random.key(0), 5, (7, 4), 3)
    assert [layer.weight.shape for layer in network.layers] == [(7, 5), (4, 7), (3, 4)]
    assert jax.vmap(network)(jnp.ones((6, 5))).shape == (6, 3)


def test_without_hidden_layers_the_network_is_affine():
    network = QNetwork.initialise(jax.random.key(0), 2, (), 3)
    layer = network.layers[0]
    np.testing.assert_allclose(
        network(jnp.array([2.0, -1.0])),
        2 * layer.weight[:, 0] - layer.weight[:, 1] + layer.bias,
        rtol=1e-5,
    )


@pytest.mark.parametrize("layer", [0, 1])
def test_weights_and_biases_fill_plus_minus_one_over_the_root_of_the_fan_in(layer):
    network = QNetwork.initialise(jax.random.key(1), 16, (400,), 400)
    bound = [1 / 4, 1 / 20][layer]  # 1/sqrt(16), 1/sqrt(400)
    for values in (network.layers[layer].weight, network.layers[layer].bias):
        assert jnp.max(jnp.abs(values)) <= bound
        assert jnp.max(values) > 0.97 * bound
        assert jnp.min(values) < -0.97 * bound
        assert jnp.std(values) == pytest.approx(bound / 3**0.5, rel=0.08)


@pytest.mark.parametrize(
    ("activation", "expected"),
    [("relu", 1.5 + 2 * 0.0 + 0.25), ("elu", 1.5 + 2 * (np.exp(-1.5) - 1) + 0.25)],
)
def test_the_activation_stands_between_the_layers_only(activation, expected):
    drawn = QNetwork.initialise(jax.random.key(0), 2, (2,), 1, activation)
    parameters = [jnp.eye(2), jnp.full(2, 0.5), jnp.array([[1.0, 2.0]]), jnp.array([0.25])]
    network = eqx.tree_at(jax.tree.leaves, drawn, parameters)
    assert network(jnp.array([1.0, -2.0]))[0] == pytest.approx(expected, rel=1e-6)
    assert network(jnp.array([-9.0, -9.0]))[0] <= 0.25  # the last layer is not rectified


def test_network_of_takes_one_lane():
    keys = jax.random.split(jax.random.key(2), 3)
    runs = jax.vmap(lambda key: QNetwork.initialise(key, 4, (5,), 2))(keys)
    alone = QNetwork.initialise(keys[1], 4, (5,), 2)
    observation = jnp.arange(4.0)
    np.testing.assert_allclose(network_of(runs, 1)(observation), alone(observation), rtol=1e-6)
    assert not np.allclose(network_of(runs, 0)(observation), alone(observation))
