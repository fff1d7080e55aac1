"""Shared reward of demonstrators, where the answer is known."""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners.dial.config import DialConfig, DialHyperparameters
from socialiq.learners.dial.train import train
from socialiq.types import Ending, RewardPair, Step

PAIRS = np.array([[1.0, 0.0], [0.0, 1.0], [0.9, 0.9]], np.float32)
"""(r_env, r_social) of three actions. The third has the largest score at 45 degrees."""


class OneChoice:
    """An episode is one choice among three actions."""

    n_actions, n_features, description = 3, 1, "one choice"

    def reset(self, key: Any) -> tuple[Any, Any]:
        return jnp.zeros(()), jnp.zeros(1)

    def advance(self, key: Any, episode: Any, action: Any) -> tuple[Any, Step]:
        pair = jnp.asarray(PAIRS)[action]
        ending = jnp.asarray(int(Ending.ARRIVAL))
        return episode, Step(jnp.zeros(1), RewardPair(pair[0], pair[1]), ending)


def always(action: int, episodes: int = 20) -> Demonstrations:
    """Demonstrations of a driver that always does the same."""
    seen, pair = np.zeros((episodes, 1), np.float32), PAIRS[action].astype(np.float64)
    flags = np.ones(episodes, bool)
    return Demonstrations(
        observation=seen,
        action=np.full(episodes, action, np.int32),
        next_observation=seen,
        terminated=flags,
        truncated=~flags,
        ending=np.full(episodes, int(Ending.ARRIVAL), np.int8),
        rewards=RewardPair(np.full(episodes, pair[0]), np.full(episodes, pair[1])),
        mode=np.zeros(episodes, np.int8),
        episode=np.arange(episodes, dtype=np.int32),
        step=np.zeros(episodes, np.int32),
        mode_names=("always",),
        n_actions=3,
        source={},
    )


SHARED = DialConfig(
    hidden=(16,),
    skill_hidden=(8,),
    demonstrators=(0.0, 90.0),
    expert_batch=8,
    replay_batch=24,
    updates=1500,
)
NUMBERS = DialHyperparameters(temperature=0.1, learning_rate=5e-3, prior_weight=1.0, discount=0.9)


@pytest.mark.slow
def test_what_both_demonstrators_shun_is_shunned_at_an_angle_that_nobody_showed() -> None:
    """An egoist takes the first action and an altruist the second, and neither ever the third."""
    trained = train(SHARED, [NUMBERS], [always(0), always(1)], OneChoice(), chunk=500)
    dial = trained.policy(0)
    chosen = {a: int(dial.at(a).predict(np.zeros(1))[0]) for a in (0.0, 30.0, 60.0, 90.0)}
    assert chosen == {0.0: 0, 30.0: 0, 60.0: 1, 90.0: 1}


@pytest.mark.slow
def test_without_them_it_is_taken() -> None:
    alone = dataclasses.replace(SHARED, demonstrators=(), demonstrations=False)
    trained = train(alone, [NUMBERS], [], OneChoice(), chunk=500)
    chosen = [int(trained.policy(0).at(a).predict(np.zeros(1))[0]) for a in (30.0, 60.0)]
    assert chosen == [2, 2] and trained.networks.skill is None


def test_the_skill_is_near_its_fixed_point() -> None:
    """-f'(b) of the loss: Σ_i p_i π(b; a_i) = share shown of b - 2 c f(b) (share shown + ε)."""
    trained = train(SHARED, [NUMBERS], [always(0), always(1)], OneChoice(), chunk=500)
    assert trained.networks.skill is not None
    layers = [
        (np.asarray(one.weight[0]), np.asarray(one.bias[0]))
        for one in trained.networks.skill.layers
    ]
    hidden = np.maximum(layers[0][1], 0.0)  # the observation is 0
    f = layers[1][0] @ hidden + layers[1][1]
    policies = [trained.policy(0).at(a).probabilities(np.zeros((1, 1)))[0] for a in (0.0, 90.0)]
    shown = np.array([0.5, 0.5, 0.0])
    pull = 2 * NUMBERS.shrinkage * f * (shown + NUMBERS.spread)
    np.testing.assert_allclose(np.mean(policies, axis=0), shown - pull, atol=0.02)


def test_sets_and_demonstrators_must_agree() -> None:
    with pytest.raises(UserError, match="beyond the 0 given"):
        train(SHARED, [NUMBERS], [always(0)], OneChoice())
    with pytest.raises(UserError, match="no equal parts"):
        dataclasses.replace(SHARED, expert_batch=7)
    with pytest.raises(UserError, match="leave one out"):
        dataclasses.replace(SHARED, demonstrations=False)
