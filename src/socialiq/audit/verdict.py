"""The joined verdict: every test on the same evidence, one decision, one sentence."""

from __future__ import annotations

from dataclasses import dataclass

from socialiq.audit.calibration import Calibration, calibrate
from socialiq.audit.competence import FloorTest, decision_of, floor_tests
from socialiq.audit.decision import Decision
from socialiq.audit.identifiability import Ellipse, ellipse
from socialiq.audit.outcomes import Evidence
from socialiq.audit.profile import Profile
from socialiq.audit.rationalised import Rationalised, rationalised
from socialiq.audit.reason import reason_of
from socialiq.audit.regret import Regrets, RegretTest, regret_test
from socialiq.social.estimate import AngleEstimate, estimate_angle


@dataclass(frozen=True)
class Verdict:
    """What an audit found.

    Attributes:
        decision: PASS if regret and competence pass, FAIL if one of them fails.
        reason: Why, in one sentence for anybody.
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
    rationalised: Rationalised
    alpha_hat: AngleEstimate | None
    identifiability: Ellipse
    calibration: Calibration
    competence: tuple[FloorTest, ...]


def judge(profile: Profile, evidence: Evidence, seed: int, resamples: int = 2000) -> Verdict:
    """Test a policy's evidence against its declaration.

    Levels, with error = 1 - confidence. A pass needs the regret test and all four criteria of
    competence to pass, each at the full error: if any of them is truly broken, the chance that it
    passes all the same bounds the chance of a wrong pass, whatever the others do
    (intersection-union, Berger 1982). A fail needs only one, so the error is shared out: half to
    regret, an eighth to each criterion. So a wrong pass and a wrong fail each have a chance of at
    most the error. α̂ and its calibration do not decide: their errors add nothing.

    Args:
        profile: The declaration.
        evidence: Of `gather`, in the profile's world.
        seed: Of the resampling.
        resamples: How many.
    """
    error = 1.0 - profile.confidence
    regrets = Regrets(evidence, seed, resamples)
    shared = error / 2
    regret = regret_test(regrets, evidence, profile.angle, profile.margin.regret, error, shared)
    competence = floor_tests(evidence.policy, profile.competence, error, shared)
    guard = ellipse(evidence.policy.totals, profile.confidence)
    decision = _joined(regret.decision, decision_of(competence))
    totals = evidence.policy.totals.T
    return Verdict(
        decision=decision,
        reason=reason_of(decision, regret, competence),
        episodes=evidence.episodes,
        needed=_needed(regret, competence) if decision is Decision.INCONCLUSIVE else None,
        error=error,
        regret=regret,
        rationalised=rationalised(regrets, profile.margin.regret, error, shared),
        alpha_hat=None
        if guard.holds_origin
        else estimate_angle(totals[0], totals[1], seed, profile.confidence, resamples),
        identifiability=guard,
        calibration=calibrate(
            evidence,
            profile.angle,
            profile.margin.degrees,
            not guard.holds_origin,
            seed,
            error,
            resamples,
        ),
        competence=competence,
    )


def _joined(regret: Decision, competence: Decision) -> Decision:
    if Decision.FAIL in (regret, competence):
        return Decision.FAIL
    passed = regret is Decision.PASS and competence is Decision.PASS
    return Decision.PASS if passed else Decision.INCONCLUSIVE


def _needed(regret: RegretTest, competence: tuple[FloorTest, ...]) -> int | None:
    """What the slowest open test needs, or None if that is more than any number."""
    needs = [one.needed for one in (regret, *competence) if one.decision is Decision.INCONCLUSIVE]
    known = [one for one in needs if one is not None]
    return max(known) if len(known) == len(needs) else None
