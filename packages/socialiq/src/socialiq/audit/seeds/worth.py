"""Worth of each source of seeds: who could have chosen the episodes, in one or two sentences."""

from __future__ import annotations

from socialiq.audit.seeds.beacon import NETWORK, Round
from socialiq.audit.seeds.commitment import Draw, Source

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
