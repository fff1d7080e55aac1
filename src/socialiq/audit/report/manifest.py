"""Seals of a report's folder: a manifest of hashes, and an in-toto statement, both plain text.

Nothing here signs: `cosign`, `ssh-keygen -Y sign` and others do that to the files as they are.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

MANIFEST = "MANIFEST.sha256"
STATEMENT = "statement.intoto.json"
PREDICATE_TYPE = "https://socialiq.example/audit/v1"
"""A name, as in-toto asks for; nothing is fetched from there."""

_STATEMENT_TYPE = "https://in-toto.io/Statement/v1"


def sealed(files: Mapping[str, bytes], report: Mapping[str, Any]) -> dict[str, bytes]:
    """The files with their statement and their manifest.

    The statement's subjects are the files; the manifest covers those and the statement.

    Args:
        files: Content by path in the folder.
        report: The content of `report.json`.
    """
    found = {**files, STATEMENT: statement(files, report)}
    return {**found, MANIFEST: manifest(found)}


def manifest(files: Mapping[str, bytes]) -> bytes:
    """Lines as `sha256sum` writes and checks them, in the order of the paths."""
    lines = (f"{_sha256(files[name])}  {name}\n" for name in sorted(files) if name != MANIFEST)
    return "".join(lines).encode()


def statement(files: Mapping[str, bytes], report: Mapping[str, Any]) -> bytes:
    """in-toto Statement v1: these files are the outcome of this audit."""
    verdict = {key: report["verdict"][key] for key in ("decision", "reason", "episodes")}
    content = {
        "_type": _STATEMENT_TYPE,
        "subject": [
            {"name": name, "digest": {"sha256": _sha256(files[name])}} for name in sorted(files)
        ],
        "predicateType": PREDICATE_TYPE,
        "predicate": {
            "verdict": verdict,
            "declaredAngle": report["declaration"]["angle"],
            "policySource": report["policy"]["record"]["source"],
            "hashes": report["hashes"],
            "seeds": report["seeds"],
            "started": report["timing"]["started"],
            "command": report["command"],
        },
    }
    return (json.dumps(content, indent=2, allow_nan=False) + "\n").encode()


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
