import math

import pytest

from socialiq.audit.verdict.decision import Decision, decide, episodes_needed


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


def test_episodes_needed_by_hand():
    # ((1.644854 + 1.281552) * 2 / 0.5)^2 = 137.02
    assert episodes_needed(0.5, 2.0, 0.05) == 138
    assert episodes_needed(-0.5, 2.0, 0.05) == 138
    assert episodes_needed(0.0, 2.0, 0.05) is None
    assert episodes_needed(5.0, 0.0, 0.05) == 1
