"""Verify a report's folder: its hashes, what follows from its episodes, and its audit log."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from socialiq.audit.evidence.table import CONTEXTS
from socialiq.audit.log import RESULT, SEED, AuditLog, Subject, read
from socialiq.audit.look import of_revealed
from socialiq.audit.profile.reader import parse
from socialiq.audit.report import folder as layout
from socialiq.audit.report.folder import MANIFEST, PROFILE, REPORT, SEALS, SIGNATURES, STATEMENT
from socialiq.audit.report.recompute import audited_of, differences_of, faults_of_seeds, opened_of
from socialiq.audit.report.references import Findings, check_references
from socialiq.audit.report.words import references_of
from socialiq.audit.seeds import Commitment, Nonce
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.provenance import package_sha256
from socialiq.reading import open_file, sha256_of
from socialiq.types import Files, Json

LARGEST_REPORT = 16 * 1024 * 1024  # bytes; a report with its cloud has about 100,000


def read_report(path: Path) -> Json:
    """Read a `report.json`; `UserError` if it is missing or doesn't follow the schema."""
    if not path.is_file():
        raise UserError(f"no such file: {path}: name a folder that `socialiq audit` wrote")
    with open_file(path) as file:
        return _parsed(file.read(LARGEST_REPORT + 1), path)


def _parsed(content: bytes, path: Path) -> Json:
    """Parse the content of a `report.json` and check it; the path is for messages."""

    def refuse(word: str) -> None:
        raise ValueError(word)

    if len(content) > LARGEST_REPORT:
        raise UserError(f"{path} has more than {LARGEST_REPORT:,} bytes: it is not a report")
    try:
        report = json.loads(content, parse_constant=refuse)
        # Half of a surrogate pair is JSON, but no text: no page could be written with it.
        json.dumps(report, ensure_ascii=False).encode()
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} is not JSON: restore it, or audit again") from error
    schema = files("socialiq.audit.report").joinpath("report.schema.json").read_text()
    fault = fault_of(report, json.loads(schema))
    if fault:
        raise UserError(f"{path} is not a report of this version: {fault}; audit again")
    return report


def fault_of(value: Any, schema: Json) -> str:
    """Return the first violation of a JSON Schema with its place in the report.

    Args:
        value: Content of `report.json`.
        schema: The schema.

    Returns:
        One line; "" if the report follows the schema.
    """
    from jsonschema import Draft202012Validator, validators

    # JSON Schema takes 1.0 for an integer, but a count of episodes has to be one in Python too.
    types = Draft202012Validator.TYPE_CHECKER.redefine(
        "integer", lambda _, value: isinstance(value, int) and not isinstance(value, bool)
    )
    validator: Any = validators.extend(Draft202012Validator, type_checker=types)(schema)
    error = next(validator.iter_errors(value), None)
    while error is not None and error.context:  # of `anyOf`: why the first alternative fails
        error = error.context[0]
    if error is None:
        return ""
    path_in_report = "the report" + "".join(
        f"[{step}]" if isinstance(step, int) else f".{step}" for step in error.absolute_path
    )
    demand = error.validator_value
    value = error.instance
    words = {
        "additionalProperties": "has an unknown field",
        "type": f"is not of type {demand}",
        "enum": f"is not one of {demand}",
        "const": f"is not {demand}",
        "pattern": "has another form",
        "minimum": f"is less than {demand}",
        "maximum": f"is more than {demand}",
    }.get(error.validator, "has another length")
    if error.validator == "required":
        words = f"lacks {next(name for name in demand if name not in value)}"
    return one_line(f"{path_in_report} {words}")


MOST_FILES = 100
LARGEST_FOLDER = 4 * 1024**3  # bytes; a million episodes of 13 drivers in 3 traffics have half


def content_of(folder: Path) -> Files:
    """Return the content of every file below a folder, by path.

    Raises:
        UserError: If it is not a folder of an audit, or has links or too many or large files.
    """
    if not (folder / MANIFEST).is_file() or not (folder / REPORT).is_file():
        raise UserError(f"{folder} has no report: name a folder that `socialiq audit` wrote")
    contents: dict[str, bytes] = {}
    size = 0
    for path in sorted(folder.rglob("*")):
        if path.is_symlink():
            raise UserError(f"{path} is a link: a report's folder has plain files only")
        if path.is_dir():
            continue
        if not path.is_file():
            raise UserError(f"{path} is not a plain file: a report's folder has plain files only")
        size += path.stat().st_size
        if len(contents) >= MOST_FILES or size > LARGEST_FOLDER:
            raise UserError(f"{folder} holds more than an audit writes: {path.name}")
        try:
            contents[path.relative_to(folder).as_posix()] = path.read_bytes()
        except OSError as error:
            raise UserError(f"cannot read {path}: {error.strerror}") from error
    return contents


def check_folder(folder: Path, specs: Sequence[str] = (), all_episodes: bool = False) -> Findings:
    """Read a folder once; check its hashes, that its files follow from each other, its references.

    Another version of this package may have written other pages and numbers from the same episodes;
    but anyone can write the hash of another version into a report. So what this version would not
    write is a fault, or, under another hash, not checked; another decision always is a fault.

    Args:
        folder: Folder of a report.
        specs: References as for `check_references`.
        all_episodes: As for `check_references`.

    Raises:
        UserError: As `content_of`, or if its report or declaration can't be read.
    """
    files = content_of(folder)
    return replace(_check(files, folder, specs, all_episodes), files=files)


def report_of(files: Files, folder: Path) -> Json:
    """Return the content of `report.json` among files by path; the folder is for messages.

    Raises:
        UserError: If it doesn't follow the schema.
    """
    return _parsed(files[REPORT], folder / REPORT)


def _check(files: Files, folder: Path, specs: Sequence[str], all_episodes: bool) -> Findings:
    damage = _of_manifest(files)
    if damage:
        return Findings(damage)
    # A forger can change hashes too; the files must still be consistent with the report.
    report = report_of(files, folder)
    if PROFILE in files:
        hashes = report["hashes"]
        declared = parse(files[PROFILE], PROFILE)
        if declared.sha256 != hashes["profile"]:
            damage.append(f"{PROFILE} is not the declaration of {REPORT}")
        committed = Commitment(hashes["policy"], hashes["profile"]).sha256
        if committed != report["seeds"]["commitment_sha256"]:
            damage.append(f"the commitment in {REPORT} is not that of its hashes")
        damage = damage or faults_of_seeds(report)
    else:
        damage.append(f"{PROFILE} is missing")
    if files.get(STATEMENT) != layout.statement(files, report):
        damage.insert(0, f"{STATEMENT} is not consistent with {REPORT}")
    if damage:
        return Findings(damage)
    try:
        audited = audited_of(files, report)
        numbers = differences_of(audited, report)
    except UserError as error:
        return Findings([str(error)])
    pages = [name for name, page in layout.views_of(report).items() if files.get(name) != page]
    faults = [f"{page} is not the page of {REPORT}" for page in pages]
    faults += [f"{number} does not follow from the episodes" for number in numbers]
    ours = report["hashes"]["package"] == package_sha256()
    if faults and (ours or DECISION in numbers):
        return Findings(faults)
    again = check_references(audited, report["hashes"]["package"], specs, all_episodes)
    if again.faults and ours:
        return Findings(again.faults)
    episodes = f"{report['seeds']['episodes']} episodes"
    checked = [f"hashes of {len(files) - 1} files", "statement", "declaration and commitment"]
    checked += [] if pages else ["pages"]
    checked += [] if again.faults else ["references, run again"]
    checked += [] if numbers else [f"verdict and numbers, recomputed from {episodes}"]
    # Files that no audit writes.
    rows = [row for rows in report["episodes"].values() for row in rows]
    traffic = report["shift"]["traffic"] if report["shift"] else []
    expected = {REPORT, PROFILE, *SEALS, *layout.views_of(report), *(row["film"] for row in rows)}
    expected |= {layout.evidence_path(number) for number in range(len(traffic) + 1)}
    expected |= {CONTEXTS} if "angle_rule" in report["declaration"] else set()
    unknown = [
        *pages,
        *numbers,
        *again.faults,
        *again.not_checked,
        *sorted(files.keys() - expected),
    ]
    return Findings([], unknown, checked, again.believed)


DECISION = "report.verdict.decision"


def faults(folder: Path) -> list[str]:
    """Return the faults of a folder, none if its files are consistent (`check_folder`)."""
    return check_folder(folder).faults


def _of_manifest(files: Files) -> list[str]:
    try:
        listed = _listed(files[MANIFEST])
        fresh = _listed(layout.manifest(files))
    except ValueError:
        return [f"{MANIFEST} is damaged"]
    there = files.keys() - {MANIFEST, SIGNATURES}
    damage = [f"{name} is missing" for name in sorted(listed.keys() - there)]
    damage += [f"{name} was added" for name in sorted(there - listed.keys())]
    same = sorted(there & listed.keys())
    damage += [f"{name} was changed" for name in same if fresh[name] != listed[name]]
    if not damage and layout.manifest(files) != files[MANIFEST]:
        damage = [f"{MANIFEST} was changed"]
    return damage


def _listed(content: bytes) -> dict[str, str]:
    pairs = [line.split("  ", 1) for line in content.decode().splitlines()]
    return {name: sha256 for sha256, name in pairs}


def faults_by_nonce(report: Json, nonce: Nonce) -> list[str]:
    """Return why a report's seed is not that of a nonce, revealed for the report's commitment.

    `check_folder` must have found no faults in the report.

    Args:
        report: Content of `report.json`.
        nonce: The nonce.

    Returns:
        One line; none if the seed comes from the nonce.
    """
    draw, look = opened_of(report)
    if draw.revealed != nonce:
        return [f"{REPORT} has not the nonce of {nonce.file}"]
    if look is None or nonce.commitment != look.entry:
        return [f"the nonce of {nonce.file} was not revealed for the commitment in {REPORT}"]
    return []


def faults_by_log(content: bytes, report: Json, path: Path) -> list[str]:
    """Return the differences between a report and a log.

    The log may have grown since. Every commitment before the report's counts as a look, so a report
    that hides one has another number than the log. `check_folder` must have found no faults in the
    report.

    Args:
        content: Bytes of `report.json`.
        report: What they hold.
        path: File of the log.

    Returns:
        A line for each difference; none if the report is the look that it claims to be.

    Raises:
        UserError: If the log can't be read, or its chain is broken.
    """
    draw, look = opened_of(report)
    if look is None:
        return [f"{REPORT} names no audit log"]
    declared = report["declaration"]
    subject = Subject(declared["owner"], declared["scenario"]["sha256"])
    log = AuditLog(path, subject.sha256, read(path, subject.sha256))
    number = log.look_of(look.entry)
    if number == 0:
        return [f"{path} has no look {look.number} of {REPORT}: one of them was written again"]
    differing = []
    if number != look.number:
        differing = [f"{REPORT} is look {number} by {path}, and claims to be look {look.number}"]
    entry = next(line for line in log.entries if line["sha256"] == look.entry)
    seed = log.following(SEED, look.entry)
    records = [row["record"] for row in references_of(report)]
    references = sorted(record["sha256"] for record in records if record is not None)
    claims = {
        "policy": (entry["policy_sha256"], report["hashes"]["policy"]),
        "declaration": (entry["profile_sha256"], report["hashes"]["profile"]),
        "number of episodes": (entry["episodes"], report["seeds"]["episodes"]),
        "selection of actions": (entry["soft"], not report["policy"]["deterministic"]),
        "time of the commitment": (entry["time"], look.committed),
        "line before it": (entry["previous"], look.before),
        "source of the seed": (
            entry["seed"],
            {"source": draw.source} if draw.revealed is None else of_revealed(draw.revealed),
        ),
        "list of references": (sorted(entry["references"]), references),
        "seed": (seed and seed["seed"], report["seeds"]["seed"]),
    }
    differing += [
        f"{REPORT}: its {what} is not that of {path}"
        for what, (logged, told) in claims.items()
        if logged != told
    ]
    result = log.following(RESULT, look.entry)
    if result is None or result["report_sha256"] != sha256_of(content):
        differing.append(f"{path} has another result for look {number}, or none")
    return differing
