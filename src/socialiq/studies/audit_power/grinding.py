"""Wrong passes of owners who try up to 20 times, with and without a log of their tries.

Every owner's policy is beyond the margin or exactly on it, so that every pass is a wrong one. A try
is an audit, or a simulation of one at home.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple, get_args

import numpy as np

from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.looks.spending import spend
from socialiq.audit.seeds.commitment import LARGEST_SEED, Commitment, Draw, draw, reveal
from socialiq.audit.seeds.nonce import Nonce
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.regret import Regrets, regret_test
from socialiq.audit.verdict.verdict import enough_resamples, join_tests
from socialiq.social.angle import exact_weights
from socialiq.statistics.intervals import wilson
from socialiq.studies.audit_power.population import Truth, draw_evidence
from socialiq.studies.audit_power.power import ERROR, FLOOR, MARGIN
from socialiq.types import Row

ProgressCallback = Callable[[int], None]

TRIES = 20

COUNTED = (1, 2, 5, 10, TRIES)
"""Numbers of tries after which the owners that have passed are counted."""

POLICIES: Mapping[str, Truth] = {
    "on the margin": Truth(regret=MARGIN, at_fault=0.03, struck=0.03, arrival=0.91),
    "half beyond the margin": Truth(regret=1.5 * MARGIN, at_fault=0.03, struck=0.03, arrival=0.91),
}

Varied = Literal["rerun", "seed", "byte, announced seed", "byte, nonce"]


class Way(NamedTuple):
    """A way to grind.

    Attributes:
        varied: What differs between tries: the system's entropy; the seed, which the owner chooses;
            a free byte of the profile, at a seed that was announced; the same byte, committed to
            before a nonce is revealed.
        log: Whether a log counts the looks.
        at_home: Whether the owner simulates the tries, and only the one that passes is an audit.
    """

    varied: Varied
    log: bool
    at_home: bool = False

    def error(self, number: int) -> float:
        """Return the error of a try.

        Args:
            number: Number of the try, from 1.
        """
        if not self.log:
            return ERROR
        return spend(ERROR, 1 if self.at_home else number).error


WAYS: Mapping[str, Way] = {
    "rerun, no log": Way("rerun", log=False),
    "rerun, log": Way("rerun", log=True),
    "owner's seeds, no log": Way("seed", log=False),
    "owner's seeds, log": Way("seed", log=True),
    "free byte, announced seed, no log": Way("byte, announced seed", log=False, at_home=True),
    "free byte, announced seed, log": Way("byte, announced seed", log=True, at_home=True),
    "free byte, nonce, log": Way("byte, nonce", log=True),
}


def grinding_rows(
    episodes: int,
    owners: int,
    seed: int,
    resamples: int = 1000,
    on_progress: ProgressCallback | None = None,
) -> list[Row]:
    """Return the shares of owners who pass wrongly in a number of tries, with 99 % intervals.

    Args:
        episodes: Episodes of each audit.
        owners: Number of owners of each policy.
        seed: Seed of the first owner; the others follow.
        resamples: Smallest number of resamples of each bootstrap; a small error takes more.
        on_progress: Called with the number of finished owners.
    """
    first: dict[tuple[str, str], list[int]] = {
        (policy, way): [] for policy in POLICIES for way in WAYS
    }
    for done, owner in enumerate(range(seed, seed + owners), start=1):
        for policy, truth in POLICIES.items():
            for way, number in first_passes(truth, episodes, owner, resamples).items():
                first[policy, way].append(number)
        if on_progress:
            on_progress(done)
    rows: list[Row] = []
    for (policy, way), numbers in first.items():
        for tries in COUNTED:
            share = wilson(sum(1 <= one <= tries for one in numbers), owners, 0.99)
            found = {"passed": share.value, "low": share.low, "high": share.high}
            rows.append({"policy": policy, "way": way, "tries": tries, **found})
    return rows


def first_passes(truth: Truth, episodes: int, owner: int, resamples: int) -> dict[str, int]:
    """Return the number of the first try that passes, by way; 0 if none of 20 does.

    Args:
        truth: True values of the owner's policy.
        episodes: Episodes of each audit.
        owner: Seed of the owner.
        resamples: Smallest number of resamples of each bootstrap.
    """
    found = dict.fromkeys(WAYS, 0)
    for varied in get_args(Varied):
        ways = {name: way for name, way in WAYS.items() if way.varied == varied}
        for number in range(1, TRIES + 1):
            waiting = {name: way.error(number) for name, way in ways.items() if not found[name]}
            if not waiting:
                break
            drawn = draw_of(varied, owner, number)
            evidence = draw_evidence(truth, episodes, drawn.derived("episodes"))
            for name, error in waiting.items():
                if passes(truth, evidence, drawn.derived("resampling"), error, resamples):
                    found[name] = number
    return found


def draw_of(varied: Varied, owner: int, number: int) -> Draw:
    """Return commitment and seed of a try, as an audit would draw them.

    Args:
        varied: What differs between tries.
        owner: Seed of the owner.
        number: Number of the try, from 1.
    """
    entropy = np.random.default_rng([owner, number])
    free = number if varied.startswith("byte") else 0
    commitment = Commitment(_sha256(f"policy {owner}"), _sha256(f"profile {owner} {free}"))
    if varied == "byte, nonce":
        nonce = Nonce(entropy.bytes(32).hex())
        return reveal(commitment, _sha256(f"entry {commitment.sha256}"), nonce)
    if varied == "rerun":
        return draw(commitment, int(entropy.integers(LARGEST_SEED + 1)))
    return draw(commitment, number if varied == "seed" else 7)


def passes(truth: Truth, evidence: Evidence, seed: int, error: float, resamples: int) -> bool:
    """Whether an audit with this evidence passes at an error.

    Args:
        truth: True values of the policy.
        evidence: Evidence of the audit.
        seed: Seed of the resampling.
        error: Error of the look, at most 0.05.
        resamples: Smallest number of resamples.
    """
    gains = evidence.gains() @ np.array(exact_weights(truth.declared))
    least = gains.mean(axis=1) + gains.std(axis=1, ddof=1) / evidence.episodes**0.5
    if (least > MARGIN).any():  # a bound at 5 % lies more than one standard error above the mean
        return False
    # Few resamples first: an audit that does not pass at 5 % passes at no smaller error.
    for level in dict.fromkeys((ERROR, error)):
        regrets = Regrets(evidence, seed, enough_resamples(level, resamples))
        test = regret_test(regrets, evidence, truth.declared, MARGIN, level, level / 2)
        if join_tests(test, evidence.policy, FLOOR, level).decision is not Decision.PASS:
            return False
    return True


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
