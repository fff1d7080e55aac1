"""Request of an audit, and the command that repeats it."""

from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path

from socialiq.audit.evidence.outcomes import check_episodes
from socialiq.audit.resolve_policy import Trust, is_code
from socialiq.audit.seeds.beacon import Round, read_round
from socialiq.audit.seeds.commitment import check_seed
from socialiq.audit.seeds.nonce import Nonce, read_nonce
from socialiq.errors import UserError
from socialiq.policies.process import GIB, Limits


@dataclasses.dataclass(frozen=True)
class Request:
    """Request of an audit.

    Attributes:
        policy: A specification as for `resolve_policy`.
        profile: File of the declaration.
        episodes: Number of episodes of every driver.
        seed: The auditor's seed, or None to draw it.
        references: Further drivers to compare with: files, or "python:MODULE:ATTRIBUTE".
        soft: Whether the policy draws its actions.
        trust: Permissions of the policy.
        threads: Number of threads of the intersection.
        films: Whether to draw six episodes.
        shift: Whether to run the policy in other traffic too.
        log: Folder of the audit log; None keeps none.
        nonce: File of the auditor's nonce, which a commitment in the log names.
        beacon: File of a beacon's round, which a commitment in the log names.
        in_parts: Whether the episodes are run in parts, by several processes.
    """

    policy: str
    profile: Path
    episodes: int
    seed: int | None = None
    references: tuple[str, ...] = ()
    soft: bool = False
    trust: Trust = dataclasses.field(default_factory=Trust)
    threads: int = 1
    films: bool = False
    shift: bool = False
    log: Path | None = None
    nonce: Path | None = None
    beacon: Path | None = None
    in_parts: bool = False

    def check(self) -> None:
        """Check the numbers and options before any work is done.

        Raises:
            UserError: If one is out of range, or two exclude each other.
        """
        check_episodes(self.episodes)
        if self.seed is not None:
            check_seed(self.seed)  # it is used only after the commitment
        if self.films and self.soft:
            raise UserError("films show a policy's best actions: leave out --films or --soft")
        self.trust.limits.check()
        if self.trust.files and not any(map(is_code, (self.policy, *self.references))):
            raise UserError("--files is of a process or Python: leave it out")
        if self.threads < 1:
            raise UserError(f"threads must be at least 1, got {self.threads}")
        if sum(one is not None for one in (self.seed, self.nonce, self.beacon)) > 1:
            raise UserError("an audit has one seed: give one of --seed, --nonce and --beacon")

    def given(self) -> int | Nonce | Round | None:
        """Return the auditor's seed, nonce or round of a beacon; None draws the seed.

        Raises:
            UserError: If its file can't be read, or a round's signature is not the beacon's.
        """
        if self.nonce is not None:
            return read_nonce(self.nonce)
        return self.seed if self.beacon is None else read_round(self.beacon)


def command_of(request: Request, seed: int) -> str:
    """Return the command that repeats an audit, without its output folder."""
    words = ["socialiq", "audit", request.policy, "--profile", str(request.profile)]
    words += ["--episodes", str(request.episodes), "--seed", str(seed)]
    words += [word for one in request.references for word in ("--reference", one)]
    words += ["--films"] if request.films else []
    words += ["--shift"] if request.shift else []
    words += ["--soft"] if request.soft else []
    words += ["--allow-code"] if request.trust.allow_code else []
    words += [word for one in request.trust.files for word in ("--files", one)]
    if request.trust.isolation != "auto":
        words += ["--isolation", request.trust.isolation]
    limits, usual = request.trust.limits, Limits()
    if limits.step != usual.step:
        words += ["--step-seconds", f"{limits.step:g}"]
    if limits.memory != usual.memory:
        words += ["--memory-gib", f"{limits.memory / GIB:g}"]
    return shlex.join(words)
