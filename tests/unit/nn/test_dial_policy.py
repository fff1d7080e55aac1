from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import exact_weights
from socialiq.types import RewardPair

OBSERVATIONS = np.random.default_rng(0).integers(0, 3, (20, 2)).astype(np.float32)
KINDS = {"plain": {}, "one_hot": {"one_hot": ((0, 3), (0, 3))}}


@pytest.fixture(name="network", params=KINDS)
def some_network(request: pytest.FixtureRequest) -> DialNetwork:
    return DialNetwork.initialise(jax.random.key(0), 2, (16, 8), 3, **KINDS[request.param])


@pytest.fixture(name="dial")
def some_dial(network: DialNetwork) -> DialPolicy:
    return DialPolicy.of(network, 0.5, 0.0, 90.0, {"learner": "test"})


def conditioned(network: DialNetwork, angle: float) -> jax.Array:
    """The network itself at an angle."""
    direction = RewardPair(*(jnp.full(len(OBSERVATIONS), one) for one in exact_weights(angle)))
    return jax.vmap(network)(OBSERVATIONS, direction)


@pytest.mark.parametrize("angle", [0.0, 37.0, 90.0])
def test_the_policy_of_an_angle_is_the_network_asked_at_it(
    network: DialNetwork, dial: DialPolicy, angle: float
) -> None:
    expected = conditioned(network, angle)
    np.testing.assert_allclose(dial.at(angle).q_values(OBSERVATIONS), expected, atol=1e-5)
    direction = RewardPair(*map(jnp.asarray, exact_weights(angle)))
    fixed = jax.vmap(network.at(direction))(OBSERVATIONS)
    np.testing.assert_allclose(fixed, expected, atol=1e-5)


def test_angles_have_different_policies(dial: DialPolicy) -> None:
    one, other = (dial.at(angle).q_values(OBSERVATIONS) for angle in (0.0, 90.0))
    assert np.abs(one - other).max() > 0.01


def test_a_turned_dial_is_a_policy_like_any_other(dial: DialPolicy, tmp_path: Path) -> None:
    policy = dial.at(30.0)
    assert isinstance(policy, QPolicy)
    assert (policy.n_features, policy.n_actions, policy.temperature) == (2, 3, 0.5)
    assert policy.provenance == {"learner": "test", "angle": 30.0}
    policy.save(tmp_path / "policy.safetensors")
    again = QPolicy.load(tmp_path / "policy.safetensors")
    np.testing.assert_array_equal(again.q_values(OBSERVATIONS), policy.q_values(OBSERVATIONS))


def test_a_dial_keeps_everything_in_its_file(dial: DialPolicy, tmp_path: Path) -> None:
    dial.save(tmp_path / "dial.safetensors")
    again = DialPolicy.load(tmp_path / "dial.safetensors")
    assert (again.low, again.high, again.n_features, again.n_actions) == (0.0, 90.0, 2, 3)
    for angle in (0.0, 45.0):
        np.testing.assert_array_equal(
            again.at(angle).q_values(OBSERVATIONS), dial.at(angle).q_values(OBSERVATIONS)
        )


def test_a_dial_is_no_policy_until_it_is_turned(dial: DialPolicy, tmp_path: Path) -> None:
    dial.save(tmp_path / "dial.safetensors")
    with pytest.raises(UserError, match="holds dial, not policy"):
        QPolicy.load(tmp_path / "dial.safetensors")
    dial.at(0.0).save(tmp_path / "policy.safetensors")
    with pytest.raises(UserError, match="holds policy, not dial"):
        DialPolicy.load(tmp_path / "policy.safetensors")


@pytest.mark.parametrize("angle", [-1.0, 91.0, float("nan")])
def test_an_angle_that_was_not_trained_is_refused(dial: DialPolicy, angle: float) -> None:
    with pytest.raises(UserError, match=r"choose one in \[0, 90\] degrees"):
        dial.at(angle)
