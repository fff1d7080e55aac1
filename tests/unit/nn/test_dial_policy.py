import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy, knots_between
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.view import hats
from socialiq.social.angle import exact_weights
from socialiq.storage import load_arrays, save_arrays
from socialiq.types import RewardPair

OBSERVATIONS = np.random.default_rng(0).integers(0, 3, (20, 2)).astype(np.float32)
KINDS = {
    "plain": {},
    "one_hot": {"one_hot": ((0, 3), (0, 3))},
    "pairs": {"pairs": True},
    "knots": {"knots": knots_between(-5.0, 95.0, 6)},
}


@pytest.fixture(name="network", params=KINDS)
def some_network(request):
    return DialNetwork.initialise(jax.random.key(0), 2, (16, 8), 3, **KINDS[request.param])


@pytest.fixture(name="dial")
def some_dial(network):
    return DialPolicy.of(network, 0.5, 0.0, 90.0, {"learner": "test"})


def conditioned(network: DialNetwork, angle: float) -> jax.Array:
    """The network itself at an angle."""
    direction = RewardPair(*(jnp.full(len(OBSERVATIONS), one) for one in exact_weights(angle)))
    return jax.vmap(network)(OBSERVATIONS, direction)


@pytest.mark.parametrize("angle", [0.0, 37.0, 90.0])
def test_the_policy_of_an_angle_is_the_network_asked_at_it(network, dial, angle):
    expected = conditioned(network, angle)
    np.testing.assert_allclose(dial.at(angle).q_values(OBSERVATIONS), expected, atol=1e-5)
    direction = RewardPair(*map(jnp.asarray, exact_weights(angle)))
    fixed = jax.vmap(network.at(direction))(OBSERVATIONS)
    np.testing.assert_allclose(fixed, expected, atol=1e-5)


def test_each_observation_may_have_an_angle_of_its_own(dial):
    angles = np.linspace(0.0, 90.0, len(OBSERVATIONS))
    found = dial.q_values_at(OBSERVATIONS, angles)
    for row, angle in enumerate(angles.tolist()):
        alone = dial.at(angle).q_values(OBSERVATIONS)[row]
        np.testing.assert_allclose(found[row], alone, atol=2e-6)
    with pytest.raises(UserError, match="outside this dial's range"):
        dial.q_values_at(OBSERVATIONS, angles + 1.0)


def test_the_value_of_pairs_is_their_score():
    network = DialNetwork.initialise(jax.random.key(0), 2, (8,), 3, pairs=True)
    direction = RewardPair(*map(jnp.asarray, exact_weights(30.0)))
    both = network.value_pair(jnp.asarray(OBSERVATIONS[1]), direction)
    assert both.env.shape == both.social.shape == (3,)
    expected = np.cos(np.pi / 6) * both.env + 0.5 * both.social
    np.testing.assert_allclose(network(jnp.asarray(OBSERVATIONS[1]), direction), expected, 1e-5)


def test_a_single_layer_of_pairs_is_turned_at_both_ends():
    network = DialNetwork.initialise(jax.random.key(0), 2, (), 3, pairs=True)
    policy = DialPolicy.of(network, 0.5, 0.0, 90.0, {}).at(60.0)
    np.testing.assert_allclose(policy.q_values(OBSERVATIONS), conditioned(network, 60.0), atol=1e-5)


def test_sums_of_hats_are_the_functions_that_are_linear_between_knots():
    knots = knots_between(-5.0, 95.0, 11)
    angles = np.linspace(-5.0, 95.0, 73)
    heights = np.random.default_rng(0).normal(size=11)
    found = hats(angles, knots) @ heights
    np.testing.assert_allclose(found, np.interp(angles, knots, heights), atol=1e-5)
    np.testing.assert_allclose(hats(angles + 360.0, knots), hats(angles, knots), atol=1e-5)


def test_a_layer_that_reads_hats_has_a_kink_at_a_knot():
    """Without hidden layers: linear between knots, which (cos α, sin α) alone can't have."""
    network = DialNetwork.initialise(jax.random.key(0), 2, (), 3, knots=(0.0, 45.0, 90.0))
    first = network.layers[0]
    zero = jnp.zeros_like(first.weight).at[:, -2].set(1.0)  # the hat around 45 degrees
    network = eqx.tree_at(lambda one: one.layers[0].weight, network, zero)
    base = conditioned(network, 0.0)
    for angle, height in ((15.0, 1 / 3), (45.0, 1.0), (60.0, 2 / 3), (90.0, 0.0)):
        np.testing.assert_allclose(conditioned(network, angle) - base, height, atol=1e-5)


@pytest.mark.parametrize(
    "knots", [[0.0], [0.0, 10.0, 15.0], [0.0, 0.0], ["a", "b"], 3, [0.0, 400.0]]
)
def test_knots_at_unequal_distances_are_refused(tmp_path, knots):
    network = DialNetwork.initialise(jax.random.key(0), 2, (8,), 3, knots=(0.0, 90.0))
    arrays, header = DialPolicy.of(network, 0.5, 0.0, 90.0, {}).turned.content()
    header |= {"low": 0.0, "high": 90.0, "pairs": False, "settings": [], "knots": knots}
    save_arrays(tmp_path / "dial.safetensors", "dial", 2, arrays, header)
    with pytest.raises(UserError, match="no angles of its hat functions"):
        DialPolicy.load(tmp_path / "dial.safetensors")


@pytest.mark.parametrize("kind", ["pairs", "knots"])
def test_a_program_of_version_1_would_refuse_it(tmp_path, kind):
    network = DialNetwork.initialise(jax.random.key(0), 2, (8,), 3, **KINDS[kind])
    DialPolicy.of(network, 0.5, 0.0, 90.0, {}).save(tmp_path / "dial.safetensors")
    with pytest.raises(UserError, match="schema version 2, this program reads version 1"):
        load_arrays(tmp_path / "dial.safetensors", "dial", 1)


def test_an_odd_number_of_outputs_has_no_pairs(tmp_path):
    network = DialNetwork.initialise(jax.random.key(0), 2, (8,), 3)
    dial = DialPolicy(DialPolicy.of(network, 0.5, 0.0, 90.0, {}).turned, 0.0, 90.0, pairs=True)
    dial.save(tmp_path / "dial.safetensors")
    with pytest.raises(UserError, match="no pair of values for each action"):
        DialPolicy.load(tmp_path / "dial.safetensors")


def test_settings_turn_the_network_to_other_angles(dial, tmp_path):
    told = dataclasses.replace(dial, settings=((0.0, 10.0), (20.0, 45.0), (80.0, 70.0)))
    told.save(tmp_path / "dial.safetensors")
    again = DialPolicy.load(tmp_path / "dial.safetensors")
    assert again.settings == told.settings and again.pairs == dial.pairs
    for asked, setting in ((0.0, 10.0), (19.9, 10.0), (20.0, 45.0), (90.0, 70.0)):
        assert again.setting(asked) == setting
        q = again.at(asked).q_values(OBSERVATIONS)
        np.testing.assert_array_equal(q, dial.at(setting).q_values(OBSERVATIONS))
        assert again.at(asked).provenance["setting"] == setting


@pytest.mark.parametrize("settings", [((0.0, 100.0),), ((5.0, 1.0), (4.0, 2.0)), ((0.0,),), (1,)])
def test_settings_beyond_the_range_or_out_of_order_are_refused(dial, tmp_path, settings):
    arrays, header = dial.turned.content()
    header |= {"low": 0.0, "high": 90.0, "pairs": dial.pairs, "settings": settings}
    save_arrays(tmp_path / "dial.safetensors", "dial", 2, arrays, header)
    with pytest.raises(UserError, match="no settings of angles"):
        DialPolicy.load(tmp_path / "dial.safetensors")


def test_angles_have_different_policies(dial):
    one, other = (dial.at(angle).q_values(OBSERVATIONS) for angle in (0.0, 90.0))
    assert np.abs(one - other).max() > 0.01


def test_a_turned_dial_is_a_policy_like_any_other(dial, tmp_path):
    policy = dial.at(30.0)
    assert isinstance(policy, QPolicy)
    assert (policy.n_features, policy.n_actions, policy.temperature) == (2, 3, 0.5)
    assert policy.provenance == {"learner": "test", "angle": 30.0}
    policy.save(tmp_path / "policy.safetensors")
    again = QPolicy.load(tmp_path / "policy.safetensors")
    np.testing.assert_array_equal(again.q_values(OBSERVATIONS), policy.q_values(OBSERVATIONS))


def test_a_dial_keeps_everything_in_its_file(dial, tmp_path):
    dial.save(tmp_path / "dial.safetensors")
    again = DialPolicy.load(tmp_path / "dial.safetensors")
    assert (again.low, again.high, again.n_features, again.n_actions) == (0.0, 90.0, 2, 3)
    for angle in (0.0, 45.0):
        np.testing.assert_array_equal(
            again.at(angle).q_values(OBSERVATIONS), dial.at(angle).q_values(OBSERVATIONS)
        )


def test_a_dial_is_no_policy_until_it_is_turned(dial, tmp_path):
    dial.save(tmp_path / "dial.safetensors")
    with pytest.raises(UserError, match="holds dial, not policy"):
        QPolicy.load(tmp_path / "dial.safetensors")
    dial.at(0.0).save(tmp_path / "policy.safetensors")
    with pytest.raises(UserError, match="holds policy, not dial"):
        DialPolicy.load(tmp_path / "policy.safetensors")


@pytest.mark.parametrize("angle", [-1.0, 91.0, float("nan")])
def test_an_angle_that_was_not_trained_is_refused(dial, angle):
    with pytest.raises(UserError, match=r"choose one in \[0, 90\] degrees"):
        dial.at(angle)
