"""Seeds: the auditor's nonce, a beacon's round, the draw after a commitment, those of episodes."""

from __future__ import annotations

import datetime
import hashlib
import json
import math
import os
import re
import secrets
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Int64

from socialiq.errors import UserError
from socialiq.foreign import optional
from socialiq.reading import sha256_of
from socialiq.storage import read_json, write_atomically

_SHA256 = re.compile(r"[0-9a-f]{64}")
_LARGEST = 64 * 1024  # bytes of a file


@dataclass(frozen=True)
class Nonce:
    """A secret of 256 bits, as 64 hexadecimal digits, and the auditor's file that holds it."""

    value: str
    file: Path | None = field(default=None, compare=False)

    @property
    def sha256(self) -> str:
        """SHA-256 of the secret's 32 bytes: what the owner is told."""
        return sha256_of(bytes.fromhex(self.value))

    def reveal_for(self, entry: str) -> None:
        """Note in its file the hash of the commitment that it is revealed for, before it is used.

        A report publishes the nonce, so that any later commitment can be made with its knowledge.

        Raises:
            UserError: If it was revealed for another commitment, or the file can't be written.
        """
        if self.file is None:
            return
        if self.commitment not in (None, entry):
            raise UserError(
                f"{self.file} was revealed for another commitment, and may be known: draw a new "
                "one with `socialiq audit nonce`"
            )
        text = json.dumps({"nonce": self.value, "commitment": entry}) + "\n"
        write_atomically(self.file, text.encode())
        self.file.chmod(0o600)

    @property
    def commitment(self) -> str | None:
        """Hash of the commitment that the file says it was revealed for."""
        return None if self.file is None else read_json(self.file, _LARGEST).get("commitment")


def write_nonce(path: Path) -> Nonce:
    """Draw a nonce into a new file that only its user can read; `UserError` if there is one."""
    nonce = Nonce(secrets.token_hex(32))
    created = False
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
    """Read a file of `write_nonce`; `UserError` if it is missing or something else."""
    content = read_json(path, _LARGEST)
    value = content.get("nonce") if isinstance(content, dict) else None
    if not isinstance(value, str) or not _SHA256.fullmatch(value):
        raise UserError(f"{path} has no nonce: `socialiq audit nonce --out FILE` writes one")
    return Nonce(value, path)


CHAIN = "52db9ba70e0cc0f6eaf7803dd07447a1f5477735fd3f661792ba94600c84e971"
"""Hash of quicknet's parameters, by which drand's addresses name it (`chain_sha256`)."""

PERIOD = 3  # seconds between rounds
GENESIS = 1692803367  # time of round 1, in seconds since 1970

PUBLIC_KEY = bytes.fromhex(
    "83cf0f2896adee7eb8b5f01fcad3912212c437e0073e911fb90022d3e760183c"
    "8c4b450b6a0a6c3ac6a5776a2d1064510d1fec758c921cc22b0e17e63aaf4bcb"
    "5ed66304de9cf809bd274ca73bab4af5a6e9c76a4bc09e76eae8991ef5ece45a"
)
"""Compressed point of G2."""

GROUP_SHA256 = "f477d5c89f21a17c863a7f937c6a6d15859414d2be09cd448d4279af331c5d3e"
NETWORK = "quicknet"
LARGEST_ROUND = 80_000_000_000  # largest number of a round that is accepted, of the year 9629
_DOMAIN = b"BLS_SIG_BLS12381G1_XMD:SHA-256_SSWU_RO_NUL_"
_SIGNATURE = re.compile(r"[0-9a-f]{96}")  # a compressed point of G1: 48 bytes


def chain_sha256() -> str:
    """Return drand's hash of a chain's parameters: period, genesis, key, group, name."""
    content = PERIOD.to_bytes(4) + GENESIS.to_bytes(8) + PUBLIC_KEY
    return sha256_of(content + bytes.fromhex(GROUP_SHA256) + NETWORK.encode())


def time_of(number: int) -> datetime.datetime:
    """Return the time of a round: genesis + (number - 1) periods; `UserError` out of range."""
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
        return sha256_of(bytes.fromhex(self.signature))

    @property
    def time(self) -> datetime.datetime:
        """Time of publication."""
        return time_of(self.number)

    def is_genuine(self) -> bool:
        """Whether the network signed this round: e(signature, g2) = e(H(number), key)."""
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
    """Read a round as drand's relays give it, in JSON; `UserError` unless the network signed it."""
    content = read_json(path, _LARGEST)
    fields = content if isinstance(content, dict) else {}
    number = fields.get("round")
    signature = fields.get("signature")
    is_text = isinstance(signature, str)
    if type(number) is not int or not is_text or not _SIGNATURE.fullmatch(signature):
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


def origin_of(
    seed: int | None, nonce: Path | None, beacon: Path | None
) -> int | Nonce | Round | None:
    """Return the auditor's seed, or the nonce or the round of a file; None draws the seed.

    Raises:
        UserError: If there are several, or a file can't be read or is something else.
    """
    if sum(origin is not None for origin in (seed, nonce, beacon)) > 1:
        raise UserError("an audit has one seed: give one of --seed, --nonce and --beacon")
    if nonce is not None:
        return read_nonce(nonce)
    return seed if beacon is None else read_round(beacon)


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
        text = f"{_PURPOSE}\n{self.policy_sha256}\n{self.profile_sha256}\n"
        return sha256_of(text)


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


_AUDIT = 7212  # makes these draws independent of other draws from the same seed
FEWEST_EPISODES = 20  # with fewer, no bound of the audit is informative
MOST_EPISODES = 1_000_000


def episode_seeds(seed: int, episodes: int) -> Int64[np.ndarray, " episode"]:
    """Draw the seeds of the episodes from the whole range of seeds, by the auditor's seed.

    They are not 0, 1, 2, ..., to which a policy might have been tuned.

    Raises:
        UserError: If the seed is negative, or the number of episodes is out of range.
    """
    if seed < 0:
        raise UserError(f"seed must be at least 0, got {seed}")
    check_episodes(episodes)
    rng = np.random.default_rng([_AUDIT, seed])
    seeds = np.unique(rng.integers(2**62, size=episodes + 16))  # 16 more, in case of repeats
    return rng.permutation(seeds)[:episodes]


def check_episodes(episodes: int) -> None:
    """Check the number of episodes of an audit; `UserError` if it is out of range."""
    if not FEWEST_EPISODES <= episodes <= MOST_EPISODES:
        raise UserError(
            f"episodes must be from {FEWEST_EPISODES} to {MOST_EPISODES}, got {episodes}"
        )
