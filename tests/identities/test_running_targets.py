"""Running returns are no function of a transition, so no implicit reward matches them (4.3.1)."""

import numpy as np
import pytest

from socialiq.evaluation.exact import Ground
from socialiq.evaluation.rollout import trajectory_datasets
from socialiq.social.angle import score, weights

CLOSE = 0.05
"""Share of the largest target within which a reward matches it, as in the study of penalties."""


@pytest.fixture(scope="module")
def data():
    return trajectory_datasets(Ground.of("crossing7").table, [10], 60)[0]


def most_matched(data, kind, angle):
    """Return the largest share of rows that any function of (s, a, s', ending) can match."""
    target = np.asarray(score(weights(angle), data.returns(kind, 0.99)))
    half = CLOSE * np.abs(target).max()
    facts = np.column_stack([data.observation, data.action, data.next_observation, data.ending])
    _, group = np.unique(facts, axis=0, return_inverse=True)
    matched = 0
    for number in range(group.max() + 1):
        values = np.sort(target[group == number])
        ends = np.searchsorted(values, values + 2 * half, side="right")
        matched += int((ends - np.arange(len(values))).max())
    return matched / len(target)


@pytest.mark.parametrize("angle", [0.0, 45.0, 90.0])
def test_no_reward_matches_much_more_than_half_of_the_running_returns(data, angle):
    assert most_matched(data, "running", angle) < 0.6
    assert most_matched(data, "to_go", angle) < 0.5
    assert most_matched(data, "instantaneous", angle) == 1.0
