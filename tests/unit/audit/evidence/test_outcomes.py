"""Outcomes of drivers in the same episodes."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.types import Ending


def test_contacts_are_told_apart(outcomes):
    kinds = [Ending.COLLISION, Ending.COLLISION, Ending.COLLISION, Ending.ARRIVAL]
    made = outcomes("driver", np.zeros((4, 2)), kinds, [0, 1, 2, 2])
    # A collision without blame counts as the ego's.
    assert made.episodes.at_fault.tolist() == [True, True, False, False]
    assert made.episodes.struck.tolist() == [False, False, True, False]


def test_gains_are_the_references_less_the_policys(outcomes, evidence):
    found = evidence(outcomes("p", [[1, 2], [3, 4]]), outcomes("r", [[2, 2], [3, 7]]))
    assert found.gains().tolist() == [[[1.0, 0.0], [0.0, 3.0]]]
    assert found.policy.mean == (2.0, 3.0)


def test_evidence_that_does_not_fit_is_refused(outcomes, evidence):
    two, three = np.zeros((2, 2)), np.zeros((3, 2))
    with pytest.raises(UserError, match="at least one reference"):
        evidence(outcomes("p", two))
    with pytest.raises(UserError, match="r drove 3 of 2"):
        evidence(outcomes("p", two), outcomes("r", three))
    with pytest.raises(UserError, match="different names"):
        evidence(outcomes("p", two), outcomes("p", two))
    with pytest.raises(UserError, match="not finite"):
        outcomes("p", [[1.0, np.nan]])
