"""`audit nonce` and `audit commit`: seeds that neither owner nor auditor can choose."""

from __future__ import annotations

import datetime
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.audit.conduct import commit_to
from socialiq.audit.log import now
from socialiq.audit.look import of_beacon, of_nonce
from socialiq.audit.request import Request
from socialiq.audit.seeds import address_of, round_after, time_of, write_nonce
from socialiq.cli.code_options import CodeOptions
from socialiq.cli.output import Printing, print_json, say
from socialiq.errors import UserError

_AHEAD = datetime.timedelta(minutes=10)  # of the round that is named by default


@dataclass(frozen=True)
class WriteNonce:
    """Draw the auditor's nonce, and print the hash for the owner.

    Keep the file to yourself until you have the hash of the owner's commitment. Use it once.

    Example: socialiq audit nonce --out nonce.json
    """

    out: Path
    """File to write; only you can read it."""

    def run(self) -> int:
        """Write the nonce, print its SHA-256."""
        sys.stdout.write(f"{write_nonce(self.out).sha256}\n")
        return 0


@dataclass(frozen=True)
class Commit(Printing):
    """Commit to a policy and a declaration in the audit log, before their episodes can be known.

    The seed comes later: from the auditor's nonce, whose hash is named here, or from a round of the
    public beacon drand that is not yet published. The printed hash of the commitment belongs in
    the auditor's hands before that. Every commitment counts as a look.

    Example: socialiq audit commit atlas:prosocial --profile profile.toml --beacon-round 34200000
    """

    policy: Annotated[str, tyro.conf.Positional]
    """The policy under audit."""
    profile: Path
    """The declaration: `socialiq profile new` writes one."""
    nonce_sha256: str = ""
    """Hash of the auditor's nonce, as `socialiq audit nonce` printed it."""
    beacon_round: int | None = None
    """A round of drand's quicknet that is not yet published; without a nonce, by default the first
    in ten minutes."""
    log: Path = Path("audit-log")
    """Folder of the audit log."""
    episodes: int = 1000
    """Number of episodes of the audit."""
    reference: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """A further driver to compare with, as for `socialiq audit`."""
    soft: bool = False
    """Select the policy's actions stochastically instead of greedily."""
    code: tyro.conf.OmitArgPrefixes[CodeOptions] = field(default_factory=CodeOptions)

    def run(self) -> int:
        """Commit, and print the hash and what comes next."""
        source = self._source()
        look = commit_to(self.request(), source)
        if self.json:
            print_json({"look": look.number, "log": look.log, "entry": look.entry, **source})
            return 0
        sys.stdout.write(f"{look.entry}\n")
        say(f"look {look.number} of {self.log / look.log}, committed at {look.committed}")
        number = source.get("round")
        if number is None:
            say("give this hash to the auditor, who then audits with --nonce")
        else:
            when = f"{time_of(number):%Y-%m-%d %H:%M:%S} UTC"
            say(f"give this hash to the auditor before round {number} is published, {when}")
            say(f"then fetch {address_of(number)} and audit with --beacon")
        return 0

    def _source(self) -> Mapping[str, Any]:
        """Return the origin of the seed."""
        if self.nonce_sha256 and self.beacon_round is not None:
            raise UserError("an audit has one seed: give --nonce-sha256 or --beacon-round")
        if self.nonce_sha256:
            return of_nonce(self.nonce_sha256)
        number = self.beacon_round
        return of_beacon(round_after(now() + _AHEAD) if number is None else number)

    def request(self) -> Request:
        """Return the request of the later audit."""
        return Request(
            policy=self.policy,
            profile=self.profile,
            episodes=self.episodes,
            references=tuple(self.reference),
            soft=self.soft,
            trust=self.code.trust,
            log=self.log,
        )
