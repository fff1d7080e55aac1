"""A report against the audit log that someone else holds."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from socialiq.audit.looks.log import RESULT, SEED, AuditLog, Subject, read
from socialiq.audit.looks.look import Look, origin_of
from socialiq.audit.report.folder import REPORT
from socialiq.audit.report.seeds import opened_of
from socialiq.audit.report.verify import read_report


def faults_by_log(folder: Path, path: Path) -> list[str]:
    """Return how a report differs from a log, nothing if it is the look that it claims to be.

    The log may have grown since. Every commitment before the report's counts as a look, so a report
    that hides one has another number than the log.

    Args:
        folder: Folder of the report, without faults of its own.
        path: File of the log.

    Raises:
        UserError: If the log can't be read, or its chain is broken.
    """
    report = read_report(folder / REPORT)
    _, look = opened_of(report)
    if look is None:
        return [f"{REPORT} names no audit log"]
    declared = report["declaration"]
    subject = Subject(declared["owner"], declared["scenario"]["sha256"])
    log = AuditLog(path, subject.sha256, read(path, subject.sha256))
    number = log.look_of(look.entry)
    if number == 0:
        return [f"{path} has no look {look.number} of {REPORT}: one of them was written again"]
    found = []
    if number != look.number:
        found.append(f"{REPORT} is look {number} by {path}, and claims to be look {look.number}")
    found += _of_entry(report, look, log)
    result = log.following(RESULT, look.entry)
    sha256 = hashlib.sha256((folder / REPORT).read_bytes()).hexdigest()
    if result is None or result["report_sha256"] != sha256:
        found.append(f"{path} has another result for look {number}, or none")
    return found


def _of_entry(report: Mapping[str, Any], look: Look, log: AuditLog) -> list[str]:
    """Compare the lines of commitment and seed."""
    entry = next(one for one in log.entries if one["sha256"] == look.entry)
    seed = log.following(SEED, look.entry)
    claims = {
        "policy": (entry["policy_sha256"], report["hashes"]["policy"]),
        "declaration": (entry["profile_sha256"], report["hashes"]["profile"]),
        "number of episodes": (entry["episodes"], report["seeds"]["episodes"]),
        "selection of actions": (entry["soft"], not report["policy"]["deterministic"]),
        "time of the commitment": (entry["time"], look.committed),
        "line before it": (entry["previous"], look.before),
        "source of the seed": (entry["seed"], _origin(report)),
        "seed": (seed and seed["seed"], report["seeds"]["seed"]),
    }
    return [
        f"{REPORT}: its {what} is not that of {log.path}"
        for what, (logged, told) in claims.items()
        if logged != told
    ]


def _origin(report: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the origin of the seed as the commitment names it."""
    drawn = opened_of(report).drawn
    return {"source": drawn.source} if drawn.revealed is None else origin_of(drawn.revealed)
