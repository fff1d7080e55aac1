"""Folder of a report: its files, their manifest and statement, written atomically.

`signature` signs the statement; `cosign`, `ssh-keygen -Y sign` and others sign any file as it is.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from socialiq.audit.evidence.drive import CANDIDATES
from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.evidence.table import CONTEXTS, write_contexts, write_table
from socialiq.audit.profile.profile import Profile
from socialiq.audit.report.documents import claims, credibility, materials, mermaid
from socialiq.audit.report.views import html, markdown
from socialiq.errors import UserError
from socialiq.foreign import Markdown
from socialiq.outputs import check_output_folder, whole_folder
from socialiq.reading import sha256_of
from socialiq.storage import write_atomically
from socialiq.types import Files, Json

REPORT = "report.json"
EVIDENCE = "episodes.csv"
PROFILE = "profile.toml"
MANIFEST = "MANIFEST.sha256"
STATEMENT = "statement.intoto.json"

SIGNATURES = "statement.dsse.json"
"""Envelope of the signed statement. It is made after the manifest, which does not list it."""

SEALS = frozenset({MANIFEST, STATEMENT, SIGNATURES})  # files that are no subjects of the statement
PREDICATE_TYPE = "https://socialiq.example/audit/v1"  # a name, as in-toto requires; not an address
_STATEMENT_TYPE = "https://in-toto.io/Statement/v1"


def sealed(files: Files, report: Json) -> Files:
    """Return files by path with their statement, and the manifest of all these.

    Args:
        files: Content of the files by path.
        report: Content of `report.json`.
    """
    subjects = {**files, STATEMENT: statement(files, report)}
    return {**subjects, MANIFEST: manifest(subjects)}


def manifest(files: Files) -> bytes:
    """Return the lines of `sha256sum` for all files, in the order of the paths."""
    names = sorted(files.keys() - {MANIFEST, SIGNATURES})
    return "".join(f"{sha256_of(files[name])}  {name}\n" for name in names).encode()


def statement(files: Files, report: Json) -> bytes:
    """Return the in-toto Statement v1 that these files are the result of this audit.

    Args:
        files: Content of the files by path; `SEALS` are no subjects of the statement.
        report: Content of `report.json`.

    Returns:
        JSON text in UTF-8.
    """
    verdict = {key: report["verdict"][key] for key in ("decision", "reason", "episodes")}
    content = {
        "_type": _STATEMENT_TYPE,
        "subject": [
            {"name": name, "digest": {"sha256": sha256_of(files[name])}}
            for name in sorted(files.keys() - SEALS)
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
            "machine": report["machine"],
            "versions": report["versions"],
            "claimsOfAuditor": report["claims_of_auditor"],
        },
    }
    return (json.dumps(content, indent=2, allow_nan=False) + "\n").encode()


def files_of(
    report: Json,
    profile: Profile,
    evidence: Sequence[Evidence],
    films: Files | None = None,
) -> Files:
    """Return the content of all files by path, with manifest and statement.

    Args:
        report: Content of `report.json`.
        profile: The declaration, which is copied byte by byte.
        evidence: Evidence of the verdict, then that of each other traffic.
        films: Films by path; none by default.
    """
    text = json.dumps(report, indent=2, allow_nan=False) + "\n"
    files = {
        REPORT: text.encode(),
        PROFILE: profile.source,
        **tables_of(evidence),
        **(films or {}),
        **views_of(json.loads(text)),
    }
    return sealed(files, report)


def tables_of(evidence: Sequence[Evidence]) -> Files:
    """Return the tables of all episodes, by path: the declared traffic first.

    With a declared rule of the angle the policy's decision losses by context are among them.
    """
    tables = {
        evidence_path(number): write_table(episodes).encode()
        for number, episodes in enumerate(evidence)
    }
    contexts = evidence[0].policy.contexts
    if contexts is not None:
        tables[CONTEXTS] = write_contexts(contexts, CANDIDATES).encode()
    return tables


def evidence_path(traffic: int) -> str:
    """Return the path of a table of episodes: 0 is the declared traffic, 1 the first other one."""
    return f"episodes-shift-{traffic}.csv" if traffic else EVIDENCE


def views_of(report: Json) -> Files:
    """Return the files that are made from the report alone."""
    tree = claims(report)
    diagram = Markdown(mermaid(tree))
    objects = [{**claim._asdict(), "below": list(claim.below)} for claim in tree]
    pages = {
        "report.md": {},
        "annex-iv.md": {},
        "nist-ai-rmf.md": {},
        "safety-case.md": {"claims": tree, "diagram": diagram},
        "credibility.md": {"facts": credibility(report)},
    }
    return {
        "report.html": html(report).encode(),
        **{name: markdown(report, f"{name}.j2", **pages[name]).encode() for name in pages},
        "ml-bom.cdx.json": materials(report),
        "claims.json": (json.dumps(objects, indent=2) + "\n").encode(),
    }


def check_target(folder: Path, replace: bool) -> None:
    """Refuse an output folder before any work is done.

    Args:
        folder: Folder to write.
        replace: Whether an earlier report in the folder may be replaced.

    Raises:
        UserError: If it has content and may not be replaced, has files that are not of a report,
            or can't be made.
    """
    if not check_output_folder(folder, replace):
        return
    listed = {MANIFEST, SIGNATURES}
    if (folder / MANIFEST).is_file():
        text = (folder / MANIFEST).read_text(errors="replace")
        listed |= {line.partition("  ")[2] for line in text.splitlines()}
    files = (path for path in sorted(folder.rglob("*")) if not path.is_dir())
    names = (path.relative_to(folder).as_posix() for path in files)
    # A file that the manifest doesn't list may be the user's.
    if unlisted := next((name for name in names if name not in listed), ""):
        raise UserError(
            f"{folder} holds {unlisted}, which no audit wrote: it is not replaced; name another"
        )


def write_folder(folder: Path, files: Files, replace: bool) -> None:
    """Write all files of a report by path, or leave the folder as it was (`check_target`).

    Args:
        folder: Folder to write.
        files: Content of the files by path.
        replace: Whether an earlier report in the folder is replaced.

    Raises:
        UserError: As `check_target`, or if a file can't be written.
    """
    check_target(folder, replace)
    with whole_folder(folder, replace) as target:
        for name, content in files.items():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            write_atomically(target / name, content)
