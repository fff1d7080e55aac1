"""Standardised observations, and policies that take them as they are."""

import gymnasium
import jax
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.behaviour_cloning import GaussianCloning
from socialiq.learners.continuous.standardise import Standardisation, explored
from socialiq.nn.actor import Actor
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.worlds.environment import make_environment

RNG = np.random.default_rng(0)
SEEN = RNG.normal([10.0, -0.5, 3.0], [5.0, 0.01, 0.0], (50, 3)).astype(np.float32)


def test_features_have_mean_0_and_deviation_1_and_a_constant_one_keeps_its_unit():
    change = Standardisation.of(SEEN)
    found = change(SEEN)
    assert found.mean(axis=0) == pytest.approx(0.0, abs=1e-5)
    assert found.std(axis=0)[:2] == pytest.approx([1.0, 1.0], rel=0.15)
    assert change(SEEN[0] + [0, 0, 2.0])[2] == pytest.approx(2.0)


def test_steps_at_random_follow_from_their_seed_and_cross_the_ends_of_episodes():
    env = make_environment("Pendulum-v1", continuous=True)  # 200 steps an episode
    found = explored(env, 3, steps=450)
    assert found.shape == (450 + 1 + 2, 3) and found.dtype == np.float32
    np.testing.assert_array_equal(found, explored(env, 3, steps=450))
    assert not np.array_equal(found, explored(env, 4, steps=450))
    jumps = np.abs(np.diff(np.arctan2(found[:, 1], found[:, 0])))
    # A reset is no step: where an episode ends, the next observation is a first one.
    env.reset(seed=3)
    assert np.minimum(jumps, 2 * np.pi - jumps)[:200].max() < 0.5


def test_a_policy_takes_observations_as_they_are():
    change = Standardisation.of(SEEN)
    trained = ActorPolicy.of(Actor.initialise(jax.random.key(0), 3, (8,), 2), {"made": "here"})
    restored = change.policy(trained)
    assert restored.predict(SEEN)[0] == pytest.approx(trained.predict(change(SEEN))[0], abs=1e-4)
    assert restored.provenance["made"] == "here"
    assert restored.provenance["standardised"]["mean"] == change.mean.tolist()


def test_features_that_are_left_out_have_no_effect():
    change = Standardisation.of(SEEN, left_out=range(1, 2))
    assert (change(SEEN)[:, 1] == 0.0).all() and change(SEEN)[:, 0].std() > 0.5
    trained = ActorPolicy.of(Actor.initialise(jax.random.key(0), 3, (8,), 2), {})
    restored = change.policy(trained)
    assert restored.predict(SEEN)[0] == pytest.approx(trained.predict(change(SEEN))[0], abs=1e-4)
    other = SEEN + np.float32([0.0, 100.0, 0.0])
    np.testing.assert_array_equal(restored.predict(other)[0], restored.predict(SEEN)[0])
    assert restored.provenance["standardised"]["deviation"][1] is None


def test_a_dial_keeps_its_inputs_of_the_angle():
    change = Standardisation.of(SEEN)
    network = Actor.initialise(jax.random.key(1), 5, (8,), 1, extra=2)
    dial = ActorDial(ActorPolicy.of(network, {}), 0.0, 90.0)
    for angle in (0.0, 40.0, 90.0):
        restored = change.policy(dial).at(angle).predict(SEEN)[0]
        assert restored == pytest.approx(dial.at(angle).predict(change(SEEN))[0], abs=1e-4)


def test_a_policy_with_a_view_is_refused():
    network = Actor.initialise(jax.random.key(1), 14, (8,), 1, view="set")
    with pytest.raises(UserError, match="a view reads vehicles"):
        Standardisation.of(RNG.normal(size=(9, 14))).policy(ActorPolicy.of(network, {}))


def test_an_environment_shows_standardised_observations():
    change = Standardisation.of(RNG.normal([0.5, 0.1, 2.0], 0.3, (20, 3)))
    plain, changed = (make_environment("Pendulum-v1", continuous=True) for _ in range(2))
    changed = change.environment(changed)
    first, same = plain.reset(seed=4)[0], changed.reset(seed=4)[0]
    assert same == pytest.approx(change(first))
    after, again = plain.step(np.float32([0.3])), changed.step(np.float32([0.3]))
    assert again[0] == pytest.approx(change(after[0])) and again[1] == after[1]
    assert changed.observation_space.contains(same)


def test_an_environment_of_another_size_is_refused():
    env = gymnasium.make("MountainCarContinuous-v0")
    with pytest.raises(UserError, match="has 2 features and the demonstrations 3"):
        Standardisation.of(SEEN).environment(env)


def test_a_clone_learns_from_features_of_unequal_units(random_drives):
    """The action is a feature of deviation 0.001 beside one of 100, which says nothing."""
    drives = random_drives(episodes=40)
    rng = np.random.default_rng(3)
    inner = drives.action / 1000.0
    seen = np.column_stack([inner, rng.normal(0.0, 100.0, len(inner))]).astype(np.float32)
    shown = type(drives).of(
        observation=seen,
        action=np.clip(drives.action, -0.9, 0.9),
        next_observation=seen,
        ending=drives.ending,
        rewards=drives.rewards,
        episode=drives.episode,
        n_actions=0,
    )
    change = Standardisation.of(seen)
    static = bc.CloningConfig(hidden=(32,), updates=1500, batch_size=64)
    runs = [bc.CloningHyperparameters(learning_rate=3e-3)]
    misses = []
    for data, restore in ((change.transitions(shown), change.policy), (shown, lambda one: one)):
        clone = restore(GaussianCloning.train_on(static, runs, [data]).policy(0))
        misses.append(np.abs(clone.predict(seen)[0] - shown.action).mean())
    assert misses[0] < 0.1 < misses[1]
