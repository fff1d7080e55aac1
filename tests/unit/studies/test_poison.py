"""The study `poison`: sets that share a training, attackers' data, breakdown points."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq import Demonstrations, RewardPair
from socialiq.learners.behaviour_cloning import CloningConfig, CloningHyperparameters
from socialiq.types import Ending
from studies.poison import robust
from studies.poison.places import Grid, Poison, Road, contaminated
from studies.poison.study import CASES, breakdowns


def test_sets_that_are_equal_share_a_training():
    forged = Poison("rammer", "forged", 0.2, 3)
    assert forged.training(True) == forged
    assert forged.training(False) == Poison("rammer", "honest", 0.2, 3)
    assert Poison("adaptive", "forged", 0.2, 3).training(False).attacker == "hater"
    for attacker in ("hater", "rammer", "adaptive"):
        cleaned = Poison(attacker, "recomputed", 0.2, 3)
        assert cleaned.training(True) == Poison("hater", "recomputed", 0.2, 3)
        clean = Poison(attacker, "forged", 0.0, 3)
        assert clean.training(True) == Poison("hater", "honest", 0.0, 3)


@pytest.mark.parametrize("attacker", ["hater", "rammer", "adaptive"])
def test_labels_computed_again_leave_the_same_honest_episodes(attacker):
    grid = Grid(SimpleNamespace(each=10, audit_episodes=1, seeds=(1,)))
    poisoned = contaminated(grid, Poison(attacker, "forged", 0.2, 1))
    cleaned = contaminated(grid, Poison(attacker, "recomputed", 0.2, 1))
    assert (poisoned.n_episodes, cleaned.n_episodes) == (30, 24)
    assert poisoned.counts()["malicious"][0] == 6 and cleaned.counts()["malicious"][0] == 0


def test_a_breakdown_is_the_first_share_beyond_the_limit_with_a_bootstrap_over_seeds():
    regret = {0.0: (0.1, 0.2), 0.1: (0.2, 0.9), 0.2: (0.6, 0.9), 0.5: (0.0, 0.0)}
    rows = [
        {"share": share, "seed": seed, "regret": value, "collision": 0.3 + share / 20}
        for share, values in regret.items()
        for seed, value in enumerate(values)
    ]
    of_regret, of_collision = breakdowns(rows)
    assert [of_regret[name] for name in ("share", "low", "high")] == [0.1, 0.1, 0.2]
    assert [of_collision[name] for name in ("share", "low", "high")] == [0.5, 0.5, 0.5]
    assert breakdowns(rows[:2])[0]["share"] == 1.0


def test_medians_of_means_ignore_a_minority_of_blocks():
    """16 blocks of 4: labels forged in 7 blocks don't count, in 9 they do."""
    rewards = jnp.zeros(64)
    few, many = (rewards.at[: 4 * blocks].set(100.0) for blocks in (7, 9))
    assert robust.median_of_means(rewards, few, 1.0) == 0.0
    assert robust.median_of_means(rewards, many, 1.0) == 10_000.0
    even = jnp.full(64, 3.0)
    assert robust.median_of_means(rewards, even, 0.5) == 2.25


def test_confidence_is_the_rank_in_the_set_and_constant_confidence_is_iq_learn():
    inside = jnp.array([True, True, True, True, False])
    ranks = robust.confidences(jnp.array([3.0, -1.0, 3.0, 7.0, 99.0]), inside)
    assert ranks.tolist() == [0.75, 0.25, 0.75, 1.0, 0.0]
    assert robust.confidences(jnp.ones(5), inside).tolist() == [1.0, 1.0, 1.0, 1.0, 0.0]


def test_with_a_symmetric_loss_noise_in_demonstrations_drops_out_of_the_risk():
    """RIL-Co: with λ = α, R(g; αE + (1-α)N, λπ + (1-λ)N) = α R(g; E, π) + (1 - α) / 2."""
    expert, noise, own = (jax.random.normal(jax.random.key(n), (50,)) + n for n in range(3))
    loss = robust.symmetric_loss
    np.testing.assert_allclose(loss(expert) + loss(-expert), 1.0, rtol=1e-6)
    assert robust.LAMBDA == 0.5
    mixed = robust.risk(jnp.concatenate([expert, noise]), own, noise)
    clean = (loss(expert).mean() + loss(-own).mean()) / 2
    assert float(mixed) == pytest.approx(0.5 * float(clean) + 0.25, rel=1e-5)


def test_ileed_finds_the_expert_among_demonstrators():
    """Two always take action 1, a third takes any: ρ is high for the two, low for the third."""
    rows = np.arange(240)
    action = np.where(rows < 160, 1, rows % 3)
    data = Demonstrations.of(
        observation=np.ones((240, 1)),
        action=action,
        next_observation=np.ones((240, 1)),
        rewards=RewardPair(np.zeros(240), np.zeros(240)),
        ending=np.where(rows % 80 == 79, int(Ending.ARRIVAL), 0),
        episode=rows // 80,
        n_actions=3,
    )
    static = CloningConfig(hidden=(8,), batch_size=64, updates=400)
    numbers = CloningHyperparameters(learning_rate=0.02)
    trained = robust.ExpertiseEstimating.train_on(static, [numbers], [data])
    network = jax.tree.map(lambda leaf: leaf[0], trained.networks)
    skill = robust.expertise(network, jnp.ones((3, 1)), jnp.arange(3))
    assert skill[:2].min() > 0.9 and skill[2] < 0.3
    assert trained.policy(0).predict(np.ones((1, 1), np.float32))[0][0] == 1


def test_at_the_intersection_labels_computed_again_drop_a_planners_forged_episodes():
    road = Road(SimpleNamespace(road_each=4, road_episodes=1, seeds=(1,)))
    forged, cleaned = (contaminated(road, Poison("hater", case, 0.25, 1)) for case in CASES[1:])
    assert (forged.n_episodes, cleaned.n_episodes) == (12, 9)
    assert forged.counts()["malicious"][0] == 3 and cleaned.counts()["malicious"][0] == 0
