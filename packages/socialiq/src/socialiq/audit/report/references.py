"""Check what a report says about its references: their list, records, optima and episodes.

None of it needs the policy. A reference that is missing, weakened or passed off as the policy
itself makes a bad policy look good, though every number follows from the table of episodes.
"""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from socialiq.audit import request
from socialiq.audit.evidence import drive
from socialiq.audit.evidence.collect import drive_references, strata_of
from socialiq.audit.evidence.consistency import ALLOWED
from socialiq.audit.evidence.outcomes import AS_DECLARED, Evidence, Outcomes, Reference
from socialiq.audit.report.content import Audited
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.policies import drivers
from socialiq.types import Files, Json
from socialiq.worlds.catalogue import KNOWN, base
from socialiq.worlds.world import World

SAMPLE = 100
"""Episodes of each table that are driven again by default, drawn again at each check, besides those
in which a reference differs most from the policy. A change of one episode in twenty is missed once
in 170 checks."""

_ROUNDING = 1e-9  # relative, of recomputed rewards


@dataclass(frozen=True)
class Findings:
    """Result of the checks that need neither the policy nor a key.

    There are no faults if the files are consistent with each other. What this version can't check,
    or what another processor may explain, may say anything. `files` are the bytes that were
    checked: who reads the folder again may read others.
    """

    faults: list[str] = field(default_factory=list)
    not_checked: list[str] = field(default_factory=list)
    checked: list[str] = field(default_factory=list)
    believed: list[str] = field(default_factory=list)
    files: Files = field(default_factory=dict)  # content of the folder's files by path


def check_references(
    audited: Audited, package: str, specs: Sequence[str] = (), all_episodes: bool = False
) -> Findings:
    """Drive the references again, by the audit's seeds, and compare them with a report's data.

    Args:
        audited: Data of the report: `recompute.audited_of`.
        package: Hash of the package that wrote the report; the hash of a rule covers it.
        specs: The user's references, which a report does not hold; else they are left to believe.
        all_episodes: Whether all episodes are driven again, not a sample.
    """
    profile = audited.profile
    results = Findings()
    try:
        world = profile.world()
    except UserError:
        if base(profile.scenario.world) in KNOWN:
            raise
        results.believed.append(f"{_POLICY}; all reference drivers of {profile.scenario.world}")
        return results
    with contextlib.ExitStack() as closing:
        policy = _shipped_policy(audited, world, package, results)
        angles = request.dial_angles(profile.angle, profile.margin.width)
        for number, evidence in enumerate(audited.evidence):
            there = audited.traffic[number - 1].world if number else world
            count = evidence.episodes
            rows = np.arange(evidence.episodes)
            if not all_episodes and count > SAMPLE:
                ours = evidence.policy.values(profile.angle)
                gains = [row.values(profile.angle) - ours for row in evidence.drivers[1:]]
                ends = [row for gain in gains for row in (gain.argmin(), gain.argmax())]
                rng = np.random.default_rng(secrets.randbits(128))
                rows = np.unique([*rng.choice(count, SAMPLE, replace=False).tolist(), *ends])
            rule = profile.rule
            is_exact = there.is_exact
            dial = request.reference_dial(specs) if rule and specs and not is_exact else None
            by_rule = drive.ByRule(rule, dial) if rule else None
            side = min(drive.SIDE_BY_SIDE, count)  # as in the audit
            course = drive.Course(there, evidence.seeds[rows], side, 1, by_rule, profile.effects)
            loaded_references = request.resolve_references(
                there, specs, audited.policy, _TRUST, closing, angles
            )
            driven = [
                *drive_references(course, loaded_references.drivers),
                *drive.trivial_drivers(course),
            ]
            _check_list(audited, evidence, driven, loaded_references.records, package, results)
            driven += [] if policy is None else [course.drive(policy, audited.deterministic)]
            _compare(evidence, rows, driven, strata_of(course), loaded_references.records, results)
            if len(rows) < count and not number:
                remaining = f"{count - len(rows)} of {count} episodes"
                results.believed.append(f"{remaining} of the references (--all-episodes)")
    return results


_POLICY = "the episodes and answers of the policy (--rerun)"
_TRUST = request.Trust()


def _check_list(
    audited: Audited,
    evidence: Evidence,
    driven: Sequence[Outcomes],
    records: Json,
    package: str,
    results: Findings,
) -> None:
    """Compare the references' names and records with those that the declaration's world has."""
    names = {driver.name: driver for driver in evidence.references}
    ours = names.keys() & {driver.name for driver in driven}
    for name in sorted(ours):
        if not _agree(audited.records.get(name), records.get(name), package):
            results.faults.append(f"the record of {name} is not that of this reference")
    users = sorted(names.keys() - ours - ({AS_DECLARED} if audited.profile.rule else set()))
    listed = [row.name for row in driven if row.name in ours - {AS_DECLARED}]
    if [*names][: len(listed)] != listed:  # the first of an angle is compared
        results.faults.append("the references are in another order")
    stems = [
        spec.rpartition(":")[2] if request.is_code(spec) else one_line(Path(spec).stem)
        for spec in audited.reference_files
    ]
    for name in users:
        is_named = name in stems or name.rpartition(" at ")[0] in stems
        if not is_named or names[name].expected is not None:
            results.faults.append(f"no one named the reference {name}")
    for name in ours.union(users).intersection(audited.left_out):
        if audited.deterministic and not names[name].drove_as(evidence.policy):
            results.faults.append(f"{name} is left out as the policy itself, and drove otherwise")
    line = f"the user's references {', '.join(users)} (--reference)"
    if users and line not in results.believed:
        results.believed.append(line)


def _agree(written: Json | None, fresh: Json | None, package: str) -> bool:
    """Whether two records as JSON describe one driver; a rule's hash covers the package's."""
    if written is None or fresh is None:
        return written is fresh
    if fresh["kind"] == drivers.RULE:
        fresh = {**fresh, "sha256": drivers.rule_sha256(fresh["source"], package)}
    return all(written[name] == fresh[name] for name in ("kind", "source", "sha256"))


def _shipped_policy(
    audited: Audited, world: World, package: str, results: Findings
) -> Reference | None:
    """Return the policy if it is one of the package's, whose episodes can be driven again too."""
    record = audited.policy
    source = audited.policy["source"]
    rule = record["kind"] == drivers.RULE
    shipped = source.startswith(drivers.ATLAS) or source.partition("@")[0] == drivers.DRIVER
    if audited.profile.rule or not (rule or shipped):
        results.believed.append(_POLICY)
        return None
    try:
        if rule and source not in world.drivers:
            raise UserError("no such rule")
        loaded = request.resolve_policy(source, world, audited.profile.angle, _TRUST)
    except UserError:
        loaded = None
    if loaded is None or not _agree(record, loaded.record.as_json(), package):
        results.faults.append(f"the record of the policy is not that of {one_line(source)}")
        return None
    name = audited.evidence[0].policy.name
    return Reference(name, loaded.policy, schema=loaded.record.interface.schema)


def _compare(
    evidence: Evidence,
    rows: np.ndarray,
    driven: Sequence[Outcomes],
    strata: Mapping[str, np.ndarray],
    records: Json,
    results: Findings,
) -> None:
    """Compare rows of a table with the same episodes of the drivers, and of their kinds."""
    table = {driver.name: driver for driver in evidence.drivers}
    labels = {name: column[rows].tolist() for name, column in evidence.strata.items()}
    if labels != {name: column.tolist() for name, column in strata.items()}:
        results.faults.append("the kinds of episodes are not those of their seeds")
    for fresh in driven:
        written = table.get(fresh.name)
        if written is None:
            results.faults.append(f"the driver {fresh.name} is missing")
            continue
        pairs = ((written.angles, fresh.angles), (written.expected or (), fresh.expected or ()))
        if any(len(a) != len(b) or not np.allclose(a, b, _ROUNDING) for a, b in pairs):
            results.faults.append(f"the exact numbers of {fresh.name} are others")
        same = np.isclose(written.totals[rows], fresh.totals, _ROUNDING, _ROUNDING).all(axis=1)
        earlier = written.episodes.rows(rows)
        for name in ("ending", "length"):
            same &= earlier[name] == fresh.episodes[name]
        same &= (earlier.contact == fresh.episodes.contact) | ~fresh.episodes.collision
        for name in fresh.measured:
            same &= np.isclose(earlier[name], fresh.episodes[name], _ROUNDING, _ROUNDING)
        count = int((~same).sum())
        record = records.get(fresh.name)
        network = record is not None and record["kind"] != drivers.RULE
        # Another processor changes last digits of a network, and so about one action in a million.
        few = network and count <= max(1, int(ALLOWED * len(rows)))
        if count:
            text = f"{fresh.name} drives {count} of {len(rows)} episodes otherwise than written"
            (results.not_checked if few else results.faults).append(text)
