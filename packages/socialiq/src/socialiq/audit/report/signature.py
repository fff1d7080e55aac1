"""Signatures of an audit: the in-toto statement in an envelope of DSSE 1.0.

The statement has the hash of every file, `report.json` with all claims of its auditor among them,
so one signature covers the folder. DSSE: https://github.com/secure-systems-lab/dsse.
"""

from __future__ import annotations

import base64
import binascii
import json
import os
from pathlib import Path
from typing import Any

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from socialiq.audit.report.folder import SIGNATURES, STATEMENT
from socialiq.errors import UserError
from socialiq.reading import read_bytes, sha256_of
from socialiq.types import Files

PAYLOAD_TYPE = "application/vnd.in-toto+json"

PASSPHRASE = "SOCIALIQ_KEY_PASSPHRASE"
"""Name of the environment variable with the passphrase of an encrypted key."""

PrivateKey = Ed25519PrivateKey | ec.EllipticCurvePrivateKey
PublicKey = Ed25519PublicKey | ec.EllipticCurvePublicKey
MOST_SIGNATURES = 16
_LARGEST_KEY = 64 * 1024  # bytes


def encoded(payload_type: str, payload: bytes) -> bytes:
    """Return the bytes that are signed: DSSE's PAE("DSSEv1", payload type, payload).

    Args:
        payload_type: Media type of the payload.
        payload: The payload.
    """
    kind = payload_type.encode()
    return b"DSSEv1 %d %b %d %b" % (len(kind), kind, len(payload), payload)


def key_id(key: PublicKey) -> str:
    """Return the SHA-256 of a public key's SubjectPublicKeyInfo in DER, as hexadecimal digits."""
    info = key.public_bytes(
        serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    return sha256_of(info)


def read_private_key(path: Path) -> PrivateKey:
    """Read a private key from a PEM file; `PASSPHRASE` opens an encrypted one.

    Raises:
        UserError: If the file is missing, is not such a key, or the passphrase is missing or wrong.
    """
    passphrase = os.environ.get(PASSPHRASE)
    try:
        key = serialization.load_pem_private_key(
            read_bytes(path, _LARGEST_KEY), passphrase.encode() if passphrase else None
        )
    except TypeError as error:
        if passphrase is None:
            raise UserError(f"{path} is encrypted: put its passphrase into {PASSPHRASE}") from error
        raise UserError(f"{path} is not encrypted: unset {PASSPHRASE}") from error
    except (ValueError, UnsupportedAlgorithm) as error:
        raise UserError(
            f"{path} is not a private key in PEM, or {PASSPHRASE} is not its passphrase"
        ) from error
    return _usable(key, path)


def read_public_key(path: Path) -> PublicKey:
    """Read a public key from a PEM file; `UserError` if it is missing or no such key."""
    try:
        key = serialization.load_pem_public_key(read_bytes(path, _LARGEST_KEY))
    except (ValueError, UnsupportedAlgorithm) as error:
        raise UserError(
            f"{path} is not a public key in PEM: `openssl pkey -in PRIVATE -pubout` writes it"
        ) from error
    return _usable(key, path)


def _usable(key: Any, path: Path) -> Any:
    if isinstance(key, ec.EllipticCurvePrivateKey | ec.EllipticCurvePublicKey):
        usable = isinstance(key.curve, ec.SECP256R1)
    else:
        usable = isinstance(key, Ed25519PrivateKey | Ed25519PublicKey)
    if not usable:
        raise UserError(f"{path} is a key of another kind: use Ed25519 or ECDSA on the curve P-256")
    return key


def signed(statement: bytes, key: PrivateKey, envelope: bytes | None = None) -> bytes:
    """Return an envelope with a statement, the signatures of an earlier envelope, and one more.

    A second signature by the same key replaces the first.

    Args:
        statement: Bytes of the statement.
        key: Key that signs.
        envelope: Earlier envelope. If it holds another statement, its signatures are dropped.

    Raises:
        UserError: If the earlier envelope is damaged, or has too many signatures.
    """
    body = encoded(PAYLOAD_TYPE, statement)
    if isinstance(key, Ed25519PrivateKey):
        signature = key.sign(body)
    else:
        signature = key.sign(body, ec.ECDSA(hashes.SHA256()))  # in DER, as sigstore and TUF
    signer = key_id(key.public_key())
    earlier: list[dict[str, str]] = []
    if envelope is not None:
        payload, earlier = _opened(envelope)
        valid = earlier if payload == statement else []
        earlier = [entry for entry in valid if entry["keyid"] != signer]
    if len(earlier) >= MOST_SIGNATURES:
        raise UserError(f"{SIGNATURES} has {MOST_SIGNATURES} signatures already")
    content = {
        "payload": base64.b64encode(statement).decode(),
        "payloadType": PAYLOAD_TYPE,
        "signatures": [*earlier, {"keyid": signer, "sig": base64.b64encode(signature).decode()}],
    }
    return (json.dumps(content, indent=2) + "\n").encode()


def faults_of_signature(files: Files, key: PublicKey) -> list[str]:
    """Return why a folder is not signed by a key.

    Args:
        files: Content of the folder's files by path.
        key: The public key.

    Returns:
        One line; none if the folder is signed by the key.
    """
    if SIGNATURES not in files:
        return [f"{SIGNATURES} is missing: no one has signed this folder"]
    try:
        payload, signatures = _opened(files[SIGNATURES])
    except UserError as error:
        return [str(error)]
    if payload != files.get(STATEMENT):
        return [f"the signature in {SIGNATURES} is of another statement than {STATEMENT}"]
    # The key's id is a hint that anyone can write: what counts is the signature.
    body = encoded(PAYLOAD_TYPE, payload)
    for entry in signatures:
        try:
            content = _from_base64(entry["sig"])
            if isinstance(key, Ed25519PublicKey):
                key.verify(content, body)
            else:
                key.verify(content, body, ec.ECDSA(hashes.SHA256()))
        except (InvalidSignature, ValueError):
            continue
        return []
    return [f"no signature in {SIGNATURES} is by the key {key_id(key)}"]


def _opened(envelope: bytes) -> tuple[bytes, list[dict[str, str]]]:
    """Return the payload of an envelope, and its signatures with their keys' ids."""
    try:
        content = json.loads(envelope)
        if content["payloadType"] != PAYLOAD_TYPE:
            raise ValueError("payload type")
        signatures = [
            {"keyid": dict(entry).get("keyid", ""), "sig": entry["sig"]}
            for entry in content["signatures"]
        ]
        if not all(isinstance(text, str) for entry in signatures for text in entry.values()):
            raise ValueError("signature")
        payload = _from_base64(content["payload"])
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise UserError(f"{SIGNATURES} is not an envelope of a statement: sign again") from error
    if len(signatures) > MOST_SIGNATURES:
        raise UserError(f"{SIGNATURES} has more than {MOST_SIGNATURES} signatures")
    return payload, signatures


def _from_base64(text: str) -> bytes:
    """Decode base64 in the standard or the URL-safe alphabet; DSSE demands both of a verifier."""
    try:
        return base64.b64decode(text.replace("-", "+").replace("_", "/"), validate=True)
    except (binascii.Error, AttributeError) as error:
        raise ValueError("base64") from error
