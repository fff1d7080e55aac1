"""Passes by declared angle: the tests of many audits at once are those of one audit."""

import dataclasses

import numpy as np
import pytest
from tests.unit.audit.conftest import outcomes

from socialiq import QPolicy
from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.profile.profile import Clip
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.verdict import decide
from socialiq.statistics.intervals import clopper_pearson
from socialiq_lab.audit_arena import default_declaration
from socialiq_lab.audit_drivers import Driven, drive_optima, mixtures, rash
from socialiq_lab.audit_pool import Audits, most_events, resampled
from studies.audit_angles.study import harmful, worst_rows

EPISODES, AUDITS = 300, 8


def driven(name, angle, rng, kind="dial"):
    """A driver of the intersection by a made-up front, which arrives in all but a few episodes."""
    radians = np.deg2rad(angle)
    totals = 4.0 * np.array([np.cos(radians), np.sin(radians)]) + 0.7 * rng.normal(size=(2000, 2))
    ending = np.where(rng.random(2000) < 0.01, 2, 1)
    made = outcomes(
        name, totals, ending, np.ones(2000), angles=(1.0 * angle,) if kind == "dial" else ()
    )
    return Driven(made, kind, angle, kind == "dial")


@pytest.fixture(scope="module")
def pool():
    rng = np.random.default_rng(0)
    dials = {
        f"dial_{a:g}": driven(f"dial_{a:g}", a, rng) for a in np.arange(0.0, 91.0, 15.0).tolist()
    }
    return dials | {"weak": driven("weak", 40.0, rng, "weaker dial")}


def one_audit(audits, driver, rows):
    """Judge the same episodes as an audit does."""

    def part(row, name):
        return dataclasses.replace(row, name=name, episodes=row.episodes.rows(rows))

    references = tuple(part(row, row.name) for row in audits.references)
    made = Evidence("made up", rows, part(driver, "policy"), references, {})
    found = decide(audits.profile, made, 0, 100, 0.05)
    tests = found.regret, found.direction, found.character
    kept = [test.decision is Decision.PASS for test in tests]
    return [kept[0], kept[1], all(t.decision is Decision.PASS for t in found.competence), kept[2]]


@pytest.mark.parametrize("name", ["dial_45", "dial_30", "dial_60", "dial_0", "weak"])
def test_many_audits_at_once_are_single_audits(pool, name):
    audits, driver = Audits.of("intersection", 45.0, pool), pool[name].outcomes
    kept = audits.tested(driver, EPISODES, AUDITS, 5)
    every = np.array([kept[test] for test in ("regret", "direction", "floor", "character")]).T
    for rows, row in zip(resampled(2000, EPISODES, AUDITS, 5), every.tolist(), strict=True):
        if name in ("dial_45", "dial_30", "dial_60"):  # its own row is one of the references
            row[0] = True
            assert [True, *one_audit(audits, driver, rows)[1:]] == row
        else:
            assert one_audit(audits, driver, rows) == row


def test_in_a_gridworld_too():
    pool = drive_optima("crossing5", np.arange(600, dtype=np.int64))
    audits = Audits.of("crossing5", 45.0, pool)
    for name, passes in (("optimum of 45", True), ("optimum of 0", False)):
        found = audits.shares(pool[name].outcomes, 1500, 3, 1)
        assert found["passed"] == float(passes)
        assert audits.holds(pool[name].outcomes) == passes


def test_the_largest_number_of_events():
    for limit in (0.0, 0.005, 0.05, 0.3):
        count = most_events(limit, 400)
        bounds = [clopper_pearson(k, 400, 0.9).high for k in (max(count, 0), count + 1)]
        assert bounds[1] > limit and (count < 0 or bounds[0] <= limit)


def test_a_default_declaration_has_a_clip_or_a_largest_loss():
    assert default_declaration("intersection", 0.0).clip == Clip((-8.0, 12.0), (-12.0, 12.0))
    assert default_declaration("crossing5", 0.0).largest_loss == 26.01


def test_a_mixture_draws_one_of_two_for_each_episode(pool):
    rows = dict(mixtures(pool, 3, (0.25,)))
    assert len(rows) == 7 * 6 // 2
    mixed = rows["25 % dial_0, else dial_45"].outcomes
    first = (mixed.totals == pool["dial_0"].outcomes.totals).all(axis=1)
    other = (mixed.totals == pool["dial_45"].outcomes.totals).all(axis=1)
    assert (first ^ other).all() and 0.2 < first.mean() < 0.3


def test_the_worst_policy_is_one_that_passes(pool):
    rows = [row for row in worst_rows(pool, 3) if row["declared"] == 45.0]
    assert {row["measure"] for row in rows} == {"at_fault", "collisions", "r_social", "distance"}
    assert all(0 < row["passing"] <= row["tried"] for row in rows)


def test_a_rash_driver_goes_where_another_is_near():
    class Waits:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return np.zeros(len(observation), np.int64), state

    seen = np.zeros((2, 70), np.float32)
    seen[:, [0, 7]] = 1.0
    seen[0, 8], seen[1, 8] = 0.05, 0.5  # 5 m and 50 m away
    assert rash(Waits(), 1.0).predict(seen)[0].tolist() == [2, 0]


@pytest.mark.parametrize(("most", "action"), [(0.0, 1), (0.5, 2), (3.0, 0)])
def test_a_fitted_driver_takes_the_most_harmful_action_that_loses_little(most, action):
    bias = np.array([1.0, 3.0, 2.5], np.float32)  # values of the actions
    own = QPolicy((np.zeros((3, 4), np.float32),), (bias,), "relu", 1.0, {"made": "by hand"})
    driver = harmful(own, lambda seen: np.tile([9.0, 0.0, 5.0], (len(seen), 1)), most)
    assert driver.predict(np.zeros((2, 4), np.float32))[0].tolist() == [action] * 2
