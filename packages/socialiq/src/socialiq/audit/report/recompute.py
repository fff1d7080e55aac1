"""Recompute a report from its table of episodes: the policy is not needed.

Everything in a report but the claims of its auditor follows from the declaration, the record of
the policy, the seed and the episodes. So a verdict, a bound or a table that was changed is found
without a rerun. Episodes that were made up consistently are not: they need one.
"""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import json
import math
import re
from collections.abc import Iterator, Sequence, Set
from typing import Any

import numpy as np

from socialiq.audit.evidence.consistency import Consistency
from socialiq.audit.evidence.drive import CANDIDATES
from socialiq.audit.evidence.outcomes import LOSS, Evidence
from socialiq.audit.evidence.replay import selected
from socialiq.audit.evidence.table import CONTEXTS, ReferenceAttributes, read_contexts, read_table
from socialiq.audit.look import Look, Opened, reveal, spend
from socialiq.audit.profile.profile import Profile, Traffic, other_traffic, whole_error
from socialiq.audit.profile.reader import parse
from socialiq.audit.report.content import Audited, content, seeds_of
from socialiq.audit.report.folder import PROFILE, REPORT, evidence_path
from socialiq.audit.report.words import ALWAYS, OF_CODE, references_of
from socialiq.audit.request import is_itself
from socialiq.audit.seeds import Commitment, Draw, Nonce, Round, episode_seeds
from socialiq.errors import UserError
from socialiq.reading import sha256_of
from socialiq.to_json import to_json
from socialiq.types import Files, Json, RewardPair

TOLERANCE = 1e-9
"""Largest relative difference of a recomputed number, for which see `differences_of`."""

_CLAIMED = frozenset(
    {"report.timing", "report.versions", "report.machine", "report.hashes.package"}
)


def opened_of(report: Json) -> Opened:
    """Return the seed and the look of a report."""
    seeds = report["seeds"]
    hashes = report["hashes"]
    revealed = None
    if seeds["nonce"] is not None:
        revealed = Nonce(seeds["nonce"]["value"])
    elif seeds["beacon"] is not None:
        revealed = Round(seeds["beacon"]["round"], seeds["beacon"]["signature"])
    commitment = Commitment(hashes["policy"], hashes["profile"])
    look = None if report["look"] is None else Look(**report["look"])
    return Opened(Draw(commitment, seeds["seed"], seeds["source"], revealed), look)


def faults_of_seeds(report: Json) -> list[str]:
    """Return the contradictions of a report about commitment, seed and look.

    Raises:
        UserError: If the seed is a beacon's, and the library that checks signatures is missing.
    """
    draw, look = opened_of(report)
    revealed = draw.revealed
    faults = []
    error = whole_error(report["declaration"]["confidence"])
    if look is not None and look.error != spend(error, look.number):
        faults.append(f"{REPORT}: the error of look {look.number} is not its share")
    if report["verdict"]["error"] != (error if look is None else look.error):
        faults.append(f"{REPORT}: the error of the verdict is not that of the look")
    if revealed is not None and look is None:
        faults.append(f"{REPORT}: a seed of the {draw.source} needs a log")
    elif revealed is not None and look is not None:
        if reveal(draw.commitment, look.entry, revealed) != draw:
            faults.append(f"{REPORT}: the seed does not follow from commitment and {draw.source}")
        if isinstance(revealed, Round):
            if not revealed.is_genuine():
                faults.append(f"{REPORT}: the beacon did not sign this round")
            try:
                before = datetime.datetime.fromisoformat(look.committed) < revealed.time
            except ValueError:  # the schema allows a 31 February
                before = False
            if not before:
                faults.append(f"{REPORT}: the round was published before the commitment")
    elif draw.source not in ("system entropy", "auditor's seed"):
        faults.append(f"{REPORT}: there is no {draw.source}")
    elif draw.source == "auditor's seed" and look is not None:
        faults.append(f"{REPORT}: a log takes no audit whose seed was known before")
    if not faults and to_json(seeds_of(draw, report["seeds"]["episodes"])) != report["seeds"]:
        faults.append(f"{REPORT}: its statements about the seed are not those of its source")
    return faults


def differences_of(audited: Audited, report: Json) -> list[str]:
    """Return the places where a report differs from what follows from its data (`audited_of`).

    Texts, decisions and counts must be equal. Other numbers may differ by `TOLERANCE`: another
    processor or version of a library adds in another order, which changes their last digits. The
    sum of a million numbers then differs by some 1e-13 of itself, and a report shows three digits.

    Args:
        audited: Result of `audited_of`.
        report: Content of `report.json`.

    Returns:
        Paths of the places, as in `differences`; none if the report follows from its data.
    """
    fresh = json.loads(json.dumps(content(audited)))
    return differences(report, fresh, _CLAIMED, TOLERANCE)


def audited_of(files: Files, report: Json) -> Audited:
    """Return the data of the audit that a report's files hold, by path; times are this process's.

    Raises:
        UserError: If its declaration can't be read, or its tables are not those of an audit.
    """
    profile = parse(files[PROFILE], PROFILE)
    record = report["policy"]["record"]
    draw, look = opened_of(report)
    commitment = Commitment(record["sha256"], profile.sha256)
    draw = dataclasses.replace(draw, commitment=commitment)
    shift = report["shift"]
    traffic = () if shift is None else other_traffic(profile, named_in(report) or ())
    if shift is not None and len(shift["traffic"]) != len(traffic):
        raise UserError(f"the other traffic in {REPORT} is not that of {PROFILE}")
    evidence = _evidence_of(files, report, profile, draw, traffic)
    rows = references_of(report)
    left_out = [row["name"] for row in rows if is_itself(row["name"], row["record"], record)]
    return Audited(
        profile=profile,
        policy=record,
        deterministic=report["policy"]["deterministic"],
        drawn=draw,
        look=look,
        records={row["name"]: row["record"] for row in rows},
        reference_files=report["reference_files"],
        left_out=left_out,
        evidence=evidence,
        traffic=traffic,
        consistency=Consistency.of(report["consistency"]),
        films=files,
        episodes=selected(evidence[0], profile.angle),
        # The ways of the vehicles are not in the tables; a rerun drives them again.
        traces={kind: [row["trace"] for row in rows] for kind, rows in report["episodes"].items()},
        command=report["command"],
        started=datetime.datetime.now(datetime.UTC),
    )


def named_in(report: Json) -> tuple[str, ...] | None:
    """Return the shifts that a report names, none for other traffic; None if it has neither."""
    rows = report["shift"]["traffic"] if report["shift"] else ()
    named = (row["options"]["shift"] for row in rows if "shift" in row["options"])
    return tuple(named) if report["shift"] else None


def _evidence_of(
    files: Files,
    report: Json,
    profile: Profile,
    draw: Draw,
    traffic: Sequence[Traffic],
) -> list[Evidence]:
    """Read the tables of episodes: the declared traffic first, then each other one."""
    scenario = report["scenario"]
    if sha256_of(scenario) != profile.scenario.sha256:
        raise UserError(f"the scenario in {REPORT} is not that of {PROFILE}")
    collected = [("episodes", scenario, references_of(report))]
    for number, variant in enumerate(traffic):
        rows = report["shift"]["traffic"][number]["references"]
        collected.append((f"shift {number}", variant.world.description, rows))
    names = [driver["name"] for driver in report["trivial"]]
    beside = [*([] if profile.rule is None else [LOSS]), *profile.effects]
    policy = report["policy"]["means"]["name"]
    episodes = report["seeds"]["episodes"]
    tables = []
    for number, (purpose, description, rows) in enumerate(collected):
        path = evidence_path(number)
        attributes = {}
        for row in rows:
            expected = row["expected"] and RewardPair(**row["expected"])
            attributes[row["name"]] = ReferenceAttributes(tuple(row["angles"]), expected)
        with _content(files, path) as data:
            table = read_table(data, description, policy, attributes, names, beside)
        if table.episodes != episodes:
            raise UserError(f"{path} has {table.episodes} episodes, not {episodes}")
        if table.seeds.tolist() != episode_seeds(draw.derived(purpose), episodes).tolist():
            raise UserError(f"the seeds in {path} are not those of the audit's seed and commitment")
        tables.append(table)
    if profile.rule is None:
        return tables
    # The policy's decision losses by context add up to those of its episodes.
    kinds = len(profile.rule.contexts)
    driven = tables[0].policy
    with _content(files, CONTEXTS) as data:
        contexts = read_contexts(data, episodes, kinds, CANDIDATES)
    if not np.array_equal(contexts.declared.sum(axis=1), driven.episodes[LOSS]):
        raise UserError(f"the losses in {CONTEXTS} don't add up to those of the episodes")
    driven = dataclasses.replace(driven, contexts=contexts)
    return [dataclasses.replace(tables[0], policy=driven), *tables[1:]]


@contextlib.contextmanager
def _content(files: Files, path: str) -> Iterator[bytes]:
    """Open the content of a file, whose path is in every `UserError` of the block."""
    if path not in files:
        raise UserError(f"{path} is missing")
    try:
        yield files[path]
    except UserError as error:
        raise UserError(f"{path}: {error}") from error


OF_A_RERUN = frozenset(f"report.{path}" for path in (*ALWAYS, *OF_CODE)) | {
    # These follow from others, of which a rerun compares the decision.
    "report.caveats",
    "report.consistency",
    "report.references[].record.isolation",
    "report.left_out[].record.isolation",
    "report.episodes.median[].film",
    "report.episodes.worst[].film",
}
"""Places that may differ in a rerun: claims of the auditor, isolation, films."""


def differences(
    old: Any, new: Any, ignored: Set[str] = OF_A_RERUN, relative: float = 0.0
) -> list[str]:
    """Return the places where two reports differ, those of the verdict and its tests first.

    Args:
        old: Content of one report.
        new: Content of another.
        ignored: Places that may differ, with [] for every row of a list.
        relative: Part of the larger number by which two numbers that are not both integers may
            differ, or of 1 if both are smaller. By default they agree to the last digit, as they do
            on the same machine with the same versions.

    Returns:
        Paths as "report.verdict.decision".
    """
    paths = _differences(old, new, ignored, relative, "report")
    return sorted(paths, key=lambda path: [not path.startswith(above) for above in _FIRST])


_FIRST = ("report.verdict", "report.tests.regret", "report.tests.competence", "report.tests")


def _differences(old: Any, new: Any, ignored: Set[str], relative: float, path: str) -> list[str]:
    """Return the places below one place, in the order of the fields' names."""
    if _ROW.sub("[]", path) in ignored:
        return []
    if isinstance(old, dict) and isinstance(new, dict):
        missing = object()
        pairs = [
            (old.get(name, missing), new.get(name, missing), f"{path}.{name}")
            for name in sorted(old.keys() | new.keys())
        ]
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = [(*pair, f"{path}[{row}]") for row, pair in enumerate(zip(old, new, strict=True))]
    else:
        numbers: Any = (old, new)
        if relative and {*map(type, numbers)} in ({float}, {float, int}):
            same = math.isclose(*numbers, rel_tol=relative, abs_tol=relative)
        else:
            texts = {json.dumps(value, sort_keys=True, default=str) for value in numbers}
            same = len(texts) == 1
        return [] if same else [path]
    return [
        difference
        for old_value, new_value, below in pairs
        for difference in _differences(old_value, new_value, ignored, relative, below)
    ]


_ROW = re.compile(r"\[\d+\]")
