import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.cql import (
    ConservativeQ,
    CQLConfig,
    CQLHyperparameters,
)
from socialiq.learners.expert_table import Batch
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.state import stack
from socialiq.nn.q_network import QNetwork
from socialiq.types import Ending, RewardPair

SMALL = CQLConfig(hidden=(8,), batch_size=8, updates=60)
RUNS = (CQLHyperparameters(seed=0, angle=45.0), CQLHyperparameters(seed=1, angle=45.0))


def constant(*q: float) -> QNetwork:
    """A network that tells these values of every state."""
    drawn = QNetwork.initialise(jax.random.key(0), 1, (), len(q))
    leaves = [jnp.zeros((len(q), 1)), jnp.array(q)]
    return jax.tree.unflatten(jax.tree.structure(drawn), leaves)


@pytest.mark.parametrize(
    ("ending", "endings", "follows"),
    [
        (Ending.NONE, Endings(), 2 * np.log(4)),
        (Ending.ARRIVAL, Endings(), 0.0),
        (Ending.TIMEOUT, Endings(timeout="bootstrap"), 2 * np.log(4)),
        (Ending.COLLISION, Endings(collision="absorbing"), 2 * np.log(2) / (1 - 0.5)),
    ],
)
def test_the_loss_by_hand(ending, endings, follows):
    """Q = (1, 1 + 2 ln 3), action 1, slow Q = 2 ln 2 twice; τ = 2, γ = 0.5, λ = 3, α_CQL = 0.7.

    V = 1 + 2 ln 4, so V - Q is 2 ln (4/3); V(s') = 2 ln 4; R at 90 degrees is r_social.
    """
    network, target_network = (
        constant(1.0, 1 + 2 * np.log(3)),
        constant(2 * np.log(2), 2 * np.log(2)),
    )
    one = jnp.ones((1, 1))
    batch = Batch(
        one,
        jnp.array([1]),
        one,
        jnp.array([int(ending)]),
        RewardPair(jnp.array([9.0]), jnp.array([0.4])),
    )
    hyperparameters = CQLHyperparameters(90.0, 3.0, conservatism=0.7, temperature=2.0, discount=0.5)
    run = stack([hyperparameters])[0]
    learner = ConservativeQ(CQLConfig(endings=endings), (1, 2))
    loss, terms = learner.loss(network, target_network, batch, run)
    error = 1 + 2 * np.log(3) - 0.5 * follows - 1.2
    assert terms["bellman"] == pytest.approx(error**2 / 2, rel=1e-5)
    assert terms["conservative"] == pytest.approx(0.7 * 2 * np.log(4 / 3), rel=1e-5)
    assert loss == pytest.approx(float(terms["bellman"] + terms["conservative"]), rel=1e-6)


def test_runs_are_sound_and_repeat_bit_for_bit(data, assert_same):
    found = ConservativeQ.train_on(SMALL, RUNS, [data], chunk=20)
    assert found.failures == ()
    assert found.history.updates == [20, 40, 60]
    assert set(found.history.values) == {"bellman", "conservative", "loss", "max_q"}
    assert_same(ConservativeQ.train_on(SMALL, RUNS, [data], chunk=20).networks, found.networks)
    first, second = (found.policy(run).q_values(data.observation) for run in (0, 1))
    assert not np.allclose(first, second)


def test_the_target_network_moves_by_polyak_and_values_what_follows(data):
    """By hand after each of two updates; and two rates train two networks."""
    learner = ConservativeQ.of(SMALL, [data])
    run = stack([dataclasses.replace(RUNS[0], polyak=0.25, learning_rate=0.01)])[0]
    state, carry = learner.initialise(run)
    update = jax.jit(lambda *of_run: learner.update(*of_run))
    for _ in range(2):
        after, carry, _ = update(run, state, carry)
        for old, new, target in zip(
            *map(jax.tree.leaves, (state.target_network, after.network, after.target_network)),
            strict=True,
        ):
            np.testing.assert_allclose(target, 0.75 * old + 0.25 * new, atol=1e-6)
            assert np.abs(new - old).max() > 1e-3
        state = after
    rates = [dataclasses.replace(RUNS[0], polyak=polyak, discount=0.9) for polyak in (0.01, 1.0)]
    trained = ConservativeQ.train_on(SMALL, rates, [data], chunk=60)
    first, second = (trained.policy(run).q_values(data.observation) for run in (0, 1))
    assert np.abs(first - second).max() > 1e-3


def test_a_policy_carries_its_origin_and_temperature(data):
    hyperparameters = dataclasses.replace(RUNS[0], temperature=0.3)
    policy = ConservativeQ.train_on(SMALL, [hyperparameters], [data], chunk=60).policy(0)
    assert policy.provenance["learner"] == "cql"
    assert CQLHyperparameters(**policy.provenance["numbers"]) == hyperparameters
    assert policy.temperature == 0.3


def test_a_network_that_blows_up_is_told(data):
    found = ConservativeQ.train_on(
        SMALL, [RUNS[0], dataclasses.replace(RUNS[1], learning_rate=1e30)], [data]
    )
    assert len(found.failures) == 1
    assert found.failures[0].startswith("angle 45, seed 1 stopped at update 0")


def test_runs_without_demonstrations_are_refused(data):
    for hyperparameters in ([], [CQLHyperparameters(dataset=1)]):
        with pytest.raises(UserError, match="the demonstrations that each run names"):
            ConservativeQ.train_on(SMALL, hyperparameters, [data])


@pytest.mark.usefixtures("as_a_user_runs_it")
@pytest.mark.parametrize(
    "make",
    [
        lambda: CQLConfig(activation="gelu"),
        lambda: CQLConfig(view="round"),
        lambda: CQLConfig(batch_size=0),
        lambda: CQLConfig(updates=0),
        lambda: CQLHyperparameters(angle=-1.0),
        lambda: CQLHyperparameters(strength=-1.0),
        lambda: CQLHyperparameters(conservatism=float("nan")),
        lambda: CQLHyperparameters(temperature=0.0),
        lambda: CQLHyperparameters(learning_rate=0.0),
        lambda: CQLHyperparameters(discount=1.0),
        lambda: CQLHyperparameters(polyak=0.0),
        lambda: CQLHyperparameters(seed=-1),
        lambda: CQLHyperparameters(dataset=-1),
    ],
)
def test_settings_that_make_no_run_are_refused(make):
    with pytest.raises(UserError) as caught:
        make()
    assert "\n" not in str(caught.value)
