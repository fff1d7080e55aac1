import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.state import stack
from studies.compare_methods.baselines.offline import (
    ImplicitQLearning,
    IQLHyperparameters,
    IQLNetworks,
    ValueConfig,
)

LEARNER = ImplicitQLearning(ValueConfig(), (1, 2))


@pytest.mark.parametrize("expectile", [0.5, 0.7, 0.9])
def test_a_bandit_of_two_actions_has_its_known_solution(constant, rows_of, expectile):
    """Rewards 0 and 1, alike often: Q = (0, 1), V = τ, and odds e^β between the actions.

    τ (1 - V) = (1 - τ) V gives V = τ. There no loss has a slope.
    """
    beta = 2.0
    network = IQLNetworks(constant(0.0, 1.0), constant(expectile), constant(0.0, beta))
    run = stack([IQLHyperparameters(90.0, expectile=expectile, inverse_temperature=beta)])[0]
    batch = rows_of([0, 1], [0.0, 1.0])

    def loss(given: IQLNetworks) -> jax.Array:
        return LEARNER.loss(given, network, batch, run)[0]

    for leaf in jax.tree.leaves(jax.grad(loss)(network)):
        np.testing.assert_allclose(leaf, 0.0, atol=1e-6)
    off = IQLNetworks(constant(0.0, 1.0), constant(expectile + 0.1), constant(0.0, beta))
    assert max(float(jnp.abs(leaf).max()) for leaf in jax.tree.leaves(jax.grad(loss)(off))) > 0.01


def test_the_expectile_loss_by_hand(constant, rows_of):
    """Q - V is 2 and -1."""
    network = IQLNetworks(constant(2.0, -1.0), constant(0.0), constant(0.0, 0.0))
    run = stack([IQLHyperparameters(90.0, expectile=0.9)])[0]
    _, terms = LEARNER.loss(network, network, rows_of([0, 1], [0.0, 0.0]), run)
    assert terms["state_value"] == pytest.approx((0.9 * 4 + 0.1 * 1) / 2)


def test_q_follows_the_value_of_the_next_state(constant, rows_of):
    """r = 1, γ = 0.5 and V(s') = 4 make the target 3."""
    network = IQLNetworks(constant(3.0, 0.0), constant(4.0), constant(0.0, 0.0))
    run = stack([IQLHyperparameters(90.0, discount=0.5)])[0]
    batch = rows_of([0], [1.0], ending=0)
    _, terms = LEARNER.loss(network, network, batch, run)
    assert terms["values"] == pytest.approx(0.0)


@pytest.mark.slow
def test_it_trains_and_prefers_the_better_action(bandit):
    data = bandit([0, 1] * 20, [0.0] * 40, [0.0, 1.0] * 20)
    static = ValueConfig(hidden=(8,), batch_size=16, updates=400)
    trained = ImplicitQLearning.train_on(
        static, [IQLHyperparameters(90.0, learning_rate=0.01)], [data]
    )
    chances = trained.policy(0).probabilities(data.observation[:1])[0]
    assert trained.failures == () and chances[1] > 0.8


@pytest.mark.usefixtures("as_a_user_runs_it")
def test_settings_that_make_no_run_are_refused():
    for wrong in ({"expectile": 1.5}, {"inverse_temperature": 0.0}):
        with pytest.raises(UserError):
            IQLHyperparameters(**wrong)
