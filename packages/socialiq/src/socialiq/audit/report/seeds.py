"""Sections `seeds` and `look` of the report, and the way back from them."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from typing import Any

from socialiq.audit.looks.look import Look, Opened, spend
from socialiq.audit.report.folder import REPORT
from socialiq.audit.seeds import CHAIN, Commitment, Draw, Nonce, Round, reveal, worth
from socialiq.audit.verdict.verdict import whole_error
from socialiq.to_json import to_json

_ORDER = (
    "Policy and declaration were read and hashed first. Only then was the seed drawn or "
    "accepted. Seeds of episodes come from the seed and both hashes together."
)


def seeds_of(drawn: Draw, episodes: int) -> dict[str, Any]:
    """Return the section `seeds`.

    Args:
        drawn: Commitment and seed.
        episodes: Number of episodes.
    """
    revealed, beacon = drawn.revealed, None
    if isinstance(revealed, Round):
        beacon = {
            "chain_sha256": CHAIN,
            "round": revealed.number,
            "time": revealed.time.isoformat(),
            "signature": revealed.signature,
            "randomness": revealed.randomness,
        }
    return {
        "seed": drawn.seed,
        "source": drawn.source,
        "worth": worth(drawn),
        "nonce": revealed if isinstance(revealed, Nonce) else None,
        "beacon": beacon,
        "episodes": episodes,
        "commitment_sha256": drawn.commitment.sha256,
        "order": _ORDER,
    }


def opened_of(report: Mapping[str, Any]) -> Opened:
    """Return the seed and the look of a report.

    Args:
        report: Content of `report.json`.
    """
    seeds, hashes = report["seeds"], report["hashes"]
    revealed = None
    if seeds["nonce"] is not None:
        revealed = Nonce(seeds["nonce"]["value"])
    elif seeds["beacon"] is not None:
        revealed = Round(seeds["beacon"]["round"], seeds["beacon"]["signature"])
    commitment = Commitment(hashes["policy"], hashes["profile"])
    look = None if report["look"] is None else Look(**report["look"])
    return Opened(Draw(commitment, seeds["seed"], seeds["source"], revealed), look)


def faults_of_seeds(report: Mapping[str, Any]) -> list[str]:
    """Return the contradictions of a report about commitment, seed and look.

    Args:
        report: Content of `report.json`, by its schema.

    Raises:
        UserError: If the seed is a beacon's, and the library that checks signatures is missing.
    """
    draw, look = opened_of(report)
    faults, whole = [], whole_error(report["declaration"]["confidence"])
    if look is not None:
        spent = spend(whole, look.number)
        if look.error != spent.error:
            faults.append(f"{REPORT}: the error of look {look.number} is not its share")
    if report["verdict"]["error"] != (whole if look is None else look.error):
        faults.append(f"{REPORT}: the error of the verdict is not that of the look")
    if draw.revealed is not None:
        faults += _of_revealed(draw, look)
    elif draw.source not in ("system entropy", "auditor's seed"):
        faults.append(f"{REPORT}: there is no {draw.source}")
    elif draw.source == "auditor's seed" and look is not None:
        faults.append(f"{REPORT}: a log takes no audit whose seed was known before")
    if not faults and to_json(seeds_of(draw, report["seeds"]["episodes"])) != report["seeds"]:
        faults.append(f"{REPORT}: its statements about the seed are not those of its source")
    return faults


def _of_revealed(draw: Draw, look: Look | None) -> list[str]:
    """Derive the seed again from the nonce or the beacon's round."""
    assert draw.revealed is not None
    if look is None:
        return [f"{REPORT}: a seed of the {draw.source} needs a log"]
    faults = []
    if reveal(draw.commitment, look.entry, draw.revealed) != draw:
        faults.append(f"{REPORT}: the seed does not follow from commitment and {draw.source}")
    if isinstance(draw.revealed, Round):
        if not draw.revealed.is_genuine():
            faults.append(f"{REPORT}: the beacon did not sign this round")
        try:
            before = datetime.datetime.fromisoformat(look.committed) < draw.revealed.time
        except ValueError:  # the schema allows a 31 February
            before = False
        if not before:
            faults.append(f"{REPORT}: the round was published before the commitment")
    return faults
