"""Batches of the baselines: pairs of one set, levels, outcomes; gradients that must not flow."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.state import stack
from socialiq.nn.dial_network import DialNetwork
from socialiq.types import RewardPair
from socialiq_lab.baselines import Episodes
from studies.compare_methods.baselines.clones import (
    CLIPPED,
    DiscriminatorWeighted,
    DWBCConfig,
    DWBCHyperparameters,
    DWBCNetworks,
    OutcomeConditioned,
    OutcomeHyperparameters,
)
from studies.compare_methods.baselines.offline import (
    LARGEST_WEIGHT,
    SPRINQL,
    ImplicitQLearning,
    IntentionConfig,
    IntentionHyperparameters,
    IQLHyperparameters,
    IQLNetworks,
    MultiIntention,
    SPRINQLConfig,
    SPRINQLHyperparameters,
    ValueConfig,
)


def drawn(learner, run):
    """The first batch of a run, and the next carry."""
    return jax.jit(lambda run: learner.draw(run, *learner.initialise(run)))(run)


def test_pairs_are_of_one_set_and_ranked_by_their_scores(bandit):
    """Two sets of one-step episodes, whose rows know their episode by r_social."""
    sets = [bandit([0] * 3, [0.0] * 3, [0.0, 1.0, 2.0]), bandit([1] * 2, [0.0] * 2, [3.0, 4.0])]
    table = ExpertTable.of(sets, "instantaneous", 1.0)
    episodes = Episodes.of(sets, table)
    scores = jnp.array([5.0, 1.0, 3.0, -2.0, -2.0])
    for dataset, members in ((0, {0.0, 1.0, 2.0}), (1, {3.0, 4.0})):
        options = jax.random.key(dataset), jnp.array(dataset), 40, scores
        pairs = episodes.pairs(table, *options)
        first, second = np.asarray(pairs.rows.target.social)[..., 0].astype(int)
        assert {*first.tolist(), *second.tolist()} == members and pairs.inside.all()
        np.testing.assert_array_equal(pairs.better, scores[first] - scores[second])


def test_graded_rows_and_pairs_have_the_levels_of_their_episodes(bandit):
    data = bandit([0] * 6, [0.0] * 6, [5.0, 4.0, 3.0, 2.0, 1.0, 0.0])
    learner = SPRINQL.of(SPRINQLConfig(batch_size=50, levels=3, pairs=20), [data])
    run = stack([SPRINQLHyperparameters(90.0)])[0]
    (rows, level, pairs), _ = drawn(learner, run)
    np.testing.assert_array_equal(level, (5 - np.asarray(rows.target.social)) // 2)
    levels = (5 - np.asarray(pairs.rows.target.social)[..., 0]) // 2
    np.testing.assert_array_equal(pairs.better, levels[1] - levels[0])


def test_an_outcome_is_scaled_by_the_run_s_own_set(bandit):
    """Totals (0, 1) and (4, 3): mean (2, 2), deviation (2, 1); the other set has none to vary."""
    sets = [bandit([0, 1], [0.0, 4.0], [1.0, 3.0]), bandit([0, 0], [9.0, 9.0], [9.0, 9.0])]
    learner = OutcomeConditioned.of(DWBCConfig(batch_size=20), sets)
    for dataset, action_outcomes in ((0, {0: (-1, -1), 1: (1, 1)}), (1, {0: (0, 0)})):
        run = stack([OutcomeHyperparameters(dataset=dataset)])[0]
        (rows, outcome), _ = drawn(learner, run)
        pairs = {
            int(action): (round(float(env)), round(float(social)))
            for action, env, social in zip(rows.action, *outcome, strict=True)
        }
        assert pairs == action_outcomes


def networks_of(discriminator_bias: float, constant) -> DWBCNetworks:
    drawn = DialNetwork.initialise(jax.random.key(0), 1, (), 2)
    leaves = [jnp.zeros_like(leaf) for leaf in jax.tree.leaves(drawn)]
    leaves[-1] = leaves[-1] + discriminator_bias
    judge = jax.tree.unflatten(jax.tree.structure(drawn), leaves)
    return DWBCNetworks(constant(0.0, 1.0), judge)


@pytest.mark.parametrize("bias", [0.0, 50.0])
def test_the_clone_s_rows_have_the_weights_of_the_discriminator(constant, rows_of, bias):
    """d = σ(bias), clipped; the expert's row is of action 1, the other of action 0."""
    learner = DiscriminatorWeighted(DWBCConfig(), (1, 2))
    run = stack([DWBCHyperparameters(expert_weight=7.5, positive_share=0.5)])[0]
    batch = rows_of([1], [0.0]), rows_of([0], [0.0])
    network = networks_of(bias, constant)
    _, terms = jax.jit(lambda *of_run: learner.loss(*of_run))(network, network, batch, run)
    chance = min(1 / (1 + np.exp(-bias)), CLIPPED[1])
    zero, one = -np.log1p(np.e), 1 - np.log1p(np.e)
    expected = -(7.5 - 0.5 / (chance * (1 - chance))) * one - zero / (1 - chance)
    assert terms["clone"] == pytest.approx(expected, rel=1e-5)


def test_neither_part_learns_from_the_other_s_loss(constant, rows_of):
    learner = DiscriminatorWeighted(DWBCConfig(), (1, 2))
    run = stack([DWBCHyperparameters()])[0]
    batch, network = (rows_of([1], [0.0]), rows_of([0], [0.0])), networks_of(0.3, constant)

    def slopes(term: str) -> DWBCNetworks:
        def loss(given):
            return learner.loss(given, network, batch, run)[1][term]

        gradient = jax.jit(jax.grad(loss))(network)
        return DWBCNetworks(
            *(max(float(jnp.abs(leaf).max()) for leaf in jax.tree.leaves(one)) for one in gradient)
        )

    assert slopes("clone").policy > 0.0 == slopes("clone").discriminator
    assert slopes("discriminator").discriminator > 0.0 == slopes("discriminator").policy


def test_the_weight_of_a_cloned_row_is_bounded(constant, rows_of):
    """exp(10 (3 - 0)) is far above 100, so -log π(1) = ln 2 counts 100 times."""
    network = IQLNetworks(constant(0.0, 3.0), constant(0.0), constant(0.0, 0.0))
    run = stack([IQLHyperparameters(90.0, inverse_temperature=10.0)])[0]
    learner = ImplicitQLearning(ValueConfig(), (1, 2))
    _, terms = learner.loss(network, network, rows_of([1], [3.0]), run)
    assert terms["policy"] == pytest.approx(LARGEST_WEIGHT * np.log(2), rel=1e-5)


def test_an_intention_is_scored_by_its_episodes(bandit):
    """The first of three intentions has the egoists' episode, the second the altruists'."""
    data = bandit([0, 1], [4.0, 0.0], [0.0, 2.0])
    learner = MultiIntention.of(IntentionConfig(hidden=(), intentions=3), [data])
    run = IntentionHyperparameters()
    state, _ = learner.initialise(stack([run])[0])
    policy = learner.policy(run, state, np.array([[1.0, 0.0, 0.0], [0.5, 0.5, 0.0]]))
    np.testing.assert_allclose(policy.totals[:2], [[8 / 3, 2 / 3], [0.0, 2.0]])
    assert np.isneginf(policy.totals[2]).all()
    assert policy.at(10.0) is policy.policies[0] and policy.at(80.0) is policy.policies[1]


def test_rows_of_an_intention_count_by_its_responsibilities(constant, rows_of):
    """Loss of rows with z = (1, 0) and (0, 1) is that of each intention on its own row."""
    learner = MultiIntention(IntentionConfig(intentions=2), (1, 2))
    run = stack([IntentionHyperparameters(discount=0.9)])[0]
    networks = constant(0.3, 1.1), constant(2.0, -1.0)
    steady = constant(0.0, 0.5), constant(1.0, 1.0)
    batch = rows_of([0, 1], [0.0, 0.0], ending=0)
    joint, _ = learner.loss(networks, steady, (batch, jnp.eye(2)), run)
    alone = MultiIntention(IntentionConfig(intentions=1), (1, 2))
    rows = [jax.tree.map(lambda column, k=k: column[k : k + 1], batch) for k in range(2)]
    apart = [
        alone.loss((network,), (slow,), (row, jnp.ones((1, 1))), run)[0]
        for network, slow, row in zip(networks, steady, rows, strict=True)
    ]
    assert joint == pytest.approx(float(sum(apart)) / 2, rel=1e-6)


def test_the_pair_of_a_row_is_kept_apart(bandit):
    """Demonstrations come with (r_env, r_social), which only the angle joins."""
    data = bandit([0, 1], [1.0, 2.0], [3.0, 4.0])
    table = ExpertTable.of([data], "instantaneous", 1.0)
    episodes = Episodes.of([data], table)
    angles = [
        RewardPair(jnp.array(1.0), jnp.array(0.0)),
        RewardPair(jnp.array(0.0), jnp.array(-1.0)),
    ]
    levels = [episodes.levels(weights, jnp.array(0), 2).tolist() for weights in angles]
    assert levels == [[1, 0], [0, 1]]
