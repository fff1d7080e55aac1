"""The score of unlikeness: its covariance, its thresholds, and its place in a policy's file."""

import dataclasses

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.nn.ensemble import EnsemblePolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.unlikeness import RATES, Unlikeness
from socialiq.storage import save_arrays

RNG = np.random.default_rng(0)
FEATURES = RNG.normal(size=(20_000, 3)) * [1.0, 2.0, 0.5] + [0.0, 5.0, 1.0]


@pytest.fixture(name="scored")
def scored_policy():
    shapes = [(4, 2), (3, 4)]
    weights = tuple(RNG.normal(size=shape).astype(np.float32) for shape in shapes)
    policy = QPolicy(weights, tuple(np.ones(shape[0], np.float32) for shape in shapes), "relu", 1.0)
    seen = RNG.normal(size=(2, 500, 2)).astype(np.float32)
    return dataclasses.replace(policy, unlikeness=Unlikeness.fit(*map(policy.features, seen)))


def test_it_is_the_squared_distance_in_units_of_the_usual_threshold():
    score = Unlikeness.fit(FEATURES[:10_000], FEATURES[10_000:])
    rows = np.array([[0.0, 5.0, 1.0], [2.0, 5.0, 1.0], [0.0, 9.0, 1.0], [0.0, 5.0, 0.0]])
    unit = 11.34  # the upper hundredth of chi-squared with three degrees of freedom
    np.testing.assert_allclose(score(rows) * unit, [0.0, 4.0, 4.0, 4.0], atol=0.4)


def test_held_out_rows_raise_alarms_at_each_rate():
    score = Unlikeness.fit(FEATURES[:10_000], FEATURES[10_000:])
    above = (score(FEATURES[10_000:])[:, None] > score.thresholds + 1e-5).mean(axis=0)
    np.testing.assert_allclose(above, RATES, atol=0.0015)
    assert score.thresholds[9] == 1.0


def test_the_covariance_is_shrunk_by_the_weights_of_ledoit_and_wolf():
    """The variances 2 and 0.5 become 1.2917 and 1.2083: d² = 1.125 and b² = 1.0625."""
    rows = np.array([[2.0, 0.0], [-2.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    along, across = Unlikeness.fit(rows, rows[:1])(np.array([[2.0, 0.0], [0.0, 2.0]]))
    assert along == pytest.approx(1.0) and across == pytest.approx(1.2917 / 1.2083, abs=1e-4)


def test_features_that_never_vary_are_refused():
    with pytest.raises(UserError, match="no feature of this policy varies"):
        Unlikeness.fit(np.ones((5, 2)), np.ones((5, 2)))


def test_a_file_keeps_it_and_one_without_has_none(scored, tmp_path):
    plain = dataclasses.replace(scored, unlikeness=None)
    for policy, version in ((scored, 3), (plain, 2)):
        assert policy.version == version
        policy.save(tmp_path / "policy.safetensors")
        loaded = QPolicy.load(tmp_path / "policy.safetensors")
        assert (loaded.unlikeness is None) == (version == 2)
    for before, after in zip(*(vars(scored.unlikeness).values(),) * 2, strict=True):
        np.testing.assert_array_equal(before, after)


def test_arrays_that_dont_fit_are_refused(scored, tmp_path):
    (arrays, header), path = scored.content(), tmp_path / "policy.safetensors"
    rising = {"unlikeness_thresholds": arrays["unlikeness_thresholds"][::-1]}
    for damaged in (rising, {"unlikeness_mean": arrays["unlikeness_mean"][:2]}):
        save_arrays(path, "policy", 3, arrays | damaged, header)
        with pytest.raises(UserError, match="a score of unlikeness that doesn't fit its layers"):
            QPolicy.load(path)


def test_an_ensemble_has_none(scored):
    assert EnsemblePolicy.of([scored, scored]).members[0].unlikeness is None


def test_alarms_need_a_score_and_a_rate(scored):
    far = np.array([[100.0, 100.0], [0.0, 0.0]], np.float32)
    assert scored.alarm(0.01)(far).tolist() == [True, False]
    with pytest.raises(UserError, match=r"from 0\.001 to 0\.5"):
        scored.alarm(0.7)
    with pytest.raises(UserError, match="add one by `socialiq unlikeness`"):
        dataclasses.replace(scored, unlikeness=None).alarm()
