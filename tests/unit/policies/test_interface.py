from types import SimpleNamespace

import numpy as np
import pytest
from gymnasium import spaces

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


BOX = Interface(2, 0, 2)


def test_continuous_actions_are_float32_rows():
    policy = BatchPolicy("theirs", BOX, lambda batch, best: batch / 2)
    actions, _ = policy.predict(np.array([[2.0, 0.0], [1.0, -1.0]]))
    assert actions.dtype == np.float32 and actions.tolist() == [[1.0, 0.0], [0.5, -0.5]]
    assert policy.predict(np.zeros(2))[0].shape == (2,)
    whole = BatchPolicy("theirs", BOX, lambda batch, best: [[1, -1]] * len(batch))
    assert whole.predict(np.zeros(2))[0].tolist() == [1.0, -1.0]


@pytest.mark.parametrize(
    ("answer", "match"),
    [
        ([[0.0], [0.0]], r"shape \(2, 1\): it must be 2 numbers for each of 2"),
        ([0.0, 0.0], "it must be 2 numbers"),
        ([["0.5", "0.5"]] * 2, "<U3"),
        ([[True, False]] * 2, "bool"),
        ([[None, 0.0]] * 2, "object"),
        ([[0.0], [0.0, 0.0]], "must answer 2 numbers for each"),
        ([[0.0, np.nan]] * 2, "NaN or infinity"),
        ([[0.0, -np.inf]] * 2, "NaN or infinity"),
        ([[0.0, 1.0001]] * 2, r"chose 1.0001: continuous actions must be in \[-1, 1\]"),
        ([[0.0, 10**400]] * 2, "object"),
    ],
)
def test_answers_that_are_no_vectors_are_refused(answer, match):
    policy = BatchPolicy("theirs", BOX, lambda batch, best: answer)
    with pytest.raises(UserError, match=match):
        policy.predict(np.zeros((2, 2)))


def test_a_record_names_one_kind_of_actions():
    assert Interface(2, 3).as_json() == {"n_features": 2, "n_actions": 3}
    assert BOX.as_json() == {"n_features": 2, "action_size": 2}
    for one in (Interface(2, 3), BOX):
        assert Interface.of_json(one.as_json()) == one
    assert Interface(2, 3).answer == "one of 3 actions"
    assert Interface(2, 0, 1).answer == "1 number in [-1, 1]"


@pytest.mark.parametrize("space", [spaces.Discrete(3), spaces.Box(-1.0, 1.0, (2,), np.float32)])
def test_the_interface_of_a_world_is_that_of_its_space(space):
    world = SimpleNamespace(n_features=2, action_space=space)
    assert Interface.of(world) == (Interface(2, 3) if space.shape == () else BOX)
