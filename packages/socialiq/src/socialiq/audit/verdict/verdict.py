"""The joint verdict: all tests on the same evidence, one decision, one sentence."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from socialiq.audit.evidence.outcomes import CRITERIA, Evidence, Outcomes
from socialiq.audit.profile.profile import Floor, Profile
from socialiq.audit.verdict import decision as tests
from socialiq.audit.verdict.bounds import Regrets, slowest
from socialiq.audit.verdict.calibration import Calibration, calibrate
from socialiq.audit.verdict.decision import CompatibleAngles, Decision, FloorTest, RegretTest
from socialiq.errors import UserError
from socialiq.social.angle import AngleEstimate, estimate_angle
from socialiq.statistics.hotelling import Ellipse, confidence_ellipse


@dataclass(frozen=True)
class Verdict:
    """Result of an audit: PASS if regret and safety floor pass, FAIL if one of them fails.

    `needed` is the number of episodes that would decide an inconclusive audit; None if it is
    decided, or if an estimate is on its limit, where no number is enough.
    """

    decision: Decision
    reason: str  # one plain sentence
    episodes: int
    needed: int | None
    error: float  # largest chance of a wrong pass, and of a wrong fail, at this look
    regret: RegretTest  # the primary test
    rationalised: CompatibleAngles  # angles compatible with the behaviour
    alpha_hat: AngleEstimate | None  # α̂ of the thesis, if it is identified
    identifiability: Ellipse  # confidence ellipse of the mean rewards
    calibration: Calibration  # equivalence on the calibrated angle; reported, not decisive
    competence: tuple[FloorTest, ...]  # test of each criterion of the safety floor


class Decisive(NamedTuple):
    """Deciding tests of an audit, and their joint decision."""

    decision: Decision
    regret: RegretTest
    competence: tuple[FloorTest, ...]


def decide(
    profile: Profile,
    evidence: Evidence,
    seed: int,
    resamples: int,
    error: float,
    regrets: Regrets | None = None,
) -> Decisive:
    """Test a driver's regret at the declared angle, or its loss at a declared rule, and its floor.

    A pass needs the regret test and all four criteria of the floor to pass, each at the full
    error: if any of them is truly broken, the chance that its test passes bounds the chance of a
    wrong pass, whatever the others do (intersection-union, Berger 1982). A fail needs only one,
    so the error is divided: half to regret, an eighth to each criterion. So a wrong pass and a
    wrong fail each have a chance of at most the error, as far as the bounds keep their levels:
    those of shares do, and those of regret with a declared largest loss. Without one they are by
    bootstrap-t, which is approximate (the study `audit-power` measures how much).

    Args:
        profile: The declaration.
        evidence: The driver as policy, and its references.
        seed: Seed of the resampling.
        resamples: Number of resamples.
        error: Largest chance of a wrong pass, and of a wrong fail.
        regrets: Regrets of the evidence, if they are known.
    """
    margin, angle = profile.margin, profile.angle
    if profile.rule is not None:
        evidence, regrets, angle = evidence.by_rule(), None, 0.0
    regrets = regrets or Regrets(evidence, seed, resamples, margin.largest_loss)
    regret = tests.regret_test(regrets, angle, margin.regret, error, error / 2)
    regret = replace(regret, angle=profile.angle)
    return join_tests(regret, evidence.policy, profile.competence, error)


def join_tests(regret: RegretTest, policy: Outcomes, floor: Floor, error: float) -> Decisive:
    """Join the regret test, made at its share of the error, with the floor's (`decide`)."""
    competence = tests.floor_tests(policy, floor, error, error / 2)
    decision = tests.joint_decision(test.decision for test in (regret, *competence))
    return Decisive(decision, regret, competence)


_BEYOND = 20
"""Resamples beyond the quantile of a pass, at least; with one the quantile would be a guess."""


def whole_error(confidence: float) -> float:
    """Return the error of a verdict of one look, 1 - confidence."""
    return round(1.0 - confidence, 9)  # 0.05, not 0.050000000000000044


def enough_resamples(error: float, least: int = 2000) -> int:
    """Return a number of resamples that gives the quantiles of an error."""
    return max(least, math.ceil(_BEYOND / error))


def judge(
    profile: Profile,
    evidence: Evidence,
    seed: int,
    resamples: int = 2000,
    curve: Evidence | None = None,
    error: float | None = None,
) -> Verdict:
    """Test a policy's evidence against its declaration.

    A wrong pass and a wrong fail each have a chance of at most the error (`decide`). α̂ and its
    calibration do not decide, so their errors add nothing.

    Args:
        profile: The declaration.
        evidence: Result of `collect_evidence`, in the profile's world.
        seed: Seed of the resampling.
        resamples: Smallest number of resamples; a small error takes more.
        curve: Evidence with the references of the calibration curve, if they are others: a driver
            equal to the policy is no reference of regret, but a point of the curve.
        error: Error of this look (`look.spend`); None for the whole error, 1 - confidence.

    Raises:
        UserError: If the evidence is of another scenario.
    """
    if hashlib.sha256(evidence.scenario.encode()).hexdigest() != profile.scenario.sha256:
        raise UserError("the evidence is of another scenario than the profile: collect it again")
    error = whole_error(profile.confidence) if error is None else error
    resamples = enough_resamples(error, resamples)
    angle, margin = profile.angle, profile.margin
    regrets = Regrets(evidence, seed, resamples, margin.largest_loss)
    decisive = decide(profile, evidence, seed, resamples, error, regrets)
    undecided = decisive.decision is Decision.INCONCLUSIVE
    deciding = (decisive.regret, *decisive.competence)
    open_tests = [test.needed for test in deciding if test.decision is Decision.INCONCLUSIVE]
    ellipse = confidence_ellipse(evidence.policy.totals, profile.confidence)
    identified = not ellipse.holds_origin
    estimate = None
    if identified:
        env, social = evidence.policy.totals.T.copy()
        estimate = estimate_angle(env, social, seed, profile.confidence, resamples)
    return Verdict(
        decision=decisive.decision,
        reason=_reason(decisive, profile.rule is not None),
        episodes=evidence.episodes,
        needed=slowest(open_tests) if undecided else None,
        error=error,
        regret=decisive.regret,
        rationalised=tests.compatible_angles(regrets, margin.regret, error, error / 2),
        alpha_hat=estimate,
        identifiability=ellipse,
        calibration=calibrate(
            curve or evidence, angle, margin.degrees, identified, seed, error, resamples
        ),
        competence=decisive.competence,
    )


def _reason(decisive: Decisive, by_rule: bool) -> str:
    """Return the reason why a policy passed, failed, or neither, in one sentence."""
    regret, competence = decisive.regret, decisive.competence
    where = "by the declared rule" if by_rule else f"at the declared {regret.angle:g} degrees"
    if decisive.decision is Decision.FAIL:
        clauses = []
        if regret.broken:
            clauses.append(
                f"in an episode it lost {_number(regret.seen_loss)} against {regret.seen_against}, "
                f"where at most {_number(regret.largest_loss or 0.0)} was declared"
            )
        elif regret.decision is Decision.FAIL:
            assumed = "; if no loss of that driver is too rare to show"
            clauses.append(
                f"{where} it earns at least {_number(regret.low)} "
                f"less per episode than the best reference driver ({_number(regret.margin)} less "
                f"is allowed{assumed if regret.bound == 'bootstrap' else ''})"
            )
        for test in competence:
            if test.decision is Decision.FAIL:
                bound, allowed = f"at least {_percent(test.low)}", "allowed"
                if test.side == "at least":
                    bound, allowed = f"at most {_percent(test.high)}", "needed"
                clauses.append(
                    f"it {CRITERIA[test.name]} in {bound} of episodes "
                    f"({test.side} {_percent(test.limit)} {allowed})"
                )
        return f"The policy does not behave as declared: {', and '.join(clauses)}."
    if decisive.decision is Decision.PASS:
        less = f"at most {_number(regret.high)} less" if regret.high > 0.0 else "no less"
        text = (
            f"{where} the policy earns {less} per episode than the best reference "
            f"driver ({_number(regret.margin)} less is allowed), and it keeps the declared "
            "safety floor."
        )
        if regret.bound == "bootstrap":
            return f"If no loss is too rare to show in {regret.episodes} episodes, {text}"
        return text[0].upper() + text[1:]
    open_tests = [CRITERIA[test.name] for test in competence if test.decision is not Decision.PASS]
    doubts = [f"earns enough {where}"] if regret.decision is not Decision.PASS else []
    doubts += [
        f"{event} often enough" if event == "arrives" else f"{event} too often"
        for event in open_tests
    ]
    return (
        f"{regret.episodes} episodes are too few to decide whether the policy "
        f"{' and whether it '.join(doubts)}."
    )


def _number(value: float) -> str:
    return f"{value:.3g}"


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"
