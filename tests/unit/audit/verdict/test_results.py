"""All evidence together: references that are the policy itself, and other traffic."""

import dataclasses

import numpy as np
import pytest

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.consistency import Answers, Consistency
from socialiq.audit.profile.profile import Floor, Margin
from socialiq.audit.seeds import episode_seeds
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.results import discriminate, stratified
from socialiq.audit.verdict.verdict import conclude, dependence, judge
from socialiq.types import Ending
from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy


class Always:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full(len(observation), 1), state


@pytest.fixture(scope="module")
def profile(declared):
    return declared("crossing7", 0.0)


FINDINGS = ["It excludes nothing.", "Answers differ."]


@pytest.fixture(name="passed", scope="module")
def an_expert_that_passes(declared, tabulated):
    table = tabulated("crossing7")
    policy = TabularPolicy(table.world, expert_policy(table, 45.0))
    profile = declared("crossing7", 45.0)
    found = judge(profile, collect_evidence(profile.world(), policy, episode_seeds(0, 200)), 1, 200)
    assert found.decision is Decision.PASS
    return found


def test_a_finding_forbids_a_pass(passed):
    found = conclude(passed, FINDINGS)
    assert found.decision is Decision.INCONCLUSIVE and found.needed is None
    assert found.reason == "It excludes nothing. Answers differ."
    assert found.regret is passed.regret and found.competence is passed.competence


def test_without_findings_the_tests_decide(passed):
    assert conclude(passed, []) is passed


def test_more_episodes_would_not_decide(passed):
    open_one = dataclasses.replace(passed, decision=Decision.INCONCLUSIVE, needed=700)
    found = conclude(open_one, FINDINGS)
    assert found.decision is Decision.INCONCLUSIVE and found.needed is None
    assert found.reason == "It excludes nothing. Answers differ."


def test_a_fail_stays_a_fail(passed):
    failed = dataclasses.replace(passed, decision=Decision.FAIL)
    assert conclude(failed, FINDINGS) is failed


NONE = Answers(1000, 0)


def test_consistent_answers_are_no_finding():
    assert dependence(None, False) == ""
    assert dependence(Consistency(NONE, NONE, NONE), False) == ""


def test_the_finding_counts_the_answers():
    text = dependence(Consistency(Answers(1000, 1), Answers(1000, 30), NONE), False)
    assert text == (
        "The policy's answers depend on the time or the number of requests and on the batch, the "
        "order or the process: 31 of 3,000 repeated queries got another answer, so its episodes "
        "don't show how it drives elsewhere."
    )


OPEN = Floor(1.0, 1.0, 0.0, 1.0)


class Standing:
    """Chooses the first action: it never leaves."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros(len(observation), np.int64), state


@pytest.fixture(scope="module")
def driven(declared):
    return collect_evidence(declared("crossing7").world(), Standing(), episode_seeds(1, 80))


def judged(declared, driven, margin, floor=OPEN, angle=0.0):
    profile = declared("crossing7", angle, margin=Margin(margin, 10.0), competence=floor)
    return discriminate(profile, driven, 0, resamples=200)


def test_each_is_judged_as_if_it_were_the_policy(declared, driven):
    found = judged(declared, driven, 1.0)
    by_name = {one.name: one for one in found.drivers}
    assert found.of == len(driven.references) + len(driven.trivial) == len(by_name)
    assert found.would_pass == sum(one.decision is Decision.PASS for one in found.drivers)
    assert 0 < found.would_pass < found.of
    assert {name for name, one in by_name.items() if one.trivial} == {
        "trivial_STOP",
        "trivial_FAST",
        "trivial_random",
    }
    # The policy of these episodes always stops, as `trivial_STOP` does.
    profile = declared("crossing7", 0.0, margin=Margin(1.0, 10.0), competence=OPEN)
    own = judge(profile, driven, 0, resamples=200)
    assert by_name["trivial_STOP"].decision is own.decision is Decision.FAIL
    assert "trivial_FAST" in found.trivial_passes and "trivial_STOP" not in found.trivial_passes


def test_a_margin_wider_than_every_return_excludes_nothing(declared, driven):
    found = judged(declared, driven, 1e6)
    assert found.would_pass == found.of and len(found.trivial_passes) == 3


def test_a_floor_excludes_something_even_if_the_margin_does_not(declared, driven):
    found = judged(declared, driven, 1e6, Floor(0.05, 0.1, 0.8, 0.2))
    by_name = {one.name: one.decision for one in found.drivers}
    assert by_name["trivial_STOP"] is Decision.FAIL and by_name["trivial_FAST"] is Decision.PASS
    assert "trivial_FAST" in found.trivial_passes and "trivial_STOP" not in found.trivial_passes


def test_a_single_reference_has_none_to_be_compared_with(declared, evidence, outcomes):
    made = evidence(outcomes("policy", np.zeros((30, 2))), outcomes("a", np.ones((30, 2))))
    found = discriminate(declared("crossing7"), made, 0, resamples=200)
    assert (found.of, found.drivers, found.trivial_passes) == (0, (), ())


def test_strata_by_hand(outcomes, evidence):
    kinds = [Ending.ARRIVAL, Ending.COLLISION, Ending.COLLISION, Ending.TIMEOUT, Ending.ARRIVAL]
    policy = outcomes("policy", [[0, 0]] * 5, kinds, [0, 1, 2, 0, 0])
    best = outcomes("best", [[1, 9], [3, 9], [2, 9], [4, 9], [7, 9]])
    other = outcomes("other", [[50, 0]] * 5)
    labels = np.array(["few", "few", "many", "many", "crowd"])
    found = stratified(evidence(policy, other, best, density=labels), 0.0, "best")
    rows = {one.label: one for one in found}
    assert {one.stratification for one in found} == {"density"}
    assert [one.label for one in found] == ["crowd", "few", "many"]
    assert (rows["few"].regret.mean, rows["many"].regret.mean) == pytest.approx((2.0, 3.0))
    # Two differences 1 apart from their mean: error 1, and t(0.975, 1) = 12.706.
    assert rows["few"].regret.high == pytest.approx(2 + 12.706, abs=1e-3)
    assert rows["crowd"].regret is None and rows["crowd"].episodes == 1
    assert rows["few"].shares["at_fault"].value == 0.5
    assert rows["many"].shares["struck"].value == rows["many"].shares["timeout"].value == 0.5
    assert rows["many"].shares["at_fault"].value == 0.0
    assert rows["crowd"].shares["arrival"].value == 1.0
    whole = sum(one.episodes * (one.regret.mean if one.regret else 7.0) for one in found) / 5
    assert whole == pytest.approx((1 + 3 + 2 + 4 + 7) / 5)
