"""One look: its share of the error, its commitment in the log, its seed, its verdict."""

from __future__ import annotations

import re
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from socialiq.audit import log as logs
from socialiq.audit import seeds
from socialiq.audit.log import AuditLog, Entry, Subject, now
from socialiq.audit.profile.profile import Profile
from socialiq.audit.seeds import LARGEST_SEED, Commitment, Draw, Nonce, Round
from socialiq.errors import UserError
from socialiq.reading import sha256_of
from socialiq.types import Json

SMALLEST_ERROR = 1e-4
"""Smallest error of a look: at most 200,000 resamples give its quantile (`verdict.judge`)."""


def spend(error: float, look: int) -> float:
    """Return the error of a look, of a wrong pass and of a wrong fail: error / (k (k + 1)) at k.

    1/(k (k + 1)) = 1/k - 1/(k + 1), so the shares of looks 1 to K add up to 1 - 1/(K + 1): never
    more than the whole, however many looks there are. Each look tests episodes whose seed came
    after all results before it, so it keeps its level whatever those were, and whatever decided
    that there is another look. By Boole's inequality the chance that any look of a log passes
    wrongly is therefore at most `error`. This is error spending (Lan and DeMets 1983) with a
    spending function for an unlimited number of looks.

    Args:
        error: Error of the whole log.
        look: Number k of the look, from 1.
    """
    return error / (look * (look + 1))


@dataclass(frozen=True)
class Plan:
    """Everything that decides an audit except its seed; it is fixed by the commitment."""

    commitment: Commitment
    profile: Profile
    episodes: int
    soft: bool  # whether the policy draws its actions
    references: tuple[str, ...]  # hashes of the user's references, in their order

    @property
    def subject(self) -> Subject:
        """Owner and scenario, whose log it belongs to."""
        return Subject.of(self.profile)

    def fields(self) -> Json:
        """Return the plan as fields of a line."""
        return {
            "policy_sha256": self.commitment.policy_sha256,
            "profile_sha256": self.commitment.profile_sha256,
            "confidence": self.profile.confidence,
            "episodes": self.episodes,
            "soft": self.soft,
            "references": list(self.references),
        }


@dataclass(frozen=True)
class Look:
    """A commitment in a log."""

    number: int  # number of the look, from 1
    error: float  # largest chance of a wrong pass at this look, and of a wrong fail
    log: str  # name of the log's file
    before: str  # hash of the log's last line before the commitment
    entry: str  # hash of the commitment's line
    committed: str  # time of the commitment by the clock of the machine, ISO 8601


class Opened(NamedTuple):
    """A seed that is known, and its look; None without a log."""

    drawn: Draw
    look: Look | None


def commit(folder: Path, plan: Plan, source: Json) -> Look:
    """Record a commitment, which counts as a look from now on, whether or not it is continued.

    Args:
        folder: Folder of the log.
        plan: Everything that decides the audit except its seed.
        source: Origin of the seed as fields of the line: `of_nonce` or `of_beacon`.

    Raises:
        UserError: If the log is damaged, can't be written, or has too many looks.
    """
    with logs.locked(folder, plan.subject) as log:
        return _commit(log, plan, source)


def _commit(log: AuditLog, plan: Plan, source: Json) -> Look:
    look = log.looks + 1
    error = spend(plan.profile.error, look)
    if error < SMALLEST_ERROR:
        raise UserError(
            f"look {look} of this log could use an error of {error:.2g} only, which is "
            f"too small to test with (at least {SMALLEST_ERROR:g}): agree with the auditor on a "
            "new log"
        )
    sha256 = source.get("nonce_sha256")
    if sha256 and any(sha256 in path.read_text() for path in log.path.parent.glob("*.jsonl")):
        # It may be known by now; the folder may have the logs of other owners too.
        raise UserError(
            f"{log.path.parent} names this nonce already: ask the auditor for the hash of a new one"
        )
    entry = log.append(logs.COMMITMENT, {**plan.fields(), "seed": dict(source)})
    return _look(log, plan, entry)


def _look(log: AuditLog, plan: Plan, entry: Entry) -> Look:
    look = log.look_of(entry["sha256"])
    error = spend(plan.profile.error, look)
    return Look(look, error, log.path.name, entry["previous"], entry["sha256"], entry["time"])


def of_nonce(sha256: str) -> Json:
    """Return the origin of a nonce's seed, by the nonce's hash; `UserError` if it is none."""
    if not re.fullmatch(r"[0-9a-f]{64}", sha256):
        raise UserError(
            "--nonce-sha256 must be 64 hexadecimal digits in lower case, as `socialiq audit nonce` "
            "prints them"
        )
    return {"source": "auditor's nonce", "nonce_sha256": sha256}


def of_revealed(origin: Nonce | Round) -> Json:
    """Return the origin of a seed as the commitment names it that precedes a nonce or a round."""
    if isinstance(origin, Nonce):
        return of_nonce(origin.sha256)
    return {"source": "beacon", "chain_sha256": seeds.CHAIN, "round": origin.number}


def of_beacon(number: int) -> Json:
    """Return the origin of a seed of a beacon's round; `UserError` if it is published already."""
    time = seeds.time_of(number)
    if time <= now():
        raise UserError(
            f"round {number} of drand {seeds.NETWORK} was published at {time:%Y-%m-%d %H:%M:%S} "
            f"UTC: name one after {seeds.round_after(now())}"
        )
    return {"source": "beacon", "chain_sha256": seeds.CHAIN, "round": number}


def draw(commitment: Commitment, seed: int | None = None) -> Draw:
    """Return the audit's seed: drawn from the operating system's entropy, or the auditor's.

    Args:
        commitment: Commitment, which must precede the draw.
        seed: The auditor's seed; None to draw one from 0 to `LARGEST_SEED`.
    """
    if seed is None:
        return Draw(commitment, secrets.randbelow(LARGEST_SEED + 1), "system entropy")
    return Draw(commitment, seed, "auditor's seed")


def reveal(commitment: Commitment, entry_sha256: str, revealed: Nonce | Round) -> Draw:
    """Derive the seed from a nonce or a beacon's round, and the logged commitment.

    The hash of the commitment's line in the log covers everything that was committed to, and all
    that the log held before, so two commitments never meet the same episodes, even by one nonce or
    round. The seed is the lowest 53 bits of a hash: uniform over all seeds.

    Args:
        commitment: Commitment to policy and declaration.
        entry_sha256: Hash of the commitment's line in the log.
        revealed: The nonce or the round that the commitment names.
    """
    nonce = isinstance(revealed, Nonce)
    secret = revealed.value if nonce else revealed.randomness
    purpose = f"socialiq audit, seed of a {'nonce' if nonce else 'beacon'} 1"
    sha256 = sha256_of(f"{purpose}\n{entry_sha256}\n{secret}\n")
    seed = int(sha256, 16) % (LARGEST_SEED + 1)
    return Draw(commitment, seed, "auditor's nonce" if nonce else "beacon", revealed)


def open_look(folder: Path | None, plan: Plan, origin: int | Nonce | Round | None = None) -> Opened:
    """Commit and learn the seed, or continue the commitment that names the nonce or the round.

    Args:
        folder: Folder of the log; None for an audit without a log.
        plan: Everything that decides the audit except its seed.
        origin: The auditor's seed, which is no look, a revealed nonce or a published round; None
            draws the seed from the system's entropy.

    Raises:
        UserError: If the log is damaged or can't be written, no open commitment of the same plan
            names the nonce or round, or a seed is known before the commitment.
    """
    if folder is None:
        if isinstance(origin, Nonce | Round):
            raise UserError("a nonce or a beacon needs the log of the commitment: name its --log")
        return Opened(draw(plan.commitment, origin), None)
    if isinstance(origin, int):
        raise UserError(
            "a log has only audits whose seed no one knew before: leave out --seed, or --log"
        )
    with logs.locked(folder, plan.subject) as log:
        if isinstance(origin, Nonce | Round):
            entry = _committed(log, plan, origin)
            look = _look(log, plan, entry)
            if isinstance(origin, Nonce):
                origin.reveal_for(look.entry)
            seed_draw = reveal(plan.commitment, look.entry, origin)
        else:
            look = _commit(log, plan, {"source": "system entropy"})
            seed_draw = draw(plan.commitment)
        log.append(logs.SEED, {"commitment": look.entry, "seed": seed_draw.seed})
    return Opened(seed_draw, look)


def _committed(log: AuditLog, plan: Plan, origin: Nonce | Round) -> Entry:
    """Return the open commitment that names a nonce or a round, if it belongs to this plan."""
    naming = [entry for entry in log.commitments if entry["seed"] == of_revealed(origin)]
    if not naming:
        nonce = isinstance(origin, Nonce)
        option = f"--nonce-sha256 {origin.sha256}" if nonce else f"--beacon-round {origin.number}"
        raise UserError(
            f"no commitment in {log.path} names it: the owner runs `socialiq audit commit ... "
            f"{option}` first"
        )
    opened = {entry["commitment"] for entry in log.entries if entry["kind"] == logs.SEED}
    unopened = [entry for entry in naming if entry["sha256"] not in opened]
    if not unopened:
        raise UserError(
            f"the commitment in {log.path} was opened already, and its seed is known: commit again"
        )
    if isinstance(origin, Round) and logs.written_at(unopened[0]) >= origin.time:
        raise UserError(
            f"the commitment in {log.path} was made after round {origin.number} was published: "
            "commit again, to a later round"
        )
    fields = plan.fields()
    for entry in unopened:
        if all(entry[name] == fields[name] for name in fields):
            return entry
    differing = next(name for name in fields if unopened[0][name] != fields[name])
    raise UserError(
        f"the commitment in {log.path} is of another audit: its {_WORDS[differing]} differs; audit "
        "what was committed to, or commit again"
    )


_WORDS = {
    "policy_sha256": "policy",
    "profile_sha256": "declaration",
    "confidence": "confidence",
    "episodes": "number of episodes",
    "soft": "selection of actions (--soft)",
    "references": "list of references",
}


def record(folder: Path, subject: Subject, look: Look, decision: str, report_sha256: str) -> None:
    """Record the decision of a look in its log.

    Args:
        folder: Folder of the log.
        subject: Owner and scenario.
        look: The look.
        decision: Decision as in the report: "pass", "fail" or "inconclusive".
        report_sha256: SHA-256 of the report's `report.json`.

    Raises:
        UserError: If the log is damaged or can't be written.
    """
    with logs.locked(folder, subject) as log:
        outcome = {"decision": decision, "report_sha256": report_sha256}
        log.append(logs.RESULT, {"commitment": look.entry, **outcome})
