"""Labels of a training over shifts: shares of each world, and a clock that tells the exit."""

from dataclasses import replace

import numpy as np
import pytest

from socialiq import UserError
from socialiq.audit.request import SHIPPED_DIAL
from socialiq.evaluation import road_training
from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import packaged_results


def test_states_are_of_every_world():
    start = DialPolicy.load(packaged_results() / SHIPPED_DIAL)
    structure = replace(road_training.ITERATION, states_per_update=3)
    worlds = ("none or late,unseen=.3", "right")
    dial, static, label = road_training.shifted(structure, start, worlds, 8)
    assert static.times == 60 and static.states_per_update == 3 and dial.n_features == 71

    def go(observation):
        return np.full(len(observation), 2)

    labelled = label(go, 0.0, np.random.default_rng(0))
    time = labelled.observation[:, -2]
    assert labelled.returns.env.shape == (3 * road_training.CHUNK, 3)
    first = 2 * road_training.CHUNK
    assert time[:first].max() < 20 and time[first:].min() >= 40 and time[first:].max() < 60
    with pytest.raises(UserError, match="at most 3 worlds"):
        road_training.shifted(structure, start, ("none",) * 4, 8)
