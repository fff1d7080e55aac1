"""Signature of a policy's file in the format of OpenSSF Model Signing, which other tools check.

The library needs the extra `signing`: https://github.com/sigstore/model-transparency.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

from socialiq.errors import UserError
from socialiq.foreign import optional

PASSPHRASE = "SOCIALIQ_KEY_PASSPHRASE"
"""Name of the environment variable with the passphrase of an encrypted key."""


def path_of_signature(policy: Path) -> Path:
    """Return the path of a policy's signature: beside it, with .sig at the end."""
    return policy.with_name(f"{policy.name}.sig")


def sign_model(policy: Path, key: Path) -> bytes:
    """Return the signature of a policy's file.

    Args:
        policy: The file.
        key: Private key of an elliptic curve, a PEM file; the format knows no Ed25519.

    Raises:
        UserError: If the extra is missing, or the library refuses file or key.
    """
    config = _library("signing").Config()
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "signature"
        try:
            passphrase = os.environ.get(PASSPHRASE)
            signer = config.use_elliptic_key_signer(private_key=key, password=passphrase)
            signer.sign(policy, path)
        except (ValueError, TypeError, AttributeError, OSError) as error:
            raise UserError(
                f"{policy} is not signed: its format takes a key of an elliptic curve (P-256): "
                f"{_first_line(error)}"
            ) from error
        return path.read_bytes()


def fault_of_model(policy: Path, signature: Path, key: Path) -> str:
    """Return why a signature is not of a policy's file and a key, or "" if it is.

    Args:
        policy: The policy's file.
        signature: File of the signature.
        key: Public key, a PEM file.

    Raises:
        UserError: If the extra is missing.
    """
    config = _library("verifying").Config()
    try:
        config.use_elliptic_key_verifier(public_key=key).verify(policy, signature)
    except Exception as error:  # the library raises those of its parsers too
        return f"{signature} is not this key's signature of {policy}: {_first_line(error)}"
    return ""


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]


def _library(module: str) -> Any:
    optional("OpenSSL", "signing", "a policy's signature")  # imported and not asked for by:
    return optional(f"model_signing.{module}", "signing", "a policy's signature")
