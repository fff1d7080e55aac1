import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.state import TrainState, stack


@dataclasses.dataclass(frozen=True)
class Settings:
    angle: float = 90.0
    rate: float = 0.5
    seed: int = 2**32 - 1
    dataset: int = 1


def test_the_first_step_of_adam_is_the_learning_rate_by_the_sign_and_the_target_follows():
    state = TrainState.of({"w": jnp.array([1.0, -2.0])})
    after = state.step({"w": jnp.array([3.0, -0.1])}, learning_rate=0.5, polyak=0.2)
    np.testing.assert_allclose(after.network["w"], [0.5, -1.5], rtol=1e-5)
    np.testing.assert_allclose(after.target_network["w"], [0.9, -1.9], rtol=1e-5)
    again = after.step({"w": jnp.zeros(2)}, learning_rate=0.0, polyak=1.0)
    np.testing.assert_array_equal(again.target_network["w"], after.network["w"])
    assert again.optimiser.count == 2


def test_each_part_of_a_network_may_have_a_learning_rate_of_its_own():
    weights = {"actor": {"w": jnp.ones(1)}, "critic": {"w": jnp.ones(1), "b": jnp.ones(1)}}
    gradient = {"actor": {"w": jnp.ones(1)}, "critic": {"w": jnp.ones(1), "b": -jnp.ones(1)}}
    state = TrainState.of(weights, has_target=False)
    after = state.step(gradient, {"actor": 0.1, "critic": 0.5}, 0.0).network
    np.testing.assert_allclose(after["actor"]["w"], [0.9], rtol=1e-5)
    np.testing.assert_allclose(after["critic"]["w"], [0.5], rtol=1e-5)
    np.testing.assert_allclose(after["critic"]["b"], [1.5], rtol=1e-5)
    whole, parts = (
        jax.tree.leaves(state.step(gradient, rate, 0.0).network)
        for rate in (0.3, {"actor": 0.3, "critic": 0.3})
    )
    np.testing.assert_array_equal(whole, parts)


def test_a_learner_without_a_target_network_has_none_after_a_step():
    state = TrainState.of({"w": jnp.ones(1)}, has_target=False)
    assert state.step({"w": jnp.ones(1)}, 0.1, 0.0).target_network is None


def test_hyperparameters_are_stacked_with_their_types_and_the_angle_as_weights():
    stacked = stack([Settings(), Settings(angle=0.0, rate=2.0, seed=3, dataset=0)])
    assert (stacked.seed.dtype, stacked.dataset.dtype) == (jnp.uint32, jnp.int32)
    assert stacked.seed.tolist() == [2**32 - 1, 3]
    assert stacked.weights.env.tolist() == [0.0, 1.0]  # exact at the quarter turns
    assert stacked.weights.social.tolist() == [1.0, 0.0]
    assert float(stacked[1].rate) == 2.0
    assert float(stacked[0].replace(rate=jnp.asarray(7.0)).rate) == 7.0
    with pytest.raises(AttributeError, match="no hyperparameter 'angle'"):
        _ = stacked.angle


def test_a_hyperparameter_that_is_no_number_is_refused():
    @dataclasses.dataclass(frozen=True)
    class Named:
        kind: str = "l1"
        seed: int = 0

    with pytest.raises(UserError, match="hyperparameter 'kind' must be a number"):
        stack([Named()])
