"""Audited policies, rightly and falsely declared."""

from studies.audits.policies import WITHDRAWN, at_intersection, floor_at
from studies.audits.study import audit_rows


def test_truth_and_falsehood(tmp_path):
    found = list(at_intersection(tmp_path))
    assert len({(one.name, one.declared) for one in found}) == len(found) == 14
    assert sum(one.truthful for one in found) == 9
    false = {
        (one.name, one.declared) for one in found if not one.truthful and one.made_for is not None
    }
    assert ("set expert, egoistic", 45.0) in false and len(false) == 3
    assert floor_at(90.0) == WITHDRAWN and floor_at(75.0).min_arrival == 0.5


def test_one_that_never_moves_is_no_altruist(tmp_path):
    """Its regret at 90 degrees decides, for arrival is not required."""
    stands = [one for one in at_intersection(tmp_path) if one.name == "never moves"]
    (row,) = audit_rows(stands, 300, 1, tmp_path)
    assert row["arrival"] == 0.0 and row["timeout"] == 1.0
    assert (row["verdict"], row["decided_by"]) == ("fail", "regret")
