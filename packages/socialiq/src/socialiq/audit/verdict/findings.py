"""Findings beside the tests that forbid a pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.verdict import Verdict


class Finding(NamedTuple):
    """A reason why a policy can't pass, whatever the tests say.

    Attributes:
        about: Subject.
        text: One or two sentences.
    """

    about: str
    text: str


def conclude(verdict: Verdict, findings: Sequence[Finding]) -> Verdict:
    """Return the verdict of an audit: INCONCLUSIVE where a finding forbids a pass.

    A fail stays a fail, since no finding makes a policy better. The tests are unchanged, and more
    episodes would not decide.

    Args:
        verdict: Result of `judge`.
        findings: Findings of the audit.
    """
    if verdict.decision is Decision.FAIL or not findings:
        return verdict
    reason = " ".join(one.text for one in findings)
    return replace(verdict, decision=Decision.INCONCLUSIVE, reason=reason, needed=None)
