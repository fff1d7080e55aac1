"""A policy behind a front end, without ONNX: as the world shows it, from its own memory."""

import numpy as np
import pytest

from socialiq import UserError
from socialiq.policies.front_end import FrontEndPolicy
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.perception import FrontEnd
from socialiq.worlds.intersection.world import Intersection

FRONT_END = FrontEnd(latency=1, track=3, noise=1.0)


def test_it_acts_as_the_policy_in_a_world_with_the_front_end():
    shift, rule = "late,unseen=.3,noise=1", policies.policy("gap_3s")
    bare = Intersection().shifted(shift).batch(6)
    fronted = Intersection().shifted(shift, "latency=1,track=3,noise=1").batch(6)
    policy, state, started = FrontEndPolicy(rule, FRONT_END, 70), None, None
    bare.reset(50), fronted.reset(50)
    for _ in range(25):  # into next episodes
        chosen, state = policy.predict(bare.observation, state, started)
        np.testing.assert_array_equal(chosen, rule.predict(fronted.observation)[0])
        started = bare.step(chosen).ending != 0
        fronted.step(chosen)


def test_a_single_observation_and_one_of_another_length():
    policy = FrontEndPolicy(policies.policy("go"), FRONT_END, 70)
    action, state = policy.predict(np.zeros(70, np.float32))
    assert action.shape == () and state.shape == (1, 9 * 10 + 2)
    with pytest.raises(UserError, match=r"shape \(71,\): this policy takes \(70,\)"):
        policy.predict(np.zeros(71, np.float32))
    with pytest.raises(UserError, match="holds NaN or infinity"):
        policy.predict(np.full(70, np.nan, np.float32))
