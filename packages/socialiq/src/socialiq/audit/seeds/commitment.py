"""The order of commitment: policy and profile are fixed before any seed is known."""

from __future__ import annotations

import hashlib
import secrets
from dataclasses import dataclass
from typing import Literal

from socialiq.audit.seeds.beacon import Round
from socialiq.audit.seeds.nonce import Nonce
from socialiq.errors import UserError

LARGEST_SEED = 2**53 - 1
"""Largest seed of an auditor: the largest integer that all JSON readers keep exactly."""

_PURPOSE = "socialiq audit, commitment 1"

Source = Literal["system entropy", "auditor's seed", "auditor's nonce", "beacon"]
"""Origin of a seed."""


@dataclass(frozen=True)
class Commitment:
    """Policy and declaration of an audit, fixed by two hashes.

    Attributes:
        policy_sha256: SHA-256 of the policy, from its record.
        profile_sha256: SHA-256 of the declaration's bytes.
    """

    policy_sha256: str
    profile_sha256: str

    @property
    def sha256(self) -> str:
        """SHA-256 of three lines: the purpose, the policy's hash, the profile's."""
        return _sha256_of_lines(_PURPOSE, self.policy_sha256, self.profile_sha256)


@dataclass(frozen=True)
class Draw:
    """Seed that became known after a commitment.

    Attributes:
        commitment: Commitment before the draw.
        seed: Seed of the whole audit.
        source: Origin of the seed.
        revealed: What the seed was derived from, if from a nonce or a beacon.
    """

    commitment: Commitment
    seed: int
    source: Source
    revealed: Nonce | Round | None = None

    def derived(self, purpose: str) -> int:
        """Return a number of 256 bits for one purpose, from seed and commitment.

        Tuning a policy to the episodes of a seed changes its hash, and so its commitment and
        episodes.
        """
        text = f"{self.commitment.sha256}\n{self.seed}\n{purpose}\n"
        return int.from_bytes(hashlib.sha256(text.encode()).digest())


def draw(commitment: Commitment, seed: int | None = None) -> Draw:
    """Draw the audit's seed, or take the auditor's.

    Args:
        commitment: Commitment, which must precede the draw.
        seed: The auditor's choice; None draws from the operating system's entropy.

    Raises:
        UserError: If the seed is out of range.
    """
    if seed is None:
        return Draw(commitment, secrets.randbelow(LARGEST_SEED + 1), "system entropy")
    check_seed(seed)
    return Draw(commitment, seed, "auditor's seed")


def reveal(commitment: Commitment, entry_sha256: str, revealed: Nonce | Round) -> Draw:
    """Derive the seed from a nonce or a beacon's round, and the logged commitment.

    The entry's hash covers everything that was committed to, and all that the log held before, so
    two commitments never meet the same episodes, even by one nonce or round.

    Args:
        commitment: Policy and declaration.
        entry_sha256: Hash of the commitment's line in the log.
        revealed: The nonce or round that the line names.
    """
    if isinstance(revealed, Nonce):
        seed = _derived_seed("nonce", entry_sha256, revealed.value)
        return Draw(commitment, seed, "auditor's nonce", revealed)
    seed = _derived_seed("beacon", entry_sha256, revealed.randomness)
    return Draw(commitment, seed, "beacon", revealed)


def check_seed(seed: int) -> None:
    """Check the range of a seed.

    Raises:
        UserError: If it is out of range.
    """
    if not 0 <= seed <= LARGEST_SEED:
        raise UserError(f"seed must be from 0 to {LARGEST_SEED}, got {seed}")


def _derived_seed(kind: str, entry_sha256: str, secret: str) -> int:
    """Return the lowest 53 bits of a hash: uniform over all seeds."""
    lines = _sha256_of_lines(f"socialiq audit, seed of a {kind} 1", entry_sha256, secret)
    return int(lines, 16) % (LARGEST_SEED + 1)


def _sha256_of_lines(*lines: str) -> str:
    return hashlib.sha256("".join(f"{line}\n" for line in lines).encode()).hexdigest()
