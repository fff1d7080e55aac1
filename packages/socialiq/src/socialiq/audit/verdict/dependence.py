"""Finding that a policy's answers depend on more than the observation: it can't pass."""

from __future__ import annotations

from socialiq.audit.evidence.consistency import Consistency
from socialiq.audit.verdict.findings import Finding


def dependence(consistency: Consistency | None) -> list[Finding]:
    """Return on what a policy's answers depend besides the observation, or nothing.

    How it drove in the episodes is then no evidence about how it drives elsewhere.

    Args:
        consistency: Answers to repeated queries; None if the policy was not asked.
    """
    found = consistency.dependences if consistency else []
    if not found:
        return []
    assert consistency is not None
    differing, queries = (
        sum(getattr(one, name) for one in consistency) for name in ("differing", "queries")
    )
    text = (
        f"The policy's answers depend on {' and on '.join(found)}: {differing:,} of {queries:,} "
        "repeated queries got another answer, so its episodes don't show how it drives elsewhere."
    )
    return [Finding("code", text)]
