"""Finding that a policy's answers depend on more than the observation."""

from socialiq.audit.evidence.outcomes import Answers, Consistency
from socialiq.audit.verdict.results import dependence

NONE = Answers(1000, 0)


def test_consistent_answers_are_no_finding():
    assert dependence(None) == ""
    assert dependence(Consistency(NONE, NONE, NONE)) == ""


def test_the_finding_counts_the_answers():
    text = dependence(Consistency(Answers(1000, 1), Answers(1000, 30), NONE))
    assert text == (
        "The policy's answers depend on the time or the number of requests and on the batch, the "
        "order or the process: 31 of 3,000 repeated queries got another answer, so its episodes "
        "don't show how it drives elsewhere."
    )
