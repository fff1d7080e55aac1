import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.policies.interface import BatchPolicy, Interface
from socialiq.types import Policy


def answering(answer):
    return BatchPolicy("theirs", Interface(2, 3), lambda batch, best: answer)


def test_batch_and_single_observation_have_their_shapes():
    policy = BatchPolicy("theirs", Interface(2, 3), lambda batch, best: batch[:, 0].astype(int))
    assert isinstance(policy, Policy)
    memory = object()
    actions, state = policy.predict(np.array([[2, 0], [1, 0]]), memory)
    assert actions.tolist() == [2, 1] and state is memory
    assert policy.predict(np.array([2.0, 0.0]))[0].shape == ()


def test_deterministic_is_passed_on():
    policy = BatchPolicy("theirs", Interface(2, 3), lambda batch, best: [int(best)])
    assert policy.predict(np.zeros(2))[0] == 1
    assert policy.predict(np.zeros(2), deterministic=False)[0] == 0


@pytest.mark.parametrize(
    ("answer", "match"),
    [
        ([0], r"shape \(1,\): it must be one integer for each of 2"),
        ([[0], [1]], "one integer"),
        (0, "one integer"),
        ([0.0, 1.0], "float64"),
        ([True, False], "bool"),
        (["0", "1"], "one integer"),
        (None, "one integer"),
        ([0, None], "object"),
        ([0, [1]], "one action for each"),
        ([0, 3], "chose action 3: it must be from 0 to 2"),
        ([-1, 0], "chose action -1"),
        (np.array([0, 2**63], np.uint64), "chose action 9223372036854775808"),
        ([0, 10**30], "object"),
    ],
)
def test_answers_that_are_no_actions_are_refused(answer, match):
    with pytest.raises(UserError, match=match):
        answering(answer).predict(np.zeros((2, 2)))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_observations_must_be_finite(value):
    with pytest.raises(UserError, match="NaN or infinity"):
        answering([0]).predict(np.array([0.0, value]))


@pytest.mark.parametrize("shape", [(3,), (2, 3), (1, 2, 2), ()])
def test_observations_must_be_of_the_interface(shape):
    with pytest.raises(UserError, match="this policy takes"):
        answering([0]).predict(np.zeros(shape))
