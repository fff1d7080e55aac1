"""Signatures of files, FILE.sig in the same folder, in the format of OpenSSF Model Signing."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from socialiq.audit.report import signature
from socialiq.errors import UserError
from socialiq.foreign import optional
from socialiq.reading import read_bytes

_LARGEST_KEY = 1 << 16  # bytes


def path_of_signature(file: Path) -> Path:
    """Return the path of a file's signature: in the same folder, with .sig at the end."""
    return file.with_name(f"{file.name}.sig")


@contextmanager
def private_copy(file: Path) -> Iterator[Path]:
    """Copy a file to where no one changes it between its check and its use, with the same name.

    Raises:
        UserError: If it can't be read.
    """
    with tempfile.TemporaryDirectory() as place:
        copy = Path(place) / file.name
        try:
            shutil.copyfile(file, copy)
        except OSError as error:
            raise UserError(f"cannot read {file}: {error.strerror}") from error
        yield copy


def sign_model(file: Path, key: Path) -> bytes:
    """Return a P-256 key's signature of a file, in the format of OpenSSF Model Signing.

    Args:
        file: The file.
        key: PEM file of the private key.

    Raises:
        UserError: If the extra `signing` isn't installed, or the key or the file can't be used.
    """
    config = _library("signing").Config()
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "signature"
        try:
            passphrase = os.environ.get(signature.PASSPHRASE)
            signer = config.use_elliptic_key_signer(private_key=key, password=passphrase)
            signer.sign(file, path)
        except (ValueError, TypeError, AttributeError, OSError) as error:
            raise UserError(
                f"{file} is not signed: its format takes a key of an elliptic curve (P-256): "
                f"{_first_line(error)}"
            ) from error
        return path.read_bytes()


def fault_of_model(file: Path, signed: Path, key: Path) -> str:
    """Return why a signature does not belong to a file and a public key.

    Args:
        file: The file.
        signed: File of the signature.
        key: PEM file of the public key.

    Returns:
        One line; "" if the signature is valid.

    Raises:
        UserError: If the extra `signing` isn't installed, or the key can't be read.
    """
    config = _library("verifying").Config()
    read_bytes(key, _LARGEST_KEY)  # the library reads a device to its end
    try:
        config.use_elliptic_key_verifier(public_key=key).verify(file, signed)
    except Exception as error:  # the library raises those of its parsers too
        return f"{signed} is not this key's signature of {file}: {_first_line(error)}"
    return ""


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]


def _library(module: str) -> Any:
    optional("OpenSSL", "signing", "a file's signature")  # imported and not asked for by:
    return optional(f"model_signing.{module}", "signing", "a file's signature")
