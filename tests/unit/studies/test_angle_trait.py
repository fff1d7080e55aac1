"""Planted angles in simulated traffic: a small population of planners."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.nn.dial_policy import DialPolicy
from socialiq_lab.registry import find
from socialiq_lab.study import run
from socialiq_recordings.trait.models import fit_models
from studies.angle_trait.study import DIAL, Population, choices_of, drive, fit_family, recovery

STUDY = find("angle-trait")
Config = STUDY.Config


@pytest.fixture(scope="module")
def driven():
    """Eight egoists and eight altruists, six episodes each."""
    angle = np.repeat([0.0, 90.0], 8)
    decided = drive(Population("planner", angle, 2.0), DialPolicy.load(DIAL), 6, 50_800_000)
    return angle, decided


def test_each_driver_has_its_own_episodes(driven):
    table = choices_of(driven[1], 6, 4)
    assert sorted({*table.driver.tolist()}) == list(range(16))
    np.testing.assert_array_equal(table.driver, table.chain)
    for driver in range(16):
        mine = table.rows(table.driver == driver)
        order = np.argsort(mine.time)
        assert (np.diff(mine.half[order]) >= 0).all()  # the first episodes infer
    assert len(table) < len(driven[1].row)


def test_planted_angles_are_recovered(driven):
    angle, decided = driven
    found = recovery(fit_models(choices_of(decided, 6, 6), seed=0, step=30.0), angle)
    assert found["correlation"] > 0.8
    assert found["spread_low"] > 0.0


def test_dials_choose_as_their_policies():
    dial = DialPolicy.load(DIAL)
    decided = drive(Population("dial", np.array([30.0]), 0.0), dial, 1, 50_800_500)
    np.testing.assert_allclose(np.exp(decided.log_base).sum(axis=1), 1.0)
    assert (np.exp(decided.log_base)[np.arange(len(decided.action)), decided.action] > 0.01).all()


def test_angles_of_a_dial_are_recovered_by_that_dial():
    """The model is true up to its random choices: egoists and altruists are told apart."""
    dial, angle = DialPolicy.load(DIAL), np.repeat([10.0, 85.0], 4)
    decided = drive(Population("dial", angle, 0.0), dial, 4, 50_800_600)
    known = decided._replace(seen=decided.seen[:, :-1])  # this dial doesn't observe the time
    found = recovery(fit_family(known, 4, 4, dial, seed=0, step=15.0), angle)
    assert found["correlation"] > 0.9 and found["error"] < 15.0


def test_the_study_makes_its_tables():
    config = Config(50_801_000, repeats=1, drivers=3, lengths=(2,), spreads=(0.0,), step=90.0)
    results = run(STUDY, config)
    pooled = results.tables["pooled"]
    assert [row["kind"] for row in pooled] == ["planner", "dial", "dial"]
    assert [row["inferred_from"] for row in pooled] == ["returns", "returns", "another dial"]
    assert len(results.tables["drivers"]) == 9
    assert STUDY.figures(results).keys() == {"angles"}


@pytest.mark.parametrize(
    "wrong", [{"lengths": (3,)}, {"lengths": ()}, {"drivers": 1}, {"step": 7.0}]
)
def test_bad_options_are_refused(wrong):
    with pytest.raises(UserError):
        run(STUDY, Config(**wrong))
