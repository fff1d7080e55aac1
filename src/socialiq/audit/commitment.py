"""The order of commitment: policy and profile are fixed before any seed is drawn."""

from __future__ import annotations

import hashlib
import secrets
from dataclasses import dataclass
from typing import Literal

from socialiq.errors import UserError

LARGEST_SEED = 2**53 - 1
"""Of the auditor: the largest whole number that every reader of JSON keeps exactly."""

_PURPOSE = "socialiq audit, commitment 1"


@dataclass(frozen=True)
class Commitment:
    """Policy and declaration of an audit, fixed by two hashes.

    Attributes:
        policy_sha256: Of the policy, as its record says.
        profile_sha256: Of the declaration's bytes.
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
    """A seed that was drawn after a commitment was made.

    Attributes:
        commitment: What was fixed before.
        seed: Of the whole audit.
        chosen_by: Who gave it.
    """

    commitment: Commitment
    seed: int
    chosen_by: Literal["operating system", "auditor"]

    def derived(self, purpose: str) -> int:
        """A number of 256 bits for one purpose, from seed and commitment together.

        A policy that was tuned to the episodes of a seed is another policy, so it has another
        commitment, and this seed gives it other episodes.
        """
        text = f"{self.commitment.sha256}\n{self.seed}\n{purpose}\n"
        return int.from_bytes(hashlib.sha256(text.encode()).digest())


def draw(commitment: Commitment, seed: int | None = None) -> Draw:
    """Draw the audit's seed, or take the auditor's.

    Args:
        commitment: Must exist: that is why it is asked for.
        seed: The auditor's choice; None draws from the operating system's entropy.

    Raises:
        UserError: If the seed is out of range.
    """
    if seed is None:
        return Draw(commitment, secrets.randbelow(LARGEST_SEED + 1), "operating system")
    check_seed(seed)
    return Draw(commitment, seed, "auditor")


def check_seed(seed: int) -> None:
    """Refuse a seed that is out of range.

    Raises:
        UserError: If it is.
    """
    if not 0 <= seed <= LARGEST_SEED:
        raise UserError(f"seed must be from 0 to {LARGEST_SEED}, got {seed}")
