"""Results of the thesis' printed numbers, by hand where possible."""

import math

import pytest
from scipy.stats import t

from socialiq.audit.profile.profile import Margin
from studies.audits.study import floor_rows, learner_angle_rows, return_rows

MARGIN = Margin(1.0, 10.0)


@pytest.fixture(scope="module")
def returns():
    return {row["policy"]: row for row in return_rows(MARGIN, 0.05, 400)}


def test_each_expert_is_the_best_of_the_three_at_its_angle(returns):
    # J(0): 7.13 against 4.88; J(45): (4.88 + 0.68) against (7.13 - 2), by √2; J(90): 1.76 and 0.68
    assert returns["expert egoistic"]["regret"] == pytest.approx(4.88 - 7.13)
    assert returns["expert prosocial"]["regret"] == pytest.approx((5.13 - 5.56) / 2**0.5)
    assert returns["expert altruistic"]["regret"] == pytest.approx(0.68 - 1.76)
    assert returns["expert egoistic"]["best_of_the_others"] == "prosocial"
    # Two are equal where tan α = ΔR_env / ΔR_social: 2.25 / 2.68 and 4.87 / 1.08.
    first, second = (math.degrees(math.atan2(*pair)) for pair in ((2.25, 2.68), (4.87, 1.08)))
    assert returns["expert prosocial"]["best_at"] == f"{math.ceil(first)} to {int(second)}"


def test_angles_and_what_would_decide(returns):
    row = returns["expert egoistic"]
    assert row["alpha_hat"] == pytest.approx(math.degrees(math.atan2(-2.0, 7.13)))
    # At worst the two errors of α̂ add: (7.13 * 4.84 + 2 * 3.26) / (7.13² + 2²) radians an episode.
    turning = (7.13 * 4.84 + 2 * 3.26) / (7.13**2 + 4)
    assert row["half_width"] == pytest.approx(math.degrees(1.959964 * turning / 20))
    # 2.926 * (3.26 + 3.44) / 3.25, squared
    assert row["deciding_episodes"] == math.ceil((2.926405 * 6.7 / 3.25) ** 2)


def test_the_learners_angles_on_the_experts_curve():
    found = {row["policy"]: row for row in learner_angle_rows(MARGIN)}
    ego, pro = math.degrees(math.atan2(-2.0, 7.13)), math.degrees(math.atan2(0.68, 4.88))
    assert found["egoistic"]["calibrated"] == pytest.approx(45 * (0 - ego) / (pro - ego))
    assert found["egoistic"]["within_margin"] == 0
    assert found["prosocial"]["distance"] == pytest.approx(found["prosocial"]["calibrated"] - 45)
    assert found["altruistic"]["calibrated"] == ""  # no expert shows 131 degrees


def test_floors_by_hand():
    rows = {(row["policy"], row["criterion"]): row for row in floor_rows(0.05, 1000)}
    assert len(rows) == 7 * 3
    ego = rows["expert egoistic", "collision"]
    # 29 ± 5.4 % over five seeds, wrong fail 0.05 / 8: more than both limits together, 0.05 + 0.1.
    assert ego["seeds_low"] == pytest.approx(0.29 - t.isf(0.05 / 8, 4) * 0.054 / 5**0.5)
    assert ego["fails_beyond"] == pytest.approx(0.15) and ego["of_seeds"] == "fail"
    assert ego["implied_episodes"] == round(0.29 * 0.71 / 0.054**2)
    arrival = rows["expert egoistic", "arrival"]
    assert (arrival["of_seeds"], arrival["of_episodes"]) == ("inconclusive", "fail")
    # Who is declared for 90 degrees isn't asked to arrive, but collisions count.
    assert rows["altruistic", "arrival"]["of_episodes"] == "pass"
    assert rows["expert altruistic", "collision"]["of_seeds"] == "fail"
    assert rows["baseline", "arrival"]["of_seeds"] == "fail"
