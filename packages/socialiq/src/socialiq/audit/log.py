"""The audit log: append-only JSON lines, each with the hash of the line before it.

One file for each owner and scenario. The chain shows that no line inside was changed, removed or
moved. It can't show that lines at the end were removed, or that another file was written in its
place: to find that, compare with a hash that someone else holds, for instance in an earlier
report (`audit verify --log`).
"""

from __future__ import annotations

import datetime
import json
import os
import re
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import filelock

from socialiq.audit.profile.profile import Profile
from socialiq.errors import UserError
from socialiq.reading import open_file, sha256_of
from socialiq.types import Json

Entry = Json
"""One line: number, kind, time, previous, sha256, and the fields of its kind."""

COMMITMENT = "commitment"
SEED = "seed"
RESULT = "result"
"""Kinds of lines: what was committed to, the seed that came after it, the verdict."""

LARGEST_LOG = 64 * 1024 * 1024  # bytes; about 50,000 looks
_WAIT = 60.0  # seconds for another process that is writing
_PURPOSE = "socialiq audit log 1"

_INVISIBLE = re.compile("FILLER|MODIFIER LETTER|TATWEEL")
"""Names of letters that no one reads as letters: fillers of Hangul, raised commas, strokes."""


_ALIKE = {"LATIN", "GREEK", "CYRILLIC", "COPTIC", "ARMENIAN", "CHEROKEE", "LISU"}
"""Scripts with letters that look like those of another one, by the first word of their names."""

_PHONETIC = re.compile("[\u0250-\u02af\u1d00-\u1dbf\ua720-\ua7ff\uab30-\uab6f]")
"""Latin letters of phonetics and of small capitals, which look like the usual ones."""


class Subject(NamedTuple):
    """Owner and scenario of a log; every look at it counts, whatever policy or profile it names.

    A byte of a profile or a policy is free to change, so a count for each of them would not limit
    the number of looks.
    """

    owner: str
    scenario_sha256: str

    @staticmethod
    def of(profile: Profile) -> Subject:
        """Return the subject of a declaration."""
        return Subject(profile.owner, profile.scenario.sha256)

    @property
    def plain_owner(self) -> str:
        """Letters and digits of the owner's name, without case.

        So spaces, punctuation and invisible characters, some of which Unicode counts as letters,
        don't make another owner.
        """
        name = unicodedata.normalize("NFKC", self.owner).casefold()
        letters = filter(str.isalnum, name)
        plain = (
            letter for letter in letters if not _INVISIBLE.search(unicodedata.name(letter, ""))
        )
        return "".join(plain) or name

    @property
    def _alike(self) -> str:
        """First letter that can stand for one of another script in this name; "" if none can."""
        letters = [letter for letter in self.plain_owner if letter.isalpha()]
        scripts = {unicodedata.name(letter, "").partition(" ")[0] for letter in letters}
        mixed = len(scripts & _ALIKE) > 1
        rare = (letter for letter in letters if _PHONETIC.search(letter))
        return next((letter for letter in letters if mixed and not letter.isascii()), "") or next(
            rare, ""
        )

    @property
    def sha256(self) -> str:
        """SHA-256 of the subject; the first line of its log follows it."""
        return sha256_of(f"{_PURPOSE}\n{self.plain_owner}\n{self.scenario_sha256}\n")

    def path_in(self, folder: Path) -> Path:
        """Return the path of its log, whose name ends in the hash: an existing one, or a new one.

        Raises:
            UserError: If there are several, which have to be counted together, or a new one would
                have a name of which other letters look alike.
        """
        ending = f"-{self.sha256[:16]}.jsonl"
        paths = sorted(folder.glob(f"*{ending}"))
        if len(paths) > 1:
            names = " and ".join(path.name for path in paths)
            raise UserError(f"{names} in {folder} are logs of one owner: agree on one of them")
        if not paths and (letter := self._alike):
            raise UserError(
                f"the owner's name has '{letter}' ({unicodedata.name(letter, 'no name')}) beside "
                "letters of another script, which look alike: write it in the letters of one"
            )
        plain = re.sub(r"[^a-z0-9]+", "-", self.plain_owner)[:40].strip("-") or "owner"
        return paths[0] if paths else folder / f"{plain}{ending}"


@dataclass(frozen=True)
class AuditLog:
    """Lines of a log that were read and checked; `locked` alone gives one that may be extended.

    The first line follows the hash of the subject.
    """

    path: Path
    subject_sha256: str
    entries: list[Entry]

    @property
    def head(self) -> str:
        """Hash of the last line, or of the subject if there is none."""
        return self.entries[-1]["sha256"] if self.entries else self.subject_sha256

    @property
    def commitments(self) -> list[Entry]:
        """Lines of commitments, in their order."""
        return [entry for entry in self.entries if entry["kind"] == COMMITMENT]

    @property
    def looks(self) -> int:
        """Number of commitments."""
        return len(self.commitments)

    def look_of(self, sha256: str) -> int:
        """Return the number of the look of a commitment, 0 if there is no such line."""
        hashes = [entry["sha256"] for entry in self.commitments]
        return hashes.index(sha256) + 1 if sha256 in hashes else 0

    def following(self, kind: str, commitment: str) -> Entry | None:
        """Return the first line of a kind that belongs to a commitment.

        Args:
            kind: `SEED` or `RESULT`.
            commitment: Hash of the commitment's line.

        Returns:
            The line, or None if the log has none.
        """
        entries = (entry for entry in self.entries if entry["kind"] == kind)
        return next((entry for entry in entries if entry["commitment"] == commitment), None)

    def append(self, kind: str, fields: Json) -> Entry:
        """Write one more line; it is on the disk when this returns.

        Args:
            kind: Kind of the line.
            fields: Fields of this kind; number, time and hashes are added.

        Returns:
            The line that was written.

        Raises:
            UserError: If it can't be written; a part of a line is removed again.
        """
        entry = {
            "number": len(self.entries) + 1,
            "kind": kind,
            "time": now().isoformat(timespec="seconds"),
            **fields,
            "previous": self.head,
        }
        entry["sha256"] = sha256_of(_line(entry))
        line = _line(entry).encode() + b"\n"
        before = self.path.stat().st_size if self.path.exists() else None
        try:
            with self.path.open("ab", buffering=0) as file:
                while line:
                    line = line[file.write(line) :]
                os.fsync(file.fileno())
        except OSError as error:
            with suppress(OSError):  # a part of a line would damage the log
                if before is None:
                    self.path.unlink()
                else:
                    os.truncate(self.path, before)
            raise _not_written(self.path, error) from error
        self.entries.append(entry)
        return entry


def now() -> datetime.datetime:
    """Return the time of the machine's clock, UTC."""
    return datetime.datetime.now(datetime.UTC)


@contextmanager
def locked(folder: Path, subject: Subject) -> Iterator[AuditLog]:
    """Open a subject's log in a folder to extend it; other processes wait meanwhile.

    Raises:
        UserError: As `read`, or if it can't be written or another process doesn't release it.
    """
    path = folder / f"{subject.sha256[:16]}.jsonl"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        held = filelock.FileLock(path.with_suffix(".lock")).acquire(timeout=_WAIT)
    except filelock.Timeout as error:
        raise UserError(
            f"another process is writing {path}: try again when it has ended"
        ) from error
    except OSError as error:
        raise _not_written(path, error) from error
    with held:
        path = subject.path_in(folder)
        entries = read(path, subject.sha256) if path.exists() else []
        yield AuditLog(path, subject.sha256, entries)


def read(path: Path, subject_sha256: str | None = None) -> list[Entry]:
    """Return the lines of a log, all hashes checked.

    The first line must follow the hash of the subject; None accepts any.

    Raises:
        UserError: If it can't be read, or a line was cut off, changed, removed or moved.
    """
    if not path.is_file():
        raise UserError(f"no audit log {path}: `socialiq audit --log FOLDER` writes one")
    with open_file(path) as file:
        text = file.read(LARGEST_LOG + 1)
    if len(text) > LARGEST_LOG:
        raise UserError(f"{path} has more than {LARGEST_LOG:,} bytes: it is not an audit log")
    lines = text.split(b"\n")
    if lines.pop():
        raise UserError(
            f"{path}: the last line is incomplete: restore the file from a copy, or remove that "
            "line and tell the auditor"
        )
    entries: list[Entry] = []
    previous = subject_sha256
    for number, line in enumerate(lines, 1):
        entry: Entry = {}
        try:  # the bytes have to be those that `append` would write
            entry = json.loads(line)
            fields = {**_OF_EVERY_LINE, **_FIELDS[entry["kind"]]}
            content = {name: value for name, value in entry.items() if name != "sha256"}
            same = entry["sha256"] == sha256_of(_line(content)) and _line(entry).encode() == line
            typed = all(type(entry[name]) is kind for name, kind in fields.items())
            intact = same and typed and written_at(entry).tzinfo is not None
            follows = entry["number"] == number and entry["previous"] == (
                previous or entry["previous"]
            )
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            intact = follows = False
        if not intact or not follows:
            raise UserError(
                f"{path}: line {number} was changed, or one before it removed or moved: restore "
                "the file from a copy; without one, agree with the auditor on a new log"
            )
        entries.append(entry)
        previous = entry["sha256"]
    return entries


_FIELDS = {
    COMMITMENT: {
        "policy_sha256": str,
        "profile_sha256": str,
        "confidence": float,
        "episodes": int,
        "soft": bool,
        "references": list,
        "seed": dict,
    },
    SEED: {"commitment": str, "seed": int},
    RESULT: {"commitment": str, "decision": str, "report_sha256": str},
}
"""Fields that a line of each kind has, with their types, besides those of every line."""

_OF_EVERY_LINE = {"number": int, "kind": str, "time": str, "previous": str, "sha256": str}


def written_at(entry: Entry) -> datetime.datetime:
    """Return the time of a line."""
    return datetime.datetime.fromisoformat(entry["time"])


def _line(entry: Entry) -> str:
    return json.dumps(entry, separators=(",", ":"), allow_nan=False)


def _not_written(path: Path, error: OSError) -> UserError:
    return UserError(f"cannot write the audit log {path}: {error.strerror}; name another --log")
