"""The joined verdict: every test on the same evidence, one decision, one sentence."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from socialiq.audit.evidence.outcomes import CRITERIA, Evidence, Outcomes
from socialiq.audit.profile.profile import Floor, Profile
from socialiq.audit.verdict.calibration import Calibration, calibrate
from socialiq.audit.verdict.compatible_angles import CompatibleAngles, compatible_angles
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.regret import Regrets, RegretTest, regret_test
from socialiq.audit.verdict.safety_floor import FloorTest, decision_of, floor_tests
from socialiq.errors import UserError
from socialiq.social.angle import AngleEstimate, estimate_angle
from socialiq.statistics.hotelling import Ellipse, confidence_ellipse


@dataclass(frozen=True)
class Verdict:
    """Result of an audit.

    Attributes:
        decision: PASS if regret and competence pass, FAIL if one of them fails.
        reason: Why, in one plain sentence.
        episodes: Played.
        needed: Episodes that would decide an inconclusive audit; None if it is decided, or if an
            estimate lies on its limit, where none is enough.
        error: Chance of a wrong pass, and of a wrong fail, at most: 1 - the declared confidence.
        regret: The primary test.
        rationalised: Angles that would rationalise the behaviour.
        alpha_hat: α̂ of the thesis with its two-sided interval; None if it isn't identified.
        identifiability: The guard.
        calibration: Equivalence on the calibrated angle; reported, not decisive.
        competence: The floor, criterion by criterion.
    """

    decision: Decision
    reason: str
    episodes: int
    needed: int | None
    error: float
    regret: RegretTest
    rationalised: CompatibleAngles
    alpha_hat: AngleEstimate | None
    identifiability: Ellipse
    calibration: Calibration
    competence: tuple[FloorTest, ...]


@dataclass(frozen=True)
class Decisive:
    """Deciding parts of an audit: both tests, and their joined decision."""

    decision: Decision
    regret: RegretTest
    competence: tuple[FloorTest, ...]


def decide_on(
    evidence: Evidence,
    regrets: Regrets,
    angle: float,
    margin: float,
    floor: Floor,
    error: float,
) -> Decisive:
    """Test regret and competence, and join them.

    A pass needs the regret test and all four criteria of competence to pass, each at the full
    error: if any of them is truly broken, the chance that it passes all the same bounds the
    chance of a wrong pass, whatever the others do (intersection-union, Berger 1982). A fail needs
    only one, so the error is shared out: half to regret, an eighth to each criterion. So a wrong
    pass and a wrong fail each have a chance of at most the error, as far as the bounds keep their
    levels: those of shares do, bootstrap-t is approximate (`power` shows by how much).

    Args:
        evidence: Policy and references.
        regrets: Of the evidence.
        angle: Declared, degrees.
        margin: Of regret, reward per episode.
        floor: Of competence.
        error: Of a wrong pass, and of a wrong fail.
    """
    regret = regret_test(regrets, evidence, angle, margin, error, error / 2)
    return joined(regret, evidence.policy, floor, error)


def joined(regret: RegretTest, policy: Outcomes, floor: Floor, error: float) -> Decisive:
    """Join the regret test, made at its share of the error, with the floor's (`decide_on`)."""
    competence = floor_tests(policy, floor, error, error / 2)
    return Decisive(_joined(regret.decision, decision_of(competence)), regret, competence)


def judge(profile: Profile, evidence: Evidence, seed: int, resamples: int = 2000) -> Verdict:
    """Test a policy's evidence against its declaration.

    The whole has the level 1 - confidence either way (`decide_on`). α̂ and its calibration do not
    decide: their errors add nothing.

    Args:
        profile: The declaration.
        evidence: Of `gather`, in the profile's world.
        seed: Of the resampling.
        resamples: How many.

    Raises:
        UserError: If the evidence is of another scenario.
    """
    if hashlib.sha256(evidence.scenario.encode()).hexdigest() != profile.scenario.sha256:
        raise UserError("the evidence is of another scenario than the profile: gather it anew")
    error = round(1.0 - profile.confidence, 9)  # 0.05, not 0.050000000000000044
    angle, margin = profile.angle, profile.margin
    regrets = Regrets(evidence, seed, resamples)
    found = decide_on(evidence, regrets, angle, margin.regret, profile.competence, error)
    undecided = found.decision is Decision.INCONCLUSIVE
    guard = confidence_ellipse(evidence.policy.totals, profile.confidence)
    identified = not guard.holds_origin
    env, social = evidence.policy.totals.T.copy()
    return Verdict(
        decision=found.decision,
        reason=reason_of(found.decision, found.regret, found.competence),
        episodes=evidence.episodes,
        needed=_needed(found.regret, found.competence) if undecided else None,
        error=error,
        regret=found.regret,
        rationalised=compatible_angles(regrets, margin.regret, error, error / 2),
        alpha_hat=estimate_angle(env, social, seed, profile.confidence, resamples)
        if identified
        else None,
        identifiability=guard,
        calibration=calibrate(evidence, angle, margin.degrees, identified, seed, error, resamples),
        competence=found.competence,
    )


def _joined(regret: Decision, competence: Decision) -> Decision:
    if Decision.FAIL in (regret, competence):
        return Decision.FAIL
    passed = regret is Decision.PASS and competence is Decision.PASS
    return Decision.PASS if passed else Decision.INCONCLUSIVE


def _needed(regret: RegretTest, competence: tuple[FloorTest, ...]) -> int | None:
    """Episodes that the slowest open test needs, None if no number is enough."""
    needs = [one.needed for one in (regret, *competence) if one.decision is Decision.INCONCLUSIVE]
    known = [one for one in needs if one is not None]
    return max(known) if len(known) == len(needs) else None


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
    open_tests = [CRITERIA[one.name] for one in competence if one.decision is not Decision.PASS]
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
            f"it {CRITERIA[one.name]} in {bound} of episodes "
            f"({one.side} {_percent(one.limit)} {allowed})"
        )
    return f"The policy does not behave as declared: {', and '.join(parts)}."


def _number(value: float) -> str:
    return f"{value:.3g}"


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"
