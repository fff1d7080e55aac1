"""The joint verdict: all tests on the same evidence, one decision, one sentence.

A margin can be so wide, and a floor so open, that no driver breaks the declaration. A pass is then
no evidence of the policy's behaviour (`results.discriminate`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from socialiq.audit.evidence.consistency import Consistency
from socialiq.audit.evidence.drive import CANDIDATES
from socialiq.audit.evidence.outcomes import CRITERIA, Evidence, Outcomes
from socialiq.audit.profile.profile import Bound, Profile
from socialiq.audit.verdict.bounds import BoundTest, bound_tests
from socialiq.audit.verdict.decision import Decision, joint_decision, slowest
from socialiq.audit.verdict.direction import (
    CharacterTest,
    DirectionTest,
    FollowedAngle,
    character_test,
    direction_test,
    followed_angles,
)
from socialiq.audit.verdict.regret import (
    CompatibleAngles,
    Regrets,
    RegretTest,
    compatible_angles,
    regret_test,
)
from socialiq.errors import UserError
from socialiq.reading import sha256_of
from socialiq.social.angle import AngleEstimate, estimate_angle
from socialiq.statistics.hotelling import Ellipse, confidence_ellipse

Test = RegretTest | DirectionTest | CharacterTest | BoundTest
"""A test: its decision, the episodes that would decide it, and a clause of the reason."""


@dataclass(frozen=True, kw_only=True)
class Decisive:
    """Deciding tests of an audit, and their joint decision.

    `needed` is the number of episodes that would decide an inconclusive audit; None if it is
    decided, or if an estimate is on its limit, where no number is enough.
    """

    decision: Decision
    needed: int | None
    regret: RegretTest  # the primary test
    competence: tuple[BoundTest, ...]  # of the safety floor, then of what the policy causes
    direction: DirectionTest | None = None  # None for a rule whose angles no width holds
    character: CharacterTest | None = None  # None if no share is declared

    @property
    def tests(self) -> list[Test]:
        """The tests that decide."""
        tests = (self.regret, self.direction, self.character, *self.competence)
        return [test for test in tests if test is not None and test.decision is not None]


@dataclass(frozen=True, kw_only=True)
class Verdict(Decisive):
    """Result of an audit: PASS if all deciding tests pass, FAIL if one of them fails."""

    reason: str  # one plain sentence
    episodes: int
    error: float  # largest chance of a wrong pass, and of a wrong fail, at this look
    rationalised: CompatibleAngles  # angles compatible with the behaviour
    alpha_hat: AngleEstimate | None  # α̂ of the thesis, if it is identified
    identifiability: Ellipse  # confidence ellipse of the mean rewards
    contexts: tuple[FollowedAngle, ...] | None  # None without a declared rule


def decide(
    profile: Profile,
    evidence: Evidence,
    seed: int,
    resamples: int,
    error: float,
    regrets: Regrets | None = None,
    directed: Evidence | None = None,
    ends_only: bool = True,
) -> Decisive:
    """Test a driver's regret at the declared angle, or its loss at a rule, direction and floor.

    A pass needs every test to pass, each at the full error: if any of them is truly broken, the
    chance that its test passes bounds the chance of a wrong pass, whatever the results of the
    remaining tests (intersection-union, Berger 1982). A fail needs only one, so the error is
    divided: half to the bounds of the floor and of effects, in equal parts, and half to regret, of
    which a declared width takes a half: an eighth for the direction, another for the single
    character.

    So a wrong pass and a wrong fail each have a chance of at most the error, as far as the bounds
    keep their levels: those of shares and of the direction do, and those of regret with a largest
    loss. Without one they are by bootstrap-t, which is approximate (the study `audit-power`
    measures how much).

    Args:
        profile: The declaration.
        evidence: Evidence in which the driver is the policy.
        seed: Seed of the resampling.
        resamples: Number of resamples.
        error: Largest chance of a wrong pass, and of a wrong fail.
        regrets: Regrets of the clipped evidence, if they are known already.
        directed: Evidence with the reference drivers of all angles; by default `evidence` has them.
        ends_only: Whether the direction is tested at the two ends of the width only.
    """
    margin = profile.margin
    angle = profile.angle
    evidence = evidence.clipped(profile.clip)
    beside = direction_tests(profile, directed or evidence, error, ends_only)
    if profile.losses_decide:
        evidence = evidence.by_rule()
        regrets = None
        angle = 0.0
    regrets = regrets or Regrets(evidence, seed, resamples, profile.largest_loss)
    share = error / 2 if margin.width is None else error / 4
    regret = regret_test(regrets, angle, margin.regret, error, share)
    regret = replace(regret, angle=profile.angle)
    return join_tests(regret, evidence.policy, profile.bounds, error, *beside)


def direction_tests(
    profile: Profile, evidence: Evidence, error: float, ends_only: bool = True
) -> tuple[DirectionTest | None, CharacterTest | None]:
    """Test direction and character, each at its share of the error (`decide`).

    Args:
        profile: The declaration.
        evidence: Evidence with the reference drivers of all angles, not clipped.
        error: Error of the whole audit.
        ends_only: Whether the direction is tested at the two ends of the width only.

    Returns:
        Both tests. Both are None for a rule whose angles no width holds; the second is None if no
        share is declared.
    """
    if profile.losses_decide:
        return None, None
    driven = evidence.clipped(profile.clip)
    errors = error, error / 8
    direction = direction_test(profile, driven, *errors, ends_only)
    return direction, character_test(profile, driven, *errors)


def join_tests(
    regret: RegretTest,
    policy: Outcomes,
    limits: Sequence[Bound],
    error: float,
    direction: DirectionTest | None = None,
    character: CharacterTest | None = None,
) -> Decisive:
    """Join the tests of a driver's rewards with the tests of its bounds.

    Args:
        regret: Test of regret, at its share of the error.
        policy: Episodes of the driver.
        limits: Bounds of the floor and of effects.
        error: Error of the whole audit.
        direction: Test of the direction, at its share of the error; None if there is none.
        character: Test of the character, at its share of the error; None if there is none.
    """
    tested = Decisive(
        decision=Decision.INCONCLUSIVE,
        needed=None,
        regret=regret,
        competence=bound_tests(policy, limits, error, error / 2),
        direction=direction,
        character=character,
    )
    decision = joint_decision(test.decision for test in tested.tests)
    needs = [test.needed for test in tested.tests if test.decision is Decision.INCONCLUSIVE]
    needed = slowest(needs) if decision is Decision.INCONCLUSIVE else None
    return replace(tested, decision=decision, needed=needed)


_BEYOND = 20
"""Resamples beyond the quantile of a pass, at least; with one the quantile would be a guess."""


def enough_resamples(error: float, least: int = 2000) -> int:
    """Return a number of resamples that gives the quantiles of an error.

    Args:
        error: Smallest error of a bound by resampling.
        least: Number that is enough for usual errors.
    """
    return max(least, math.ceil(_BEYOND / error))


def judge(
    profile: Profile,
    evidence: Evidence,
    seed: int,
    resamples: int = 2000,
    directed: Evidence | None = None,
    error: float | None = None,
) -> Verdict:
    """Test a policy's evidence against its declaration.

    A wrong pass and a wrong fail each have a chance of at most the error (`decide`). α̂ does not
    decide, so it takes no share of the error.

    Args:
        profile: The declaration.
        evidence: Result of `collect_evidence`, in the profile's world.
        seed: Seed of the resampling.
        resamples: Smallest number of resamples; a small error takes more.
        directed: Evidence with the reference drivers of all angles, if they are others: a driver
            equal to the policy is no reference of regret, but one of the direction.
        error: Error of this look (`look.spend`); None for the whole error, 1 - confidence.

    Raises:
        UserError: If the evidence belongs to another scenario.
    """
    if sha256_of(evidence.scenario) != profile.scenario.sha256:
        raise UserError("the evidence is of another scenario than the profile: collect it again")
    error = profile.error if error is None else error
    resamples = enough_resamples(error, resamples)
    regrets = Regrets(evidence.clipped(profile.clip), seed, resamples, profile.largest_loss)
    decisive = decide(profile, evidence, seed, resamples, error, regrets, directed, False)
    ellipse = confidence_ellipse(evidence.policy.totals, profile.confidence)
    identified = not ellipse.holds_origin
    estimate = None
    if identified:
        env, social = evidence.policy.totals.T.copy()
        estimate = estimate_angle(env, social, seed, profile.confidence, resamples)
    rule = profile.rule
    losses = evidence.policy.contexts
    contexts = None
    if rule is not None and losses is not None:
        contexts = followed_angles(rule, losses, CANDIDATES, profile.confidence)
    return Verdict(
        **vars(decisive),
        reason=_reason(decisive, profile),
        episodes=evidence.episodes,
        error=error,
        rationalised=compatible_angles(regrets, profile.margin.regret),
        alpha_hat=estimate,
        identifiability=ellipse,
        contexts=contexts,
    )


def conclude(verdict: Verdict, findings: Sequence[str]) -> Verdict:
    """Return the verdict of an audit: INCONCLUSIVE where a finding forbids a pass.

    A fail stays a fail, since no finding makes a policy better. The tests are unchanged, and more
    episodes would not decide.

    Args:
        verdict: Result of `judge`.
        findings: Sentences, each a reason against a pass.
    """
    if verdict.decision is Decision.FAIL or not findings:
        return verdict
    reason = " ".join(findings)
    return replace(verdict, decision=Decision.INCONCLUSIVE, reason=reason, needed=None)


def dependence(consistency: Consistency | None, soft: bool) -> str:
    """Return a sentence on what a policy's answers depend other than the observation.

    How it drove in the episodes is then no evidence about how it drives elsewhere.

    Args:
        consistency: Answers of the policy that were asked again; None if it was not asked.
        soft: Whether the policy draws its actions.

    Returns:
        The sentence; "" if no dependence was found.
    """
    dependences = consistency.dependences(soft) if consistency is not None else []
    if consistency is None or not dependences:
        return ""
    differing, queries = (
        sum(getattr(answers, name) for answers in consistency) for name in ("differing", "queries")
    )
    return (
        f"The policy's answers depend on {' and on '.join(dependences)}: "
        f"{differing:,} of {queries:,} repeated queries got another answer, so its episodes don't "
        "show how it drives elsewhere."
    )


UNDIRECTED = (
    "Direction and character are not tested, because no declared width holds all angles of the "
    "rule."
)
"""Sentence of a pass by a rule: its limit."""

BY_WHOM = (
    "It is not tested whether it drives by one angle towards all road users: a rule that declares "
    "the angle of each situation tests that."
)
"""Sentence of a pass without a rule: its limit."""


def _reason(decisive: Decisive, profile: Profile) -> str:
    """Return the reason why a policy passed, failed, or neither, in one sentence."""
    regret = decisive.regret
    direction = decisive.direction
    world = profile.scenario.world
    where = (
        "by the declared rule"
        if profile.losses_decide
        else f"at the declared {regret.angle:g} degrees"
    )
    tests = [test for test in decisive.tests if test.decision is decisive.decision]
    clauses = [test.clause(where, world) for test in tests]
    if decisive.decision is Decision.FAIL:
        return f"The policy does not behave as declared: {', and '.join(clauses)}."
    if decisive.decision is Decision.INCONCLUSIVE:
        if direction in tests and direction.lacking:
            return f"The direction can't be tested: there is {direction.lacking}."
        return (
            f"{regret.episodes} episodes are too few to decide whether the policy "
            f"{' and whether it '.join(clauses)}."
        )
    less = f"at most {regret.high:.3g} less reward" if regret.high > 0.0 else "no less reward"
    text = (
        f"{where} the policy earns {less} per episode than the best reference "
        f"driver ({regret.margin:.3g} less is allowed), "
        f"{'its direction is within the declared width, ' if direction in tests else ''}"
        "and it keeps the declared safety floor."
    )
    effects = decisive.competence[len(CRITERIA) :]
    effects_kept = [
        f"{test.bound_told(world)} (declared: {test.limit_told(world)})" for test in effects
    ]
    text += f" It {', '.join(effects_kept)}." if effects_kept else ""
    if profile.losses_decide:
        text += f" {UNDIRECTED}"
    elif direction in tests and profile.rule is None:
        text += f" {BY_WHOM}"
    if regret.bound == "bootstrap":
        return f"If no loss is too rare to show in {regret.episodes} episodes, {text}"
    return text[0].upper() + text[1:]
