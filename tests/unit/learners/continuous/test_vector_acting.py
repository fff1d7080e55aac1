"""Many runs in one batch of intersections: each has the experience that it would have alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.acting import actors_together
from socialiq.learners.collect import VectorCollector
from socialiq.learners.continuous import config
from socialiq.learners.continuous.sac import SoftActorCritic
from socialiq.learners.state import Runs, stack
from socialiq.worlds.gym import learning_env
from socialiq.worlds.intersection.options import ContinuousOptions
from socialiq.worlds.intersection.world import Intersection

STATIC = config.SACConfig(
    view="set", times=20, hidden=(8,), updates=2, replay_capacity=64, random_steps=12, dial=True
)


def collected(seeds: tuple[int, ...], rounds: int = 6, done: int = 0) -> Runs:
    """Replays of runs after one round of acting, three intersections each."""
    numbers = [config.SACHyperparameters(seed=seed) for seed in seeds]
    learner = SoftActorCritic(STATIC, (71, 1))
    state, carry = jax.vmap(learner.initialise)(stack(numbers))
    env = learning_env(Intersection(ContinuousOptions()), 3 * len(seeds), clock=True)
    none = jnp.zeros(len(seeds), int)
    runs = Runs(state, carry, none, none, none)
    return VectorCollector(env, rounds, numbers, actors_together(STATIC, numbers))(runs, done)


def rows_of(runs: Runs, run: int) -> list[np.ndarray]:
    ring = runs.carry.replay
    return [np.asarray(leaf[run])[: int(ring.added[run])] for leaf in jax.tree.leaves(ring.columns)]


@pytest.mark.slow
def test_runs_that_act_together_have_the_experience_of_each_alone():
    both, alone = collected((3, 4)), collected((4,))
    assert int(both.carry.replay.added[1]) == 18
    for ours, theirs in zip(rows_of(both, 1), rows_of(alone, 0), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-5)
    seen, action = rows_of(both, 1)[:2]
    np.testing.assert_array_equal(seen[:12, -1], np.repeat(np.arange(4), 3))  # before any ending
    assert action.shape == (18, 1) and (np.abs(action) <= 1.0).all()
    assert not np.allclose(seen[:3], rows_of(both, 0)[0][:3])


def test_the_first_steps_are_uniform_and_later_ones_follow_the_actor():
    first, later = rows_of(collected((3,)), 0)[1], rows_of(collected((3,), done=100), 0)[1]
    rng = np.random.default_rng(np.random.SeedSequence([3, 0]))
    rng.integers(2**31)
    rng.random(3)  # the angles of a dial
    expected = np.concatenate([rng.uniform(-1.0, 1.0, (3, 1)) for _ in range(4)])
    np.testing.assert_allclose(first[:12], expected.astype(np.float32))
    assert not np.allclose(first, later)


def test_environments_that_cannot_be_divided_are_refused():
    env = learning_env(Intersection(ContinuousOptions()), 3)
    with pytest.raises(UserError, match="can't be divided among 2 runs"):
        numbers = [config.SACHyperparameters(seed=seed) for seed in (0, 1)]
        VectorCollector(env, 1, numbers, actors_together(STATIC, numbers))
