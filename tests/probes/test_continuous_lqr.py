"""A linear system with quadratic costs: values and gain over many steps are known in closed form.

x' = a x + b u, r_env = -(q x² + ρ u²). With an entropy of weight τ the optimal policy is Gaussian,
its mean -K x the one without entropy, its variance τ / (2 H), and V(x) = -P x² + c.
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.learners.continuous import config
from socialiq.learners.continuous.actor_critic import draw_actions, drawn_values, soft_value
from socialiq.learners.continuous.train import train
from socialiq.learners.kernel import network_of
from socialiq.types import Ending, RewardPair, Step

FULL_COMPILER = True
A, B, Q, R = 1.0, 0.5, 1.0, 1.0
DISCOUNT, TEMPERATURE = 0.9, 0.02
LENGTH = 10  # steps until the clock cuts an episode
STATES = np.linspace(-0.8, 0.8, 9, dtype=np.float32)[:, None]


def riccati() -> float:
    """P = q + γ a² P - (γ a b P)² / (ρ + γ b² P), by iteration."""
    p = Q
    for _ in range(500):
        p = Q + DISCOUNT * A**2 * p - (DISCOUNT * A * B * p) ** 2 / (R + DISCOUNT * B**2 * p)
    return p


P = riccati()
H = R + DISCOUNT * B**2 * P  # curvature of -Q(x, u) in u
GAIN = DISCOUNT * A * B * P / H
CONSTANT = TEMPERATURE / 2 * np.log(np.pi * TEMPERATURE / H) / (1 - DISCOUNT)


@dataclass(frozen=True)
class Line:
    """The system as a world; the others' reward is 0."""

    action_size = 1
    n_features = 1
    description = "line"

    def reset(self, key: Any) -> tuple[Any, Any]:
        place = jax.random.uniform(key, (1,), minval=-1.0, maxval=1.0)
        return (place, jnp.zeros((), jnp.int32)), place

    def advance(self, key: Any, episode: Any, action: Any) -> tuple[Any, Step]:
        place, time = episode
        reward = -(Q * place[0] ** 2 + R * action[0] ** 2)
        after, time = A * place + B * action, time + 1
        ending = jnp.where(time == LENGTH, int(Ending.TIMEOUT), int(Ending.NONE))
        pair = RewardPair(reward, jnp.zeros(()))
        return (after, time), Step(after, pair, ending.astype(jnp.int32))


def test_the_closed_form_is_a_fixed_point_of_the_soft_bellman_equation():
    actions = np.linspace(-6.0, 6.0, 200_001)
    for state in STATES[:, 0]:
        after = A * state + B * actions
        q = -(Q * state**2 + R * actions**2) + DISCOUNT * (CONSTANT - P * after**2)
        value = q.max() + TEMPERATURE * np.log(
            np.trapezoid(np.exp((q - q.max()) / TEMPERATURE), actions)
        )
        assert value == pytest.approx(CONSTANT - P * state**2, abs=1e-6)
        assert actions[q.argmax()] == pytest.approx(-GAIN * state, abs=1e-4)


def learnt_values(trained: Any) -> np.ndarray:
    """V(s) = E_π[Q - τ log π] of the trained networks, with the mean of both critics."""
    networks = network_of(trained.networks, 0)
    seen = jnp.asarray(STATES)
    drawn = draw_actions(networks.actor, seen, jax.random.key(0), 1000)
    q = drawn_values(networks.critics, seen, drawn).mean(axis=-1)
    return np.asarray(soft_value(q, drawn, TEMPERATURE))


def gain_of(policy: Any) -> float:
    """Least-squares slope of the policy's action, with its sign turned."""
    action, _ = policy.predict(STATES)
    return -float(STATES[:, 0] @ action[:, 0] / (STATES[:, 0] @ STATES[:, 0]))


@pytest.mark.slow
def test_soft_actor_critic_has_the_gain_and_the_value():
    static = config.SACConfig(
        hidden=(64, 64),
        batch_size=128,
        updates=4000,
        random_steps=2000,
        replay_capacity=4000,
        schedule="linear",
        actions_per_state=2,
    )
    run = config.SACHyperparameters(
        0.0,
        strength=1.0,
        temperature=TEMPERATURE,
        discount=DISCOUNT,
        learning_rate=2e-3,
        polyak=0.02,
    )
    trained = train(static, [run], simulator=Line(), chunk=4000)
    assert gain_of(trained.policy(0)) == pytest.approx(GAIN, abs=0.05)
    wanted = CONSTANT - P * STATES[:, 0] ** 2
    assert np.abs(learnt_values(trained) - wanted).max() < 0.15  # of values from -1.86 to -0.32


def driven(episodes: int) -> Demonstrations:
    """Episodes of the optimal policy: mean -K x, variance τ / (2 H)."""
    rng, rows = np.random.default_rng(0), []
    place = rng.uniform(-1.0, 1.0, episodes)
    for time in range(LENGTH):
        action = rng.normal(-GAIN * place, np.sqrt(TEMPERATURE / (2 * H)))
        after = A * place + B * action
        ending = np.full(episodes, int(Ending.TIMEOUT if time == LENGTH - 1 else Ending.NONE))
        rows.append((place, action, after, -(Q * place**2 + R * action**2), ending))
        place = after
    seen, action, after, reward, ending = (
        np.stack(column, axis=1).ravel() for column in zip(*rows, strict=True)
    )
    return Demonstrations.of(
        observation=seen[:, None],
        action=np.clip(action, -0.999, 0.999)[:, None],
        next_observation=after[:, None],
        ending=ending,
        rewards=RewardPair(reward, np.zeros(len(reward))),
        episode=np.repeat(np.arange(episodes), LENGTH),
        n_actions=0,
    )


@pytest.mark.slow
def test_iq_learn_from_the_optimal_driver_has_its_gain():
    static = config.ActorIQLearnConfig(
        online=False,
        value_term="value_expert",
        prior="none",
        hidden=(64, 64),
        batch_size=128,
        updates=2000,
        schedule="linear",
        actions_per_state=4,
    )
    run = config.ActorIQLearnHyperparameters(
        0.0, temperature=TEMPERATURE, discount=DISCOUNT, learning_rate=2e-3, polyak=0.02
    )
    trained = train(static, [run], [driven(400)], chunk=2000)
    assert gain_of(trained.policy(0)) == pytest.approx(GAIN, abs=0.05)
