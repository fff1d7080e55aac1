"""The auditor's nonce: a secret whose hash the owner's commitment names before it is revealed."""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
from dataclasses import dataclass
from pathlib import Path

from socialiq.errors import UserError
from socialiq.storage import read_small_json

_HEX = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Nonce:
    """A secret of 256 bits.

    Attributes:
        value: The secret, 64 hexadecimal digits.
    """

    value: str

    @property
    def sha256(self) -> str:
        """SHA-256 of the secret's 32 bytes: what the owner is told."""
        return hashlib.sha256(bytes.fromhex(self.value)).hexdigest()


def write_nonce(path: Path) -> Nonce:
    """Draw a nonce and write it to a new file that only its user can read.

    Raises:
        UserError: If the file exists or can't be written.
    """
    nonce = Nonce(secrets.token_hex(32))
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError as error:
        raise UserError(f"{path} exists already: a nonce is used once; name a new file") from error
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}; choose another place") from error
    try:
        with os.fdopen(handle, "w") as file:
            file.write(json.dumps({"nonce": nonce.value}) + "\n")
    except OSError as error:
        path.unlink(missing_ok=True)
        raise UserError(f"cannot write {path}: {error.strerror}; choose another place") from error
    return nonce


def read_nonce(path: Path) -> Nonce:
    """Read a file of `write_nonce`.

    Raises:
        UserError: If it is missing or something else.
    """
    found = read_small_json(path)
    value = found.get("nonce") if isinstance(found, dict) else None
    if not isinstance(value, str) or not _HEX.fullmatch(value):
        raise UserError(f"{path} has no nonce: `socialiq audit nonce --out FILE` writes one")
    return Nonce(value)


def check_sha256(text: str) -> None:
    """Check the form of a hash.

    Raises:
        UserError: If it is not 64 hexadecimal digits in lower case.
    """
    if not _HEX.fullmatch(text):
        raise UserError(
            "--nonce-sha256 must be 64 hexadecimal digits in lower case, as `socialiq audit nonce` "
            "prints them"
        )
