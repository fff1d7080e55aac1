"""Content of `report.json`, the source of truth: every view is made from it alone."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import NamedTuple, get_args

from socialiq.audit.evidence.consistency import Consistency
from socialiq.audit.evidence.drive import CANDIDATES
from socialiq.audit.evidence.outcomes import Evidence, Outcomes, events_of
from socialiq.audit.evidence.replay import Chosen, Traces, path_of
from socialiq.audit.look import Look
from socialiq.audit.profile.fields import QUANTITIES
from socialiq.audit.profile.profile import Profile, Traffic, is_recorded
from socialiq.audit.profile.template import possible_loss
from socialiq.audit.report import words
from socialiq.audit.seeds import CHAIN, Draw, Nonce, Round
from socialiq.audit.verdict import results as judged
from socialiq.audit.verdict.bounds import faults_of_limits
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.direction import faults_of_contexts
from socialiq.audit.verdict.verdict import Verdict, conclude, dependence, judge
from socialiq.provenance import machine, package_sha256, versions
from socialiq.to_json import to_json
from socialiq.types import Files, Json, Row
from socialiq.worlds.catalogue import GRIDS, KNOWN, base, in_sumo

FORMAT = 3

_ORDER = (
    "Policy and declaration were read and hashed first. Only then was the seed drawn or "
    "accepted. Seeds of episodes come from the seed and both hashes together."
)

EXIT_CODES = {Decision.PASS: 0, Decision.FAIL: 1, Decision.INCONCLUSIVE: 3}
_OF_VERDICT = ("decision", "reason", "episodes", "needed", "error")
_TESTS = (
    *("regret", "direction", "character", "rationalised", "alpha_hat", "identifiability"),
    "competence",
)

CLOUD = 300  # episodes drawn as points; episodes.csv has all of them


@dataclass(frozen=True)
class Audited:
    """Data and results of an audit."""

    profile: Profile
    policy: Json  # the policy's record as JSON: kind, source, sha256, covers and more
    deterministic: bool  # whether it took its best actions
    drawn: Draw  # commitment and seed
    look: Look | None  # None without a log
    records: Mapping[str, Json | None]  # of loaded references
    reference_files: Sequence[str]  # the user's references, as given with `--reference`
    left_out: Sequence[str]  # names of references that are the policy itself
    consistency: Consistency | None  # None if the policy was not asked again
    evidence: Sequence[Evidence]  # of all references, then the same in each other traffic
    traffic: Sequence[Traffic]
    episodes: Chosen  # result of `replay.selected`
    films: Files  # films by path in the folder: `replay.path_of`
    traces: Traces
    command: str  # which repeats the audit
    started: datetime.datetime

    def references(self, left_out: bool) -> list[Row]:
        """Return the rows of the references that are the policy itself, or of those that are not.

        Args:
            left_out: Whether to return those that are the policy itself, which are left out of the
                test.
        """
        return [
            driver_row(reference, self.profile.angle) | {"record": self.records.get(reference.name)}
            for reference in self.evidence[0].references
            if (reference.name in self.left_out) == left_out
        ]


class Results(NamedTuple):
    """All results of an audit; the verdict as far as no finding forbids it."""

    verdict: Verdict
    discrimination: judged.Discrimination
    strata: tuple[judged.Stratum, ...]
    shifts: tuple[judged.Shift, ...] = ()  # none without other traffic


def results_of(audited: Audited) -> Results:
    """Judge a policy by its evidence.

    The regret towards references that are the policy itself is 0; estimating it would only widen
    the bounds.

    Raises:
        UserError: If the evidence belongs to another scenario.
    """
    profile = audited.profile
    look = audited.look
    seed = audited.drawn.derived("resampling")
    error = None if look is None else look.error
    compared, *there = [drives.without(audited.left_out) for drives in audited.evidence]
    line = {"error": error, "directed": audited.evidence[0]}
    discrimination = judged.discriminate(profile, compared, seed, **line)
    verdict = judge(profile, compared, seed, **line)
    findings = [dependence(audited.consistency, not audited.deterministic)]
    if audited.consistency is not None:  # other policies run in this package's code
        findings.append(judged.order_dependence(audited.evidence[0]))
    best = next(row for row in compared.references if row.name == verdict.regret.best)
    findings += faults_of_limits(profile, compared.policy, best)
    findings += faults_of_contexts(profile, compared.policy.contexts, CANDIDATES, verdict.error)
    if discrimination.excludes_nothing:
        findings.append(
            "The declaration excludes nothing: constant actions and random ones would pass it too. "
            "Declare a smaller margin, or a stricter floor."
        )
    verdict = conclude(verdict, [text for text in findings if text])
    strata = judged.stratified(compared, profile.angle, verdict.regret.best, profile.confidence)
    if not audited.traffic:
        return Results(verdict, discrimination, strata)
    shifts = judged.shift_of(profile, compared, audited.traffic, there, seed)
    return Results(verdict, discrimination, strata, shifts)


def content(audited: Audited) -> Json:
    """Judge, and return the report as one JSON object, which `report.schema.json` describes."""
    profile = audited.profile
    look = audited.look
    angle = audited.profile.angle
    results = results_of(audited)
    evidence = audited.evidence[0]
    verdict = results.verdict
    episodes = {
        kind: [
            {**row, "film": path if (path := path_of(kind, number)) in audited.films else None}
            | {"trace": trace}
            for number, (row, trace) in enumerate(zip_longest(rows, audited.traces[kind]), 1)
            if row is not None
        ]
        for kind, rows in audited.episodes.items()
    }
    tests = _TESTS if verdict.contexts is None else (*_TESTS, "contexts")
    return to_json(
        {
            "format": FORMAT,
            "verdict": {name: getattr(verdict, name) for name in _OF_VERDICT}
            | {"exit_code": EXIT_CODES[verdict.decision]},
            "caveats": [caveat._asdict() for caveat in _caveats(audited, results)],
            "declaration": _declaration(profile),
            "policy": {
                "record": dict(audited.policy),
                "deterministic": audited.deterministic,
                "means": driver_row(evidence.policy, angle),
            },
            "tests": {name: getattr(verdict, name) for name in tests},
            "discrimination": results.discrimination,
            "consistency": audited.consistency,
            "references": audited.references(left_out=False),
            "trivial": [driver_row(driver, angle) for driver in evidence.trivial],
            "reference_files": list(audited.reference_files),
            "left_out": audited.references(left_out=True),
            "strata": results.strata,
            "shift": _shift(results, audited.evidence[1:]),
            "episodes": episodes,
            "cloud": evidence.policy.totals[:CLOUD].round(6),
            "limits": limits(profile.scenario.world, bool(profile.caused)),
            "scenario": evidence.scenario,
            "seeds": seeds_of(audited.drawn, evidence.episodes),
            "look": look,
            "hashes": {
                "policy": audited.drawn.commitment.policy_sha256,
                "profile": audited.drawn.commitment.profile_sha256,
                "reward": profile.reward.sha256,
                "scenario": profile.scenario.sha256,
                "package": package_sha256(),
            },
            "versions": versions(),
            "machine": machine(),
            "timing": {"started": audited.started.isoformat(timespec="seconds"), "seconds": 0.0},
            "command": audited.command,
            "claims_of_auditor": words.claims_of_auditor(audited.policy, audited.drawn, look),
        }
    )


def _caveats(audited: Audited, results: Results) -> list[words.Caveat]:
    profile = audited.profile
    regret = results.verdict.regret
    world = profile.scenario.world
    # Making an environment may run code; its limits are not known anyway.
    limited = base(world) in KNOWN and not profile.losses_decide
    possible = possible_loss(profile.world(), profile.angle) if limited else None
    traces = [trace for rows in audited.traces.values() for trace in rows]
    # In an environment nothing is run again; a policy that draws its actions may draw others.
    repeated = traces if base(world) in KNOWN and audited.deterministic else []
    equal = sum(trace is not None for trace in repeated)
    driven = audited.evidence[0].policy
    known = audited.evidence[0].drivers[1:]
    rows = [row for row in known if row.name not in audited.left_out]
    equals = [words.plain_name(row.name, row.angles) for row in rows if driven.drove_as(row)]
    caveats = [
        *words.caveats_of_declaration(profile, results.verdict, results.discrimination),
        *(
            []
            if profile.clip and not profile.losses_decide
            else words.caveats_of_loss(regret, possible)
        ),
        *words.caveats_of_clip(profile, audited.evidence[0]),
        *words.caveats(audited.drawn, audited.look, audited.policy, world),
        *words.caveats_of_episodes(equal, len(repeated), equals),
    ]
    return sorted(caveats, key=lambda caveat: get_args(words.About).index(caveat.about))


def _shift(results: Results, elsewhere: Sequence[Evidence]) -> Json | None:
    if not results.shifts:
        return None
    fields = ("name", "angles", "expected")  # of references, which the table of episodes lacks
    return {
        "sentence": judged.sentence_of(results.shifts),
        "otherwise": any(shift.significant for shift in results.shifts),
        "traffic": [
            vars(shift)
            | {
                "references": [
                    {name: getattr(driver, name) for name in fields}
                    for driver in evidence.references
                ]
            }
            for shift, evidence in zip(results.shifts, elsewhere, strict=True)
        ],
    }


def _declaration(profile: Profile) -> Json:
    """Return the declaration; there are no fields of a rule or of bounds that it lacks."""
    declared = {**vars(profile), "sha256": profile.sha256}
    rule = profile.rule
    del declared["rule"], declared["source"]
    if not profile.caused:
        del declared["caused"]
    if rule is not None:
        declared["angle_rule"] = {"words": rule.words, "content": rule.as_json()}
    return declared


def seeds_of(draw: Draw, episodes: int) -> Json:
    """Return the section `seeds` of the report.

    Args:
        draw: Commitment and seed.
        episodes: Number of episodes of every driver.
    """
    revealed = draw.revealed
    beacon = None
    if isinstance(revealed, Round):
        beacon = {
            "chain_sha256": CHAIN,
            "round": revealed.number,
            "time": revealed.time.isoformat(),
            "signature": revealed.signature,
            "randomness": revealed.randomness,
        }
    return {
        "seed": draw.seed,
        "source": draw.source,
        "worth": words.worth(draw),
        "nonce": {"value": revealed.value} if isinstance(revealed, Nonce) else None,
        "beacon": beacon,
        "episodes": episodes,
        "commitment_sha256": draw.commitment.sha256,
        "order": _ORDER,
    }


def driver_row(driver: Outcomes, angle: float) -> Row:
    """Return one driver's means.

    Args:
        driver: Episodes of the driver.
        angle: Declared angle in degrees, for `value`, the mean R(α).

    Returns:
        Name, angles, mean rewards and shares of events; `caused` if effects were measured.
    """
    caused = {name: driver.episodes[name].mean() for name in QUANTITIES if name in driver.measured}
    return {
        "name": driver.name,
        "angles": driver.angles,
        "r_env": driver.mean.env,
        "r_social": driver.mean.social,
        "value": float(driver.values(angle).mean()),
        "expected": driver.expected,
        **{name: float(happened.mean()) for name, happened in events_of(driver).items()},
        "decisions": float(driver.episodes.length.mean()),
        **({"caused": caused} if caused else {}),
    }


def limits(world: str, effects: bool = False) -> list[str]:
    """Return the limits of an audit in a world, as sentences.

    Args:
        world: Name of the world.
        effects: Whether bounds of effects are declared.
    """
    texts = words.stated()["limits"]
    applying = [*texts["exact" if base(world) in GRIDS else "sampled"], *texts["always"]]
    if effects and base(world) not in GRIDS:
        applying += texts["simulated" if in_sumo(world) else "effects"]
    if is_recorded(world):
        return [*texts["recorded"], *applying]
    return applying if base(world) in KNOWN else [*texts["unknown"], *applying]
