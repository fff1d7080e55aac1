"""The verdict in one sentence for anybody."""

from __future__ import annotations

from socialiq.audit.decision import Decision
from socialiq.audit.regret import RegretTest
from socialiq.audit.safety_floor import FloorTest

_HAPPENING = {
    "at_fault": "drives into somebody",
    "struck": "is driven into by somebody",
    "arrival": "arrives",
    "timeout": "runs out of time",
}


def reason_of(decision: Decision, regret: RegretTest, competence: tuple[FloorTest, ...]) -> str:
    """Say why a policy passed, failed, or neither.

    Args:
        decision: The joined one.
        regret: The primary test.
        competence: The floor's tests.
    """
    if decision is Decision.FAIL:
        return _failed(regret, [one for one in competence if one.decision is Decision.FAIL])
    where = f"at the declared {regret.angle:g} degrees"
    if decision is Decision.PASS:
        less = f"at most {_number(regret.high)} less" if regret.high > 0.0 else "no less"
        return (
            f"{where.capitalize()} the policy earns {less} per episode than the best reference "
            f"driver ({_number(regret.margin)} less is allowed), and it keeps the declared "
            "competence floor."
        )
    open_tests = [_HAPPENING[one.name] for one in competence if one.decision is not Decision.PASS]
    doubts = [f"earns enough {where}"] if regret.decision is not Decision.PASS else []
    doubts += [
        f"{one} often enough" if one == "arrives" else f"{one} too often" for one in open_tests
    ]
    return (
        f"{regret.episodes} episodes are too few to tell whether the policy "
        f"{' and whether it '.join(doubts)}."
    )


def _failed(regret: RegretTest, broken: list[FloorTest]) -> str:
    parts = []
    if regret.decision is Decision.FAIL:
        parts.append(
            f"at the declared {regret.angle:g} degrees it earns at least {_number(regret.low)} "
            f"less per episode than {regret.best} ({_number(regret.margin)} is allowed)"
        )
    for one in broken:
        bound = (
            f"at most {_percent(one.high)}"
            if one.side == "at least"
            else f"at least {_percent(one.low)}"
        )
        allowed = "needed" if one.side == "at least" else "allowed"
        parts.append(
            f"it {_HAPPENING[one.name]} in {bound} of episodes "
            f"({one.side} {_percent(one.limit)} {allowed})"
        )
    return f"The policy does not behave as declared: {', and '.join(parts)}."


def _number(value: float) -> str:
    return f"{value:.3g}"


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"
