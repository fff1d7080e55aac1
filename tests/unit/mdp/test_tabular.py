from dataclasses import replace

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.mdp.solve import value_iteration
from socialiq.mdp.tabular import TabularMDP, check_discount, check_policy
from socialiq.types import Ending, RewardPair


def test_expected_next_by_hand_counts_only_outcomes_that_go_on(small_road):
    values = np.array([8.0, 4.0, 100.0])
    expected = [[8.0, 3.0], [0.0, 0.0], [6.0, 100.0]]
    np.testing.assert_allclose(small_road.expected_next(values), expected, atol=0)


def test_arrivals_by_hand(small_road):
    mass = np.array([[0.5, 0.5], [7.0, 7.0], [1.0, 0.0]])
    np.testing.assert_allclose(small_road.arrivals(mass), [1.0, 0.875, 0.0], atol=0)


@pytest.mark.parametrize("seed", range(5))
def test_arrivals_is_the_adjoint_of_expected_next(seed, random_mdp):
    rng = np.random.default_rng(seed)
    mdp = random_mdp(rng, 7, 3, 4, 0.2)
    mass, values = rng.normal(size=(7, 3)), rng.normal(size=7)
    forward = (mass * mdp.expected_next(values)).sum()
    assert forward == pytest.approx(mdp.arrivals(mass) @ values, rel=1e-12, abs=1e-12)


def test_outcomes_with_the_same_successor_add_up(small_road):
    halves = np.full_like(small_road.probability, 0.5)
    mdp = replace(small_road, successor=np.zeros_like(small_road.successor), probability=halves)
    assert mdp.expected_next(np.array([3.0, 5.0, 7.0]))[0, 0] == 3.0


def test_ending_probability_by_hand_and_sums_to_one(small_road):
    chances = small_road.ending_probability
    assert chances.shape == (3, 2, len(Ending))
    assert chances[0, 1, Ending.COLLISION] == 0.25
    assert chances[0, 1, Ending.NONE] == 0.75
    assert chances[1, 0, Ending.ARRIVAL] == 1.0
    np.testing.assert_allclose(chances.sum(axis=2), 1.0)


def test_under_by_hand(small_road):
    policy = np.array([[0.5, 0.5], [1.0, 0.0], [0.0, 1.0]])
    expected = [[0.5, 0.375, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(small_road.under(policy).toarray(), expected, atol=0)


def test_reachable_by_hand(small_road):
    # State 2 is a successor only of outcomes that end the episode or are impossible.
    assert small_road.reachable().tolist() == [True, True, False]
    from_two = replace(small_road, initial=np.array([0.0, 0.0, 1.0]))
    assert from_two.reachable().tolist() == [True, True, True]
    from_one = replace(small_road, initial=np.array([0.0, 1.0, 0.0]))
    assert from_one.reachable().tolist() == [False, True, False]


@pytest.mark.parametrize("seed", range(5))
def test_reachable_is_where_a_uniform_policy_puts_mass(seed, random_mdp):
    mdp = random_mdp(np.random.default_rng(seed), 30, 2, 2, 0.5)
    mdp = replace(mdp, initial=np.eye(30)[seed])
    mass, seen = mdp.initial, mdp.initial > 0
    for _ in range(30):
        mass = mdp.arrivals(np.outer(mass, [0.5, 0.5]))
        seen |= mass > 0
    assert 1 < seen.sum() < 30
    assert (mdp.reachable() == seen).all()


def test_reachable_part_by_hand(small_road):
    part, states = small_road.reachable_part()
    assert states.tolist() == [0, 1]
    np.testing.assert_allclose(part.expected_next(np.array([8.0, 4.0])), [[8.0, 3.0], [0.0, 0.0]])
    assert part.rewards.env.tolist() == [[-1.0, -1.0], [9.0, 10.0]]
    assert part.initial.tolist() == [1.0, 0.0]


@pytest.mark.parametrize("seed", range(3))
def test_reachable_part_has_the_same_values(seed, random_mdp):
    rng = np.random.default_rng(seed)
    mdp = replace(random_mdp(rng, 30, 2, 2, 0.5), initial=np.eye(30)[seed])
    part, states = mdp.reachable_part()
    assert 1 < len(states) < 30
    assert part.initial.sum() == 1.0
    whole = value_iteration(mdp, mdp.rewards.env, 0.9).v
    found = value_iteration(part, part.rewards.env, 0.9).v
    np.testing.assert_allclose(found, whole[states], rtol=1e-11)


def changed(array: np.ndarray, value: float) -> np.ndarray:
    array = array.copy()
    array[(0,) * array.ndim] = value
    return array


@pytest.mark.parametrize(
    ("field", "change", "words"),
    [
        ("successor", lambda a: changed(a, 3), "outside the 3 states"),
        ("successor", lambda a: changed(a, -1), "outside the 3 states"),
        ("successor", lambda a: a[..., 0], "successor has shape"),
        ("successor", lambda a: a.astype(np.float64), "indices of states"),
        ("probability", lambda a: a[:, :, :1], "probability has shape"),
        ("probability", lambda a: changed(a, np.nan), "outcome probabilities must be finite"),
        ("probability", lambda a: changed(a, -0.5), "none negative"),
        ("probability", lambda a: changed(a, 0.5), "outcome probabilities must sum to 1"),
        ("probability", lambda a: a.astype(np.float32), "float64"),
        ("ending", lambda a: a[:1], "ending has shape"),
        ("ending", lambda a: changed(a, Ending.TIMEOUT), "time limit is the horizon's"),
        ("ending", lambda a: changed(a, 9), "endings must be among"),
        ("rewards", lambda r: RewardPair(r.env[:2], r.social), "r_env has shape"),
        ("rewards", lambda r: RewardPair(r.env, changed(r.social, np.inf)), "r_social must be"),
        ("initial", lambda a: a[:2], "initial has shape"),
        ("initial", lambda a: changed(a, 0.9), "initial distribution must sum to 1"),
    ],
)
def test_bad_arrays_are_refused_in_one_line(field, change, words, small_road, as_a_user_runs_it):
    arrays = {name: getattr(small_road, name) for name in TabularMDP.__dataclass_fields__}
    with pytest.raises(UserError, match=words) as caught:
        TabularMDP(**{**arrays, field: change(arrays[field])})
    assert "\n" not in str(caught.value)


def test_an_empty_mdp_is_refused(small_road, as_a_user_runs_it):
    empty = np.zeros((0, 2, 1), np.int64)
    with pytest.raises(UserError, match="none empty"):
        replace(small_road, successor=empty)


def test_bad_policies_and_discounts_are_refused(small_road):
    uniform = np.full((3, 2), 0.5)
    check_policy(small_road, uniform)
    for bad, words in [
        (uniform.T, "policy has shape"),
        (uniform * 1.1, "action probabilities must sum to 1"),
        (changed(uniform, np.nan), "action probabilities must be finite"),
    ]:
        with pytest.raises(UserError, match=words):
            check_policy(small_road, bad)
    for bad in (-0.1, 1.1, np.nan):
        with pytest.raises(UserError, match="outside"):
            check_discount(bad)
