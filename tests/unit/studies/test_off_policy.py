"""Off-policy evaluation beside exact values: policies, data and what is counted."""

import numpy as np
import pytest

from socialiq.evaluation.exact import evaluate_exactly
from socialiq.evaluation.off_policy import Estimate, OffPolicy
from socialiq.evaluation.rollout import MODES
from studies.off_policy.study import Scene, _estimates, _pooled


@pytest.fixture(scope="module")
def scene():
    return Scene.of("crossing5")


def test_a_policy_takes_the_best_first_action_or_a_random_one(scene):
    best, mixed = (scene.policy(0.0, random) for random in (0.0, 0.3))
    assert set(best.ravel()) == {0.0, 1.0}
    n_actions = best.shape[1]
    np.testing.assert_allclose(mixed, 0.7 * best + 0.3 / n_actions)
    np.testing.assert_allclose(mixed.sum(axis=1), 1.0)


def test_a_policy_of_an_angle_is_best_there(scene):
    values = {
        (made_for, angle): evaluate_exactly(scene.part, scene.policy(made_for, 0.0)).value(angle)
        for made_for in MODES.values()
        for angle in MODES.values()
    }
    for angle in MODES.values():
        assert values[angle, angle] >= max(values[a, angle] for a in MODES.values()) - 1e-9


def test_data_have_equal_numbers_of_episodes_and_are_seeded(scene):
    data = scene.data(4, 0.2, seed=3)
    assert {mode: episodes for mode, (episodes, _) in data.counts().items()} == dict.fromkeys(
        MODES, 4
    )
    again, others = scene.data(4, 0.2, seed=3), scene.data(4, 0.2, seed=4)
    np.testing.assert_array_equal(data.action, again.action)
    assert len(data.action) != len(others.action) or (data.action != others.action).any()


def test_chances_are_those_of_the_state_and_even_beyond_the_end(scene):
    policy = scene.policy(45.0, 0.1)
    chances = scene.chances(policy)
    states = scene.part.states[[0, 3]]
    np.testing.assert_array_equal(chances(states.astype(float)), policy[[0, 3]])
    nowhere = np.full((1, states.shape[1]), -9.0)
    np.testing.assert_allclose(chances(nowhere), 1.0 / policy.shape[1])


def estimate(low, high):
    """An estimate of r_env between two values, with many resamples between them."""
    env = np.linspace(low, high, 401)
    resampled = np.stack([env, np.zeros(401)], axis=1)
    return Estimate(resampled[200], resampled)


def test_every_estimator_has_a_row_with_its_interval():
    narrow, wide = estimate(0.9, 1.1), estimate(0.0, 2.0)
    found = OffPolicy(wide, wide, narrow, effective=9.0, left=0.1, episodes=20)
    rows = list(_estimates({"angle": 0.0, "seed": 1}, found, 1.2))
    assert [row["estimator"].split(",")[0] for row in rows] == ["fitted Q"] + 2 * ["importance"]
    assert [row["covers"] for row in rows] == [0, 1, 1]
    assert all(row["value"] == pytest.approx(1.0) and row["exact"] == 1.2 for row in rows)
    assert all(row["low"] < row["value"] < row["high"] for row in rows)
    assert rows[0]["effective"] == 9.0 and rows[0]["seed"] == 1
    assert rows[0]["supported"] == int(found.fitted_supported)


def test_what_is_infinite_is_empty():
    nothing = Estimate(np.full(2, np.nan), np.full((401, 2), np.nan))
    found = OffPolicy(nothing, nothing, estimate(0.0, 2.0), effective=0.0, left=1.0, episodes=20)
    _, weighted, _ = _estimates({"angle": 0.0}, found, 1.2)
    assert (weighted["value"], weighted["supported"]) == ("", 0)


def test_supported_estimates_are_pooled_apart():
    rows = [
        {"supported": 1, "covers": 1, "value": 2.0, "exact": 1.5, "low": 1.0, "high": 3.0},
        {"supported": 1, "covers": 0, "value": 4.0, "exact": 1.5, "low": 3.0, "high": 5.0},
        {"supported": 0, "covers": 1, "value": "", "exact": 1.5, "low": "", "high": ""},
    ]
    row = _pooled(rows)
    assert row["estimates"] == 3 and row["supported"] == pytest.approx(2 / 3)
    assert (row["covers_supported"], row["error_supported"]) == (0.5, 1.5)
    assert (row["largest_error_supported"], row["width_supported"]) == (2.5, 2.0)
    assert row["covers_others"] == row["error_others"] == row["width_others"] == ""
