"""Direct policy iteration of a dial on problems with known values."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.dial.rows import stratified_angles
from socialiq.learners.policy_iteration import (
    DialIteration,
    DialIterationConfig,
    Greedy,
    IterationHyperparameters,
    Labelled,
    expected_return,
    regression_error,
    train,
)
from socialiq.nn.dial_policy import DialPolicy
from socialiq.types import RewardPair
from socialiq.worlds.intersection.world import Intersection

SMALL = DialIterationConfig(
    hidden=(32,), batch_size=64, updates=600, states_per_update=4, replay_capacity=2_000, knots=5
)
NUMBERS = IterationHyperparameters(
    learning_rate=1e-2, final_learning_rate=1e-3, polyak=0.05, temperature=0.3, seed=1
)


def choice(_follow, _share, rng):
    """One state: action 0 gives (3, 0), action 1 gives (0, 3), and 2 gives (2, 2) on average."""
    count = 400
    angles = stratified_angles(SMALL, count, rng)
    seen = np.column_stack([np.ones(count), angles]).astype(np.float32)
    coin, nothing = rng.choice([0.0, 4.0], size=count), np.zeros(count)
    env = np.stack([nothing + 3.0, nothing, coin], axis=1)
    social = np.stack([nothing, nothing + 3.0, coin], axis=1)
    return Labelled(seen, RewardPair(env, social))


def made(**changes):
    numbers = dataclasses.replace(NUMBERS, **changes)
    return train(SMALL, [numbers], [choice], (1, 3), chunk=100).policy(0)


@pytest.mark.parametrize("regression", [0.6, 1.0])
def test_each_angle_has_its_own_best_action(regression):
    """(3, 0), (0, 3) and (2, 2) are the best scores below 26.6, above 63.4, and between."""
    dial, angles = made(regression=regression), (0.0, 15.0, 35.0, 55.0, 75.0, 90.0)
    actions = [int(dial.at(angle).predict(np.ones(1))[0]) for angle in angles]
    assert actions == [0, 0, 2, 2, 1, 1]


def test_regression_learns_the_returns_of_both_rewards():
    dial = made(regression=1.0)
    for angle in (5.0, 45.0, 85.0):
        env, social = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
        wanted = [3 * env, 3 * social, 2 * env + 2 * social]
        q = dial.at(angle).q_values(np.ones((1, 1)))[0]
        np.testing.assert_allclose(q, wanted, atol=0.5)


def test_fast_greedy_actions_are_those_of_the_dial_at_each_angle():
    static = DialIterationConfig(view="set", times=20, hidden=(16,), knots=5)
    batch = Intersection().batch(30)
    sizes = (batch.observation.shape[1] + 1, 3)
    network = DialIteration(static, sizes).network(jax.random.key(0))
    dial = DialPolicy.of(network, 1.0, 0.0, 90.0, {})
    batch.reset(np.arange(30, dtype=np.uint64))
    seen = np.column_stack([batch.observation, batch.time])
    angles = np.repeat([0.0, 40.0, 90.0], 10)
    acted = Greedy(dial)(np.column_stack([seen, angles]).astype(np.float32))
    wanted = [
        dial.at(angle).predict(row)[0] for angle, row in zip(angles.tolist(), seen, strict=True)
    ]
    assert acted.tolist() == [int(one) for one in wanted]
    assert len(set(acted.tolist())) > 1


def test_a_run_begins_with_the_dial_that_it_improves():
    start = made()
    numbers = dataclasses.replace(NUMBERS, learning_rate=1e-9, final_learning_rate=1e-9)
    again = train(SMALL, [numbers], [choice], (1, 3), chunk=100, start=start).policy(0)
    seen = np.ones((1, 1))
    np.testing.assert_allclose(
        again.at(45.0).q_values(seen), start.at(45.0).q_values(seen), atol=1e-4
    )
    other = dataclasses.replace(SMALL, hidden=(8,))
    with pytest.raises(UserError, match="another network"):
        train(other, [numbers], [choice], (1, 3), start=start)


def test_rounds_that_fill_the_ring_label_the_given_dial_alone(tmp_path):
    """The given dial labels before the first update alone; a new network is trained."""
    made().save(tmp_path / "start.safetensors")
    start, calls = DialPolicy.load(tmp_path / "start.safetensors"), []
    observations = np.column_stack([np.ones(90), np.linspace(0.0, 90.0, 90)]).astype(np.float32)

    def recorded(follow, share, rng):
        calls.append(follow(observations))
        return choice(follow, share, rng)

    once = dataclasses.replace(SMALL, first_rounds=2, replay_capacity=800)
    still = dataclasses.replace(NUMBERS, learning_rate=1e-9, final_learning_rate=1e-9)
    trained = train(once, [still], [recorded], (1, 3), chunk=100, start=start).policy(0)
    wanted = [start.at(angle).predict(np.ones(1))[0] for angle in observations[:, 1].tolist()]
    assert [actions.tolist() for actions in calls] == [wanted, wanted]
    assert trained.turned.provenance["start"] == {"sha256": start.turned.sha256}
    drawn = train(once, [still], [choice], (1, 3), chunk=100).policy(0)
    np.testing.assert_allclose(trained.turned.weights[0], drawn.turned.weights[0], atol=1e-4)
    larger = dataclasses.replace(once, replay_capacity=801)
    train(larger, [still], [recorded], (1, 3), chunk=100, start=start)
    assert len(calls) == 2 + 2 + 5  # two first rounds, then one before each other chunk


LENGTH = 5
LEFT, RIGHT = 0, 1
AT_ONE_ANGLE = dataclasses.replace(SMALL, low=0.0, high=0.0, margin=0.0, high_share=None, knots=0)


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


def at_no_angle(seen):
    """Observations that end with the angle, 0 degrees."""
    return np.column_stack([seen, np.zeros(len(seen))]).astype(np.float32)


def line(count):
    """Labeller of the line; every place is visited alike."""

    def follows(policy):
        return lambda seen: policy(at_no_angle(seen))

    def label(follow, _share, rng):
        place = rng.integers(LENGTH, size=count)
        walks = [walk(place, np.full(count, a), follows(follow)) for a in (LEFT, RIGHT)]
        env = np.stack(walks, axis=1)
        return Labelled(at_no_angle(one_hot(place)), RewardPair(env, -env))

    return label


def hidden_coin(count):
    """One observation. Action 0 gives 1; action 1 gives 4 or -6 by a coin that isn't observed."""

    def label(_follow, _share, rng):
        heads = rng.random(count) < 0.6
        env = np.stack([np.ones(count), np.where(heads, 4.0, -6.0)], axis=1)
        return Labelled(at_no_angle(np.ones((count, 1))), RewardPair(env, np.zeros_like(env)))

    return label


def trained(labeller, features, **changes):
    numbers = dataclasses.replace(NUMBERS, **changes)
    learned = train(AT_ONE_ANGLE, [numbers], [labeller(100 * 4)], (features, 2), chunk=100)
    return learned.policy(0).at(0.0)


def test_iteration_finds_the_best_policy_of_the_line_and_its_values():
    """From places 0 to 4 the right end pays 10 less 5 to 1 steps, the left end 2 less 1 to 5."""
    policy = trained(line, LENGTH, regression=1.0)
    seen = one_hot(np.arange(LENGTH))
    right = 10.0 - (LENGTH - np.arange(LENGTH))
    left = np.array([1.0, *(right[:-1] - 1.0)])
    assert policy.predict(seen)[0].tolist() == [RIGHT] * LENGTH
    np.testing.assert_allclose(policy.q_values(seen), np.stack([left, right], 1), atol=0.15)


@pytest.mark.parametrize("regression", [0.5, 1.0])
def test_what_is_not_observed_is_averaged(regression):
    """E[G] is 1 and 0, although the risky action is the better one in 60 % of the states."""
    policy = trained(hidden_coin, 1, regression=regression)
    assert policy.predict(np.ones(1))[0] == 0
    if regression == 1.0:
        np.testing.assert_allclose(policy.q_values(np.ones((1, 1))), [[1.0, 0.0]], atol=0.4)


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


def test_runs_need_a_labeller_each():
    with pytest.raises(UserError, match="pass one for each"):
        train(SMALL, [NUMBERS], [], (1, 2))


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        (DialIterationConfig, {"updates": 0}),
        (DialIterationConfig, {"view": "round"}),
        (IterationHyperparameters, {"temperature": 0.0}),
        (IterationHyperparameters, {"regression": 1.5}),
        (IterationHyperparameters, {"angle": 400.0}),
    ],
)
def test_impossible_settings_are_refused(kind, change):
    with pytest.raises(UserError):
        kind(**change)
