"""Fields of a report that no check confirms, not even a rerun: the auditor claims them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from socialiq.audit.looks.look import Look
from socialiq.audit.seeds.commitment import Draw

ALWAYS = (
    "timing",
    "command",
    "machine",
    "versions",
    "hashes.package",
    "reference_files",
    "policy.record.source",
)
"""Claims of every report, as paths in `report.json`."""

OF_CODE = (
    "policy.record.isolation",
    "policy.record.start",
    "policy.record.step",
    "policy.record.memory",
)
"""Claims about a policy that is its owner's code: its isolation, limits of its time and memory."""


OF_A_LOG = "look"
"""Claim of an audit with a log; `audit verify --log` holds it against the log itself."""


def claims_of_auditor(policy: Mapping[str, Any], drawn: Draw, look: Look | None) -> list[str]:
    """Return the paths of the claims in a report.

    A signature of the statement covers them: then it is known whose claims they are.

    Args:
        policy: The policy's record as JSON.
        drawn: Commitment and seed. That a seed is derived from a nonce or a beacon can be checked.
        look: The look; None without a log.
    """
    code = policy["kind"] in ("process", "python")
    own = [path for path in OF_CODE if code and path.rpartition(".")[2] in policy]
    seed = ["seeds.source"] if drawn.revealed is None else []
    return [*ALWAYS, *own, *seed, *([OF_A_LOG] if look else [])]
