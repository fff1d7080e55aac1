"""Places where two reports differ."""

import copy

import pytest

from socialiq.audit.report.recompute import differences


def test_places_are_named_and_claims_of_the_auditor_may_differ(plain):
    other = copy.deepcopy(plain)
    other["timing"]["seconds"] = 99.0
    other["versions"] = {}
    other["episodes"]["worst"][1]["film"] = "episodes/worst-2.gif"
    assert differences(plain, other) == []
    other["tests"]["regret"]["low"] += 1e-12
    other["references"][0]["name"] = "x"
    other["cloud"].pop()
    del other["limits"]
    assert differences(plain, other) == [
        "report.tests.regret.low",
        "report.cloud",
        "report.limits",
        "report.references[0].name",
    ]


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        (1.0, 1.0 + 1e-10, True),
        (1e6, 1e6 + 1e-4, True),
        (1.0, 1.0 + 1e-8, False),
        (1e-12, -1e-12, True),
        (2, 2.0, True),
        (2, 3, False),
        (10**10, 10**10 + 1, False),
        (1.0, True, False),
        (0.0, None, False),
        ("1.0", 1.0, False),
        ("pass", "fail", False),
        ([1.0], [1.0, 1.0], False),
    ],
)
def test_numbers_agree_within_a_tolerance_counts_and_texts_exactly(old, new, same):
    found = differences({"x": old}, {"x": new}, frozenset(), 1e-9)
    assert (found == []) == same, found


def test_without_a_tolerance_the_last_digit_counts():
    assert differences([0.1 + 0.2], [0.3], frozenset()) == ["report[0]"]


def test_rows_are_ignored_by_their_list():
    old, new = {"rows": [{"a": 1}, {"a": 2}]}, {"rows": [{"a": 3}, {"a": 4}]}
    assert differences(old, new, frozenset({"report.rows[].a"})) == []
    assert len(differences(old, new, frozenset())) == 2
