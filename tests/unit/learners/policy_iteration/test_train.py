"""Direct policy iteration on problems with known values."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.policy_iteration.train import (
    IterationConfig,
    IterationHyperparameters,
    Labelled,
    PolicyIteration,
    expected_return,
    regression_error,
    train,
)
from socialiq.types import RewardPair

LENGTH = 5
LEFT, RIGHT = 0, 1
SMALL = IterationConfig(
    hidden=(32,), batch_size=64, updates=600, states_per_update=4, replay_capacity=2_000
)
NUMBERS = IterationHyperparameters(
    learning_rate=1e-2, final_learning_rate=1e-3, polyak=0.05, temperature=0.3, seed=1
)


def one_hot(place):
    return np.eye(LENGTH, dtype=np.float32)[place]


def walk(place, first, follow):
    """Return of walks on a line: -1 a step, +2 at the left end, +10 at the right one."""
    total, action = np.zeros(len(place)), first
    place, running = place.copy(), np.ones(len(place), bool)
    for _ in range(20):
        place = np.where(running, place + np.where(action == RIGHT, 1, -1), place)
        total -= running
        total += np.where(running & (place < 0), 2, 0) + np.where(
            running & (place >= LENGTH), 10, 0
        )
        running &= (place >= 0) & (place < LENGTH)
        action = follow(one_hot(np.clip(place, 0, LENGTH - 1)))
    return total


def line(count):
    """Labeller of the line; every place is visited alike."""

    def label(follow, _visit, rng):
        place = rng.integers(LENGTH, size=count)
        env = np.stack([walk(place, np.full(count, a), follow) for a in (LEFT, RIGHT)], axis=1)
        return Labelled(one_hot(place), RewardPair(env, -env))

    return label


def hidden_coin(count):
    """One observation. Action 0 gives 1; action 1 gives 4 or -6 by a coin that isn't observed."""

    def label(_follow, _visit, rng):
        heads = rng.random(count) < 0.6
        env = np.stack([np.ones(count), np.where(heads, 4.0, -6.0)], axis=1)
        return Labelled(np.ones((count, 1), np.float32), RewardPair(env, np.zeros_like(env)))

    return label


def trained(labeller, features, **changes):
    numbers = dataclasses.replace(NUMBERS, **changes)
    made = train(SMALL, [numbers], [labeller(100 * 4)], (features, 2), chunk=100)
    return made.policy(0)


def test_iteration_finds_the_best_policy_of_the_line_and_its_values():
    """From places 0 to 4 the right end pays 10 less 5 to 1 steps, the left end 2 less 1 to 5."""
    policy = trained(line, LENGTH, regression=1.0)
    seen = one_hot(np.arange(LENGTH))
    right = 10.0 - (LENGTH - np.arange(LENGTH))
    left = np.array([1.0, *(right[:-1] - 1.0)])
    assert policy.predict(seen)[0].tolist() == [RIGHT] * LENGTH
    np.testing.assert_allclose(policy.q_values(seen), np.stack([left, right], 1), atol=0.15)


def test_the_angle_decides_which_returns_count():
    """At 270 degrees the score is -G_social = G_env; at 90 it is -G_env: walk for ever."""
    seen = one_hot(np.arange(LENGTH))
    assert trained(line, LENGTH, angle=270.0).predict(seen)[0].tolist() == [RIGHT] * LENGTH
    assert trained(line, LENGTH, angle=90.0).predict(seen)[0].tolist() != [RIGHT] * LENGTH


@pytest.mark.parametrize("regression", [0.5, 1.0])
def test_what_is_not_observed_is_averaged(regression):
    """E[G] is 1 and 0, although the risky action is the better one in 60 % of the states."""
    policy = trained(hidden_coin, 1, regression=regression)
    assert policy.predict(np.ones(1))[0] == 0
    if regression == 1.0:
        np.testing.assert_allclose(policy.q_values(np.ones((1, 1))), [[1.0, 0.0]], atol=0.4)


def test_a_network_with_a_clock_has_an_input_for_each_time():
    static = dataclasses.replace(SMALL, view="set", times=3)
    network = PolicyIteration(static, (15, 2)).network(jax.random.key(0))
    seen = np.zeros(15, np.float32)
    values = [network(jnp.asarray(seen).at[-1].set(time)) for time in (0, 1, 2, 3)]
    assert len({tuple(one.tolist()) for one in values}) == 4


def test_expected_return_of_a_known_state():
    outputs = jnp.array([[0.0, 0.3 * np.log(3.0)]])
    gain, entropy = expected_return(outputs, jnp.array([[2.0, 6.0]]), 0.3)
    np.testing.assert_allclose(gain, [0.25 * -2.0 + 0.75 * 2.0], rtol=1e-5)
    np.testing.assert_allclose(entropy, [0.25 * np.log(4.0) + 0.75 * np.log(4 / 3)], rtol=1e-5)


def test_regression_error_splits_the_squared_error():
    outputs, returns = jnp.array([[1.0, 2.0, 6.0]]), jnp.array([[0.0, 2.0, 1.0]])
    whole = 0.5 * (1.0 + 0.0 + 25.0) / 3
    np.testing.assert_allclose(regression_error(outputs, returns, 1.0), [whole], rtol=1e-6)
    np.testing.assert_allclose(regression_error(outputs, returns, 0.0), [whole - 2.0], rtol=1e-6)


def test_equal_seeds_give_equal_networks():
    first, second = (trained(hidden_coin, 1) for _ in range(2))
    for one, other in zip(first.weights, second.weights, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_run_begins_with_the_policy_that_it_improves():
    start = trained(line, LENGTH, regression=1.0)
    seen = one_hot(np.arange(LENGTH))
    numbers = dataclasses.replace(NUMBERS, learning_rate=1e-9, final_learning_rate=1e-9)
    made = train(SMALL, [numbers], [line(400)], (LENGTH, 2), chunk=100, start=start).policy(0)
    np.testing.assert_allclose(made.q_values(seen), start.q_values(seen), atol=1e-3)
    assert made.provenance["start"] == {"sha256": start.sha256}


def test_a_first_policy_with_another_network_is_refused():
    start = trained(hidden_coin, 1)
    with pytest.raises(UserError, match="another network"):
        train(SMALL, [NUMBERS], [line(400)], (LENGTH, 2), start=start)


def test_runs_need_a_labeller_each():
    with pytest.raises(UserError, match="pass one for each"):
        train(SMALL, [NUMBERS], [], (1, 2))


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        (IterationConfig, {"updates": 0}),
        (IterationConfig, {"view": "round"}),
        (IterationHyperparameters, {"temperature": 0.0}),
        (IterationHyperparameters, {"regression": 1.5}),
        (IterationHyperparameters, {"angle": 400.0}),
    ],
)
def test_impossible_settings_are_refused(kind, change):
    with pytest.raises(UserError):
        kind(**change)
