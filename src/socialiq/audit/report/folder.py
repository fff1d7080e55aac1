"""A report's folder: whole or not at all, and never in place of something else."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

from socialiq.audit.report.manifest import MANIFEST
from socialiq.errors import UserError
from socialiq.storage import new_folder, part_beside, swap_folder, write_atomically

REPORT = "report.json"


def check_target(folder: Path, replace: bool) -> None:
    """Refuse an output folder before any work is done.

    Raises:
        UserError: If it has something in it and may not be replaced, holds something other than a
            report, or can't be made.
    """
    if not folder.parent.is_dir():
        new_folder(folder.parent)
    part_beside(folder).rmdir()  # whether it can be written there
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise UserError(f"{folder} is no folder: name another --out")
    if not folder.exists() or not any(folder.iterdir()):
        return
    if not replace:
        raise UserError(f"{folder} exists already: name a new folder, or add --replace")
    strange = _strange(folder)
    if strange:
        raise UserError(
            f"{folder} holds {strange}, which no audit wrote: it is not replaced; name another"
        )


def write_folder(folder: Path, files: Mapping[str, bytes], replace: bool) -> None:
    """Write all files into a temporary folder beside it, then rename.

    Args:
        folder: To make.
        files: Content by path in it.
        replace: Whether an earlier report may go.

    Raises:
        UserError: As `check_target`; what was there stays then.
    """
    check_target(folder, replace)
    part = part_beside(folder)
    try:
        for name, content in files.items():
            (part / name).parent.mkdir(parents=True, exist_ok=True)
            write_atomically(part / name, content)
        part.chmod(0o755)
        swap_folder(part, folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _strange(folder: Path) -> str:
    """A file that its manifest doesn't list, so that nothing of the user's is lost; or ""."""
    written = {MANIFEST}
    if (folder / MANIFEST).is_file():
        text = (folder / MANIFEST).read_text(errors="replace")
        written |= {line.partition("  ")[2] for line in text.splitlines()}
    files = (path for path in sorted(folder.rglob("*")) if not path.is_dir())
    names = (path.relative_to(folder).as_posix() for path in files)
    return next((name for name in names if name not in written), "")
