"""A public beacon: rounds of drand's network quicknet, their times and their signatures.

The League of Entropy publishes one round every three seconds. A round's signature is a threshold
BLS signature of its number alone: it is unique, no one knows it before, and anyone can check it
with the network's public key. Nothing here uses the network: the user fetches the round.

Source: drand's specification (https://docs.drand.love) and the announcement of quicknet (16 October
2023), with the scheme bls-unchained-g1-rfc9380: signatures in G1 by RFC 9380, keys in G2.
"""

from __future__ import annotations

import datetime
import hashlib
import math
import re
from dataclasses import dataclass
from pathlib import Path

from socialiq.errors import UserError
from socialiq.foreign import optional
from socialiq.storage import read_small_json

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

_HEX = re.compile(r"[0-9a-f]{96}")  # a compressed point of G1: 48 bytes


def chain_sha256() -> str:
    """Return drand's hash of a chain's parameters: period, genesis, key, group, name."""
    content = PERIOD.to_bytes(4) + GENESIS.to_bytes(8) + PUBLIC_KEY
    return hashlib.sha256(content + bytes.fromhex(GROUP_SHA256) + NETWORK.encode()).hexdigest()


def time_of(number: int) -> datetime.datetime:
    """Return the time at which a round is published: genesis + (number - 1) periods.

    Args:
        number: Number of the round, from 1.

    Raises:
        UserError: If it is out of range.
    """
    if not 1 <= number <= LARGEST_ROUND:
        raise UserError(f"a beacon's round must be from 1 to {LARGEST_ROUND}, got {number}")
    return datetime.datetime.fromtimestamp(GENESIS + (number - 1) * PERIOD, datetime.UTC)


def round_after(time: datetime.datetime) -> int:
    """Return the first round that is published after a time.

    Args:
        time: With its time zone.
    """
    return max(1, math.floor((time.timestamp() - GENESIS) / PERIOD) + 2)


def address_of(number: int) -> str:
    """Return the address from which a round can be fetched once it is published."""
    return f"https://api.drand.sh/{CHAIN}/public/{number}"


@dataclass(frozen=True)
class Round:
    """A published round.

    Attributes:
        number: Its number.
        signature: Compressed point of G1, 96 hexadecimal digits.
    """

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
    """Read a round as drand's relays give it, and check its signature.

    Args:
        path: JSON with "round", "signature" and, if present, "randomness".

    Raises:
        UserError: If it is something else, the signature is not the network's, or the library
            that checks it is not installed.
    """
    found = read_small_json(path)
    fields = found if isinstance(found, dict) else {}
    number, signature = fields.get("round"), fields.get("signature")
    if type(number) is not int or not isinstance(signature, str) or not _HEX.fullmatch(signature):
        raise UserError(
            f"{path} is not a round of drand's {NETWORK}: fetch {address_of(1)[:-1]}ROUND"
        )
    time_of(number)
    one = Round(number, signature)
    if fields.get("randomness", one.randomness) != one.randomness or not one.is_genuine():
        raise UserError(
            f"{path} was not signed by drand's {NETWORK}: fetch {address_of(number)} again"
        )
    return one
