import numpy as np
import pytest

from socialiq.audit.verdict.results import stratified
from socialiq.types import Ending


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
