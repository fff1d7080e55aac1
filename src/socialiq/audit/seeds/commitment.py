"""The order of commitment: policy and profile are fixed before any seed is drawn."""

from __future__ import annotations

import hashlib
import secrets
from dataclasses import dataclass
from typing import Literal

from socialiq.errors import UserError

LARGEST_SEED = 2**53 - 1
"""Largest seed of an auditor: the largest integer that all JSON readers keep exactly."""

_PURPOSE = "socialiq audit, commitment 1"


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
        lines = (_PURPOSE, self.policy_sha256, self.profile_sha256)
        return hashlib.sha256("".join(f"{line}\n" for line in lines).encode()).hexdigest()


@dataclass(frozen=True)
class Draw:
    """Seed that was drawn after a commitment.

    Attributes:
        commitment: Commitment before the draw.
        seed: Seed of the whole audit.
        chosen_by: Source of the seed.
    """

    commitment: Commitment
    seed: int
    chosen_by: Literal["operating system", "auditor"]

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
        return Draw(commitment, secrets.randbelow(LARGEST_SEED + 1), "operating system")
    check_seed(seed)
    return Draw(commitment, seed, "auditor")


def check_seed(seed: int) -> None:
    """Check the range of a seed.

    Raises:
        UserError: If it is out of range.
    """
    if not 0 <= seed <= LARGEST_SEED:
        raise UserError(f"seed must be from 0 to {LARGEST_SEED}, got {seed}")
