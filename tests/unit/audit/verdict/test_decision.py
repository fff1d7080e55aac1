import math

import pytest

from socialiq.audit.verdict.bounds import episodes_needed
from socialiq.audit.verdict.decision import Decision, decide, joint_decision


@pytest.mark.parametrize(
    ("low", "high", "decision"),
    [
        (0.0, 0.5, Decision.PASS),
        (0.0, 0.51, Decision.INCONCLUSIVE),
        (0.5, 0.6, Decision.INCONCLUSIVE),
        (0.51, 0.6, Decision.FAIL),
        (-math.inf, math.inf, Decision.INCONCLUSIVE),
    ],
)
def test_bounds_against_a_limit(low, high, decision):
    assert decide(low, high, 0.5) is decision


def test_one_that_fails_fails_all():
    passes, fails, undecided = Decision.PASS, Decision.FAIL, Decision.INCONCLUSIVE
    assert joint_decision([passes, passes]) is passes
    assert joint_decision([passes, undecided]) is undecided
    assert joint_decision([passes, undecided, fails]) is fails


def test_episodes_needed_by_hand():
    # ((1.644854 + 1.281552) * 2 / 0.5)^2 = 137.02
    assert episodes_needed(0.5, 2.0, 0.05) == 138
    assert episodes_needed(-0.5, 2.0, 0.05) == 138
    assert episodes_needed(0.0, 2.0, 0.05) is None
    assert episodes_needed(5.0, 0.0, 0.05) == 1
