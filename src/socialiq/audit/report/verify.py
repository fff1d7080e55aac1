"""Verify a report's folder: hash every file, and regenerate what follows from the report."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from socialiq.audit.profile.reader import parse
from socialiq.audit.report.folder import (
    MANIFEST,
    PROFILE,
    REPORT,
    STATEMENT,
    manifest,
    statement,
    views_of,
)
from socialiq.audit.report.seeds import faults_of_seeds
from socialiq.audit.seeds.commitment import Commitment
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.provenance import package_sha256

LARGEST_REPORT = 16 * 1024 * 1024  # bytes; a report with its cloud has about 100,000


@cache
def shipped_schema() -> dict[str, Any]:
    """Return the JSON Schema of `report.json`."""
    return json.loads(files("socialiq.audit.report").joinpath("report.schema.json").read_text())


def read_report(path: Path) -> dict[str, Any]:
    """Read a `report.json` and check it.

    Raises:
        UserError: If it is missing, too large, not JSON, or doesn't follow the schema.
    """
    if not path.is_file():
        raise UserError(f"no such file: {path}: name a folder that `socialiq audit` wrote")
    with path.open("rb") as file:
        content = file.read(LARGEST_REPORT + 1)
    if len(content) > LARGEST_REPORT:
        raise UserError(f"{path} has more than {LARGEST_REPORT:,} bytes: it is not a report")
    try:
        report = json.loads(content, parse_constant=_refuse)
        # Half of a surrogate pair is JSON, but no text: no page could be written with it.
        json.dumps(report, ensure_ascii=False).encode()
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} is not JSON: restore it, or audit again") from error
    fault = fault_of(report, shipped_schema())
    if fault:
        raise UserError(f"{path} is not a report of this version: {fault}; audit again")
    return report


def _refuse(word: str) -> None:
    raise ValueError(word)


def fault_of(value: Any, schema: dict[str, Any]) -> str:
    """Return the first violation of a schema with its place in the report, or "" if none.

    Args:
        value: JSON value.
        schema: JSON Schema 2020-12.
    """
    error = next(_validator(schema).iter_errors(value), None)
    while error is not None and error.context:  # of `anyOf`: why the first alternative fails
        error = error.context[0]
    if error is None:
        return ""
    place = "the report" + "".join(
        f"[{step}]" if isinstance(step, int) else f".{step}" for step in error.absolute_path
    )
    return one_line(f"{place} {_fault(error)}")


def _validator(schema: dict[str, Any]) -> Any:
    from jsonschema import Draft202012Validator, validators

    # JSON Schema takes 1.0 for an integer, but a count of episodes has to be one in Python too.
    types = Draft202012Validator.TYPE_CHECKER.redefine(
        "integer", lambda _, one: isinstance(one, int) and not isinstance(one, bool)
    )
    return validators.extend(Draft202012Validator, type_checker=types)(schema)


def _fault(error: Any) -> str:
    """Return an error of `jsonschema` in a few words."""
    demand, value = error.validator_value, error.instance
    if error.validator == "required":
        return f"lacks {next(name for name in demand if name not in value)}"
    return {
        "additionalProperties": "has an unknown field",
        "type": f"is not of type {demand}",
        "enum": f"is not one of {demand}",
        "const": f"is not {demand}",
        "pattern": "has another form",
        "minimum": f"is less than {demand}",
        "maximum": f"is more than {demand}",
    }.get(error.validator, "has another length")


MOST_FILES = 100

LARGEST_FOLDER = 1024 * 1024 * 1024  # bytes; a million episodes with their references have fewer


def content_of(folder: Path) -> dict[str, bytes]:
    """Return the content of every file below a folder, by path.

    Raises:
        UserError: If it is not a folder of an audit, or has links or too many or large files.
    """
    if not (folder / MANIFEST).is_file() or not (folder / REPORT).is_file():
        raise UserError(f"{folder} has no report: name a folder that `socialiq audit` wrote")
    found: dict[str, bytes] = {}
    size = 0
    for path in sorted(folder.rglob("*")):
        if path.is_symlink():
            raise UserError(f"{path} is a link: a report's folder has plain files only")
        if path.is_dir():
            continue
        if not path.is_file():
            raise UserError(f"{path} is not a plain file: a report's folder has plain files only")
        size += path.stat().st_size
        if len(found) >= MOST_FILES or size > LARGEST_FOLDER:
            raise UserError(f"{folder} holds more than an audit writes: {path.name}")
        try:
            found[path.relative_to(folder).as_posix()] = path.read_bytes()
        except OSError as error:
            raise UserError(f"cannot read {path}: {error.strerror}") from error
    return found


def faults(folder: Path) -> list[str]:
    """Return the faults of a folder, none if it is as it was written.

    Raises:
        UserError: As `content_of`.
    """
    files = content_of(folder)
    found = _of_manifest(files)
    if found:
        return found
    # A forger can change hashes too; the files must still be consistent with the report.
    report = read_report(folder / REPORT)
    return [*_of_statement(files, report), *_of_profile(files, report), *_of_views(files, report)]


def _of_manifest(files: Mapping[str, bytes]) -> list[str]:
    listed = _listed(files[MANIFEST])
    if listed is None:
        return [f"{MANIFEST} is damaged"]
    there = {name for name in files if name != MANIFEST}
    found = [f"{name} is missing" for name in sorted(listed.keys() - there)]
    found += [f"{name} was added" for name in sorted(there - listed.keys())]
    fresh = _listed(manifest(files)) or {}
    same = sorted(there & listed.keys())
    found += [f"{name} was changed" for name in same if fresh[name] != listed[name]]
    if not found and manifest(files) != files[MANIFEST]:
        found = [f"{MANIFEST} was changed"]
    return found


def _listed(content: bytes) -> dict[str, str] | None:
    try:
        pairs = [line.split("  ", 1) for line in content.decode().splitlines()]
        return {name: sha256 for sha256, name in pairs}
    except ValueError:
        return None


def _of_statement(files: Mapping[str, bytes], report: Mapping[str, Any]) -> list[str]:
    subjects = {name: one for name, one in files.items() if name not in (MANIFEST, STATEMENT)}
    same = files.get(STATEMENT) == statement(subjects, report)
    return [] if same else [f"{STATEMENT} is not consistent with {REPORT}"]


def _of_profile(files: Mapping[str, bytes], report: Mapping[str, Any]) -> list[str]:
    """Compare the copied declaration with the one that was committed to."""
    if PROFILE not in files:
        return [f"{PROFILE} is missing"]
    hashes = report["hashes"]
    committed = Commitment(hashes["policy"], hashes["profile"]).sha256
    declared = parse(files[PROFILE], PROFILE)
    found = []
    if declared.sha256 != hashes["profile"]:
        found.append(f"{PROFILE} is not the declaration of {REPORT}")
    if committed != report["seeds"]["commitment_sha256"]:
        found.append(f"the commitment in {REPORT} is not that of its hashes")
    return found or faults_of_seeds(report)


def _of_views(files: Mapping[str, bytes], report: Mapping[str, Any]) -> list[str]:
    """Compare the pages with those made from the report, if by the same code."""
    if not _is_ours(report):
        return []
    return [f"{name} is not the page of {REPORT}" for name in _other_views(files, report)]


def not_checked(folder: Path) -> list[str]:
    """Return the pages of a folder without faults that can't be held against its report.

    Another version of this package may have written other pages from the same report; but anyone
    can write the hash of another version into a report.

    Raises:
        UserError: As `content_of`.
    """
    files, report = content_of(folder), read_report(folder / REPORT)
    return [] if _is_ours(report) else _other_views(files, report)


def _is_ours(report: Mapping[str, Any]) -> bool:
    return report["hashes"]["package"] == package_sha256()


def _other_views(files: Mapping[str, bytes], report: Mapping[str, Any]) -> list[str]:
    """Return the pages that are not those that this package makes from the report."""
    fresh = views_of(report)
    return [name for name in fresh if files.get(name) != fresh[name]]


def differences(old: Any, new: Any, place: str = "report") -> list[str]:
    """Return the places where two reports differ, apart from times, versions and films.

    Numbers must agree to the last digit, as they do on the same machine with the same versions.
    """
    if isinstance(old, dict) and isinstance(new, dict):
        skipped = _NOT_COMPARED.get(place, _NOWHERE_COMPARED)
        names = sorted((old.keys() | new.keys()) - skipped)
        missing = object()
        return [
            one
            for name in names
            for one in differences(
                old.get(name, missing), new.get(name, missing), f"{place}.{name}"
            )
        ]
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = enumerate(zip(old, new, strict=True))
        return [one for row, pair in pairs for one in differences(*pair, f"{place}[{row}]")]
    return [] if _text(old) == _text(new) else [place]


_NOWHERE_COMPARED = frozenset({"film", "isolation"})

_NOT_COMPARED = {
    "report": frozenset({"timing", "versions", "machine", "command", "reference_files"}),
    "report.hashes": frozenset({"package"}),
    # The auditor chooses the limits of a process; its name may have another path.
    "report.policy.record": frozenset({"source", "start", "step", "memory", "isolation"}),
}


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True, default=str)
