"""Untrusted zip archives: members are read by name into memory, never extracted.

Counts and sizes are bounded before anything is unpacked, so a small file cannot fill the memory.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib

from socialiq.errors import UserError

MOST_MEMBERS = 1_000
"""More than a network of a hundred layers has."""

_ENTRY = b"PK\x01\x02"  # begins every entry of a zip's directory (APPNOTE.TXT 4.3.12)
_ENCRYPTED = 1  # bit 0 of an entry's flags
_PLAIN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    NotImplementedError,
    OSError,
    OverflowError,
    RuntimeError,
    ValueError,
)
"""Exceptions that `zipfile` raises on a crafted file, by its source."""


class Archive:
    """A zip in memory.

    Args:
        content: The file.
        source: Its name in messages.

    Raises:
        UserError: If it is not a zip, or not one that Stable-Baselines3 writes.
    """

    def __init__(self, content: bytes, source: str) -> None:
        self.source = source
        # An archive may hold others, whose entries are counted too. The count comes first because
        # `zipfile` makes an object for each entry of the directory.
        if content.count(_ENTRY) > 3 * MOST_MEMBERS:
            raise self.refusal(f"has more than {MOST_MEMBERS} members")
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(content))
        except _DAMAGE as error:
            raise self.refusal("is damaged or not a zip archive") from error
        members = self._zip.infolist()
        self.names = tuple(member.filename for member in members)
        if len(members) > MOST_MEMBERS:
            raise self.refusal(f"has more than {MOST_MEMBERS} members")
        # Of two members of one name, two programs may read different ones.
        if len(set(self.names)) < len(members):
            raise self.refusal("has two members of one name")
        for member in members:
            if _leads_outside(member.orig_filename):
                raise self.refusal("has a member whose path leads outside the archive")
            if member.compress_type not in _PLAIN or member.flag_bits & _ENCRYPTED:
                raise self.refusal("has a member that is encrypted or of a rare compression")

    def read(self, name: str, most: int) -> bytes:
        """Read one member.

        Args:
            name: Its path in the archive.
            most: Its largest size in bytes.

        Raises:
            UserError: If it is missing, damaged or larger.
        """
        if name not in self.names:
            raise self.refusal(f"has no member {name}")
        if self._zip.getinfo(name).file_size > most:
            raise self.refusal(f"has a member {name} of more than {most:,} bytes")
        try:
            with self._zip.open(name) as file:
                content = file.read(most + 1)  # one more than it has: the checksum comes last
        except _DAMAGE as error:
            raise self.refusal(f"has a damaged member {name}") from error
        return content

    def refusal(self, fault: str) -> UserError:
        """Return the error with a fault of this archive."""
        return UserError(f"{self.source} {fault}: restore the file or save the policy again")


def _leads_outside(name: str) -> bool:
    parts = name.replace("\\", "/").split("/")
    return "\x00" in name or ":" in parts[0] or name[:1] in ("/", "\\") or ".." in parts
