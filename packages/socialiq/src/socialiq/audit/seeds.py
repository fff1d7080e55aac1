"""Seeds that come after the commitment: nonce, beacon, commitment, worth of each source."""

from __future__ import annotations

import datetime
import hashlib
import json
import math
import os
import re
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from socialiq.errors import UserError
from socialiq.foreign import optional
from socialiq.storage import read_small_json

_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Nonce:
    """A secret of 256 bits, as 64 hexadecimal digits."""

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
    nonce, created = Nonce(secrets.token_hex(32)), False
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        created = True
        with os.fdopen(handle, "w") as file:
            file.write(json.dumps({"nonce": nonce.value}) + "\n")
    except FileExistsError as error:
        raise UserError(f"{path} exists already: a nonce is used once; name a new file") from error
    except OSError as error:
        if created:
            path.unlink(missing_ok=True)
        raise UserError(f"cannot write {path}: {error.strerror}; choose another place") from error
    return nonce


def read_nonce(path: Path) -> Nonce:
    """Read a file of `write_nonce`.

    Raises:
        UserError: If it is missing or something else.
    """
    content = read_small_json(path)
    value = content.get("nonce") if isinstance(content, dict) else None
    if not isinstance(value, str) or not _SHA256.fullmatch(value):
        raise UserError(f"{path} has no nonce: `socialiq audit nonce --out FILE` writes one")
    return Nonce(value)


CHAIN = "52db9ba70e0cc0f6eaf7803dd07447a1f5477735fd3f661792ba94600c84e971"
"""Hash of quicknet's parameters, by which drand's addresses name it (`chain_sha256`)."""

PERIOD, GENESIS = 3, 1692803367
"""Seconds between rounds; time of round 1, in seconds since 1970."""

PUBLIC_KEY = bytes.fromhex(
    "83cf0f2896adee7eb8b5f01fcad3912212c437e0073e911fb90022d3e760183c"
    "8c4b450b6a0a6c3ac6a5776a2d1064510d1fec758c921cc22b0e17e63aaf4bcb"
    "5ed66304de9cf809bd274ca73bab4af5a6e9c76a4bc09e76eae8991ef5ece45a"
)
"""Compressed point of G2."""

GROUP_SHA256 = "f477d5c89f21a17c863a7f937c6a6d15859414d2be09cd448d4279af331c5d3e"

NETWORK = "quicknet"

LARGEST_ROUND = 80_000_000_000
"""Largest number of a round that is accepted, of the year 9629."""

_DOMAIN = b"BLS_SIG_BLS12381G1_XMD:SHA-256_SSWU_RO_NUL_"

_SIGNATURE = re.compile(r"[0-9a-f]{96}")  # a compressed point of G1: 48 bytes


def chain_sha256() -> str:
    """Return drand's hash of a chain's parameters: period, genesis, key, group, name."""
    content = PERIOD.to_bytes(4) + GENESIS.to_bytes(8) + PUBLIC_KEY
    return hashlib.sha256(content + bytes.fromhex(GROUP_SHA256) + NETWORK.encode()).hexdigest()


def time_of(number: int) -> datetime.datetime:
    """Return the time at which a round is published: genesis + (number - 1) periods.

    Raises:
        UserError: If the number, from 1, is out of range.
    """
    if not 1 <= number <= LARGEST_ROUND:
        raise UserError(f"a beacon's round must be from 1 to {LARGEST_ROUND}, got {number}")
    return datetime.datetime.fromtimestamp(GENESIS + (number - 1) * PERIOD, datetime.UTC)


def round_after(time: datetime.datetime) -> int:
    """Return the first round that is published after a time with its time zone."""
    return max(1, math.floor((time.timestamp() - GENESIS) / PERIOD) + 2)


def address_of(number: int) -> str:
    """Return the address from which a round can be fetched once it is published."""
    return f"https://api.drand.sh/{CHAIN}/public/{number}"


@dataclass(frozen=True)
class Round:
    """A published round: its number, and its signature, a compressed point of G1 (96 digits)."""

    number: int
    signature: str

    @property
    def randomness(self) -> str:
        """SHA-256 of the signature."""
        return hashlib.sha256(bytes.fromhex(self.signature)).hexdigest()

    @property
    def time(self) -> datetime.datetime:
        """Time of publication."""
        return time_of(self.number)

    def is_genuine(self) -> bool:
        """Whether the network signed this round: e(signature, g2) = e(H(number), key).

        Raises:
            UserError: If the library is not installed.
        """
        bls = optional("py_arkworks_bls12381", "beacon", "a beacon's signature")
        message = hashlib.sha256(self.number.to_bytes(8)).digest()
        try:  # reading a point checks that it lies on the curve and in the subgroup
            signature = bls.G1Point.from_compressed_bytes(bytes.fromhex(self.signature))
        except ValueError:
            return False
        key = bls.G2Point.from_compressed_bytes(PUBLIC_KEY)
        point = bls.G1Point.hash_to_curve(message, _DOMAIN)
        return bls.GT.pairing_check([signature, -point], [bls.G2Point(), key])


def read_round(path: Path) -> Round:
    """Read a round as drand's relays give it, in JSON, and check its signature.

    Raises:
        UserError: If it is something else, the signature is not the network's, or the library
            that checks it is not installed.
    """
    content = read_small_json(path)
    fields = content if isinstance(content, dict) else {}
    number, signature = fields.get("round"), fields.get("signature")
    if (
        type(number) is not int
        or not isinstance(signature, str)
        or not _SIGNATURE.fullmatch(signature)
    ):
        raise UserError(
            f"{path} is not a round of drand's {NETWORK}: fetch {address_of(1)[:-1]}ROUND"
        )
    time_of(number)
    beacon = Round(number, signature)
    if fields.get("randomness", beacon.randomness) != beacon.randomness or not beacon.is_genuine():
        raise UserError(
            f"{path} was not signed by drand's {NETWORK}: fetch {address_of(number)} again"
        )
    return beacon


LARGEST_SEED = 2**53 - 1
"""Largest seed of an auditor: the largest integer that all JSON readers keep exactly."""

_PURPOSE = "socialiq audit, commitment 1"

Source = Literal["system entropy", "auditor's seed", "auditor's nonce", "beacon"]
"""Origin of a seed."""


@dataclass(frozen=True)
class Commitment:
    """Policy and declaration of an audit, fixed by the hashes of its record and of its bytes."""

    policy_sha256: str
    profile_sha256: str

    @property
    def sha256(self) -> str:
        """SHA-256 of three lines: the purpose, the policy's hash, the profile's."""
        return _sha256_of_lines(_PURPOSE, self.policy_sha256, self.profile_sha256)


@dataclass(frozen=True)
class Draw:
    """Seed that became known after a commitment."""

    commitment: Commitment  # before the draw
    seed: int  # of the whole audit
    source: Source
    revealed: Nonce | Round | None = None  # what it was derived from, if anything

    def derived(self, purpose: str) -> int:
        """Return a number of 256 bits for one purpose, from seed and commitment.

        Tuning a policy to the episodes of a seed changes its hash, and so its commitment and
        episodes.
        """
        text = f"{self.commitment.sha256}\n{self.seed}\n{purpose}\n"
        return int.from_bytes(hashlib.sha256(text.encode()).digest())


def draw(commitment: Commitment, seed: int | None = None) -> Draw:
    """Draw the audit's seed from the operating system's entropy, or take the auditor's.

    The commitment must precede the draw.

    Raises:
        UserError: If the seed is out of range.
    """
    if seed is None:
        return Draw(commitment, secrets.randbelow(LARGEST_SEED + 1), "system entropy")
    check_seed(seed)
    return Draw(commitment, seed, "auditor's seed")


def reveal(commitment: Commitment, entry_sha256: str, revealed: Nonce | Round) -> Draw:
    """Derive the seed from a nonce or a beacon's round, and the logged commitment.

    The hash of the commitment's line in the log covers everything that was committed to, and all
    that the log held before, so two commitments never meet the same episodes, even by one nonce or
    round. The seed is the lowest 53 bits of a hash: uniform over all seeds.
    """
    nonce = isinstance(revealed, Nonce)
    purpose = f"socialiq audit, seed of a {'nonce' if nonce else 'beacon'} 1"
    secret = revealed.value if nonce else revealed.randomness
    seed = int(_sha256_of_lines(purpose, entry_sha256, secret), 16) % (LARGEST_SEED + 1)
    return Draw(commitment, seed, "auditor's nonce" if nonce else "beacon", revealed)


def check_seed(seed: int) -> None:
    """Check the range of a seed.

    Raises:
        UserError: If it is out of range.
    """
    if not 0 <= seed <= LARGEST_SEED:
        raise UserError(f"seed must be from 0 to {LARGEST_SEED}, got {seed}")


def _sha256_of_lines(*lines: str) -> str:
    return hashlib.sha256("".join(f"{line}\n" for line in lines).encode()).hexdigest()


_WORTH: dict[Source, str] = {
    "system entropy": (
        "The seed was drawn by the computer that ran the audit. This is self-attested: "
        "those who ran it could have drawn again."
    ),
    "auditor's seed": (
        "The seed was given in advance. An owner who knew it before the commitment can have "
        "searched for a policy or a declaration that passes on its episodes."
    ),
    "auditor's nonce": (
        "The seed comes from the commitment and a nonce of the auditor, whose hash the commitment "
        "names. Neither owner nor auditor could choose it alone, provided that the auditor "
        "revealed the nonce only after the commitment's hash was in the auditor's hands."
    ),
}


def worth(drawn: Draw) -> str:
    """Return what a seed is worth as evidence that no one chose the episodes."""
    if isinstance(drawn.revealed, Round):
        return (
            f"The seed comes from the commitment and round {drawn.revealed.number:,} of the public "
            f"beacon drand {NETWORK}, whose signature was checked. No one could choose it, "
            "provided that someone other than the owner held the commitment's hash before "
            f"{drawn.revealed.time:%Y-%m-%d %H:%M:%S} UTC, when the round was published."
        )
    return _WORTH[drawn.source]
