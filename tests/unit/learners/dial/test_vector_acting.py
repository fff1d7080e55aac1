"""Acting of many runs at once: each collects what it would collect alone."""

import dataclasses

import jax
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from socialiq.errors import UserError
from socialiq.evaluation.road_training import CHUNK, sizes_of, source_of
from socialiq.learners.acting import dials, dials_together
from socialiq.learners.collect import Collector, VectorCollector
from socialiq.learners.dial.config import INTERSECTION, DialHyperparameters
from socialiq.learners.dial.train import Dial
from socialiq.learners.fit import _start_all
from socialiq.learners.state import stack
from socialiq.worlds.gym import RoadVectorEnv
from socialiq.worlds.intersection.options import Options

STATIC = dataclasses.replace(
    INTERSECTION.structure, hidden=(8,), environments=4, replay_capacity=500
)
NUMBERS = [DialHyperparameters(seed=seed, temperature=0.5) for seed in (3, 8)]


def vector_env(count: int) -> RoadVectorEnv:
    return RoadVectorEnv(num_envs=count, autoreset_mode=AutoresetMode.SAME_STEP, clock=True)


def test_runs_that_act_together_collect_what_each_collects_alone():
    learner = Dial(STATIC, sizes_of(Options(), clock=True))
    begun = [_start_all(learner, stack(NUMBERS)) for _ in range(2)]
    sources = [source_of(Options(), 4, 1, clock=True) for _ in NUMBERS]
    alone = Collector(sources, [3, 8], dials(STATIC, NUMBERS), True)(begun[0], 400)
    acting = dials_together(STATIC, NUMBERS)
    together = VectorCollector(vector_env(8), CHUNK // 4, NUMBERS, acting)(begun[1], 400)
    one, other = alone.carry.replay, together.carry.replay
    assert one.added.tolist() == other.added.tolist() == [CHUNK, CHUNK]
    for expected, found in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-6)
    first, second = np.asarray(other.columns.observation)
    assert not np.array_equal(first, second)


def test_environments_that_runs_cannot_share_are_refused():
    with pytest.raises(UserError, match="can't be divided among 2 runs"):
        VectorCollector(vector_env(3), 1, NUMBERS, dials_together(STATIC, NUMBERS))
