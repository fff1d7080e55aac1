"""Decision of a test, the joint decision of several, and the episodes that would decide."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Sequence


class Decision(enum.Enum):
    """Outcome of a test, and of the whole audit."""

    PASS = "pass"
    FAIL = "fail"
    INCONCLUSIVE = "inconclusive"

    @staticmethod
    def of(holds: bool, broken: bool) -> Decision:
        """Return PASS if a limit holds significantly, FAIL if it is broken, else INCONCLUSIVE.

        Args:
            holds: Whether the limit is significantly kept.
            broken: Whether it is significantly broken.
        """
        if holds:
            return Decision.PASS
        return Decision.FAIL if broken else Decision.INCONCLUSIVE

    @property
    def headline(self) -> str:
        """Decision as the commands print it."""
        return "NOT DECIDED" if self is Decision.INCONCLUSIVE else self.value.upper()


def slowest(needs: Sequence[int | None]) -> int | None:
    """Return the largest of some numbers of episodes; None if no number is enough for one."""
    counts = [count for count in needs if count is not None]
    return max(counts) if len(counts) == len(needs) else None


def joint_decision(decisions: Iterable[Decision | None]) -> Decision:
    """Return PASS if all tests pass, FAIL if any fails, else INCONCLUSIVE."""
    outcomes = set(decisions)
    if Decision.FAIL in outcomes:
        return Decision.FAIL
    return Decision.PASS if outcomes == {Decision.PASS} else Decision.INCONCLUSIVE
