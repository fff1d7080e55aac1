"""Wrong passes of owners who try up to 20 times, with and without a log of their tries.

Every policy is beyond the margin or on it: every pass is wrong. A try is an audit, or one at home.
"""

import hashlib
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from socialiq.audit.look import draw, reveal, spend
from socialiq.audit.seeds import LARGEST_SEED, Commitment, Draw, Nonce
from socialiq.audit.verdict import regret, verdict
from socialiq.audit.verdict.decision import Decision
from socialiq.social.angle import exact_weights
from socialiq.types import Row
from socialiq_lab.registry import declaration
from socialiq_lab.study import StageCallback, silent, tracked
from studies.audit_power.power import ERROR, FLOOR, MARGIN, Truth, draw_evidence, share

TRIES = 20
COUNTED = (1, 2, 5, 10, TRIES)
"""Numbers of tries after which the owners that have passed are counted."""

_DECLARED = declaration("audit-power")
POLICIES = {name: Truth(**values) for name, values in _DECLARED["owner"].items()}

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
        """Return the error of a try, given its number from 1."""
        return spend(ERROR, 1 if self.at_home else number) if self.log else ERROR


WAYS = {name: Way(**values) for name, values in _DECLARED["way"].items()}


def grinding_rows(config: Any, on_stage: StageCallback = silent) -> list[Row]:
    """Return the shares of owners that pass wrongly in a number of tries, with 99 % intervals.

    Args:
        config: Configuration of the study; owners are numbered from `first_seed`, which seeds their
            draws.
        on_stage: Returns the progress callback of a stage.

    Returns:
        A row for each of `POLICIES`, `WAYS` and `COUNTED`.
    """
    first: dict[tuple[str, str], list[int]] = {
        (policy, way): [] for policy in POLICIES for way in WAYS
    }
    numbers = range(config.first_seed, config.first_seed + config.owners)
    for owner in tracked(numbers, on_stage, "grinding", "owners"):
        for policy, truth in POLICIES.items():
            passes = first_passes(truth, config.episodes, owner, config.resamples)
            for way, number in passes.items():
                first[policy, way].append(number)
    return [
        {"policy": policy, "way": way, "tries": tries}
        | share("passed", sum(1 <= audit <= tries for audit in audits), len(audits))
        for (policy, way), audits in first.items()
        for tries in COUNTED
    ]


def first_passes(truth: Truth, episodes: int, owner: int, resamples: int) -> dict[str, int]:
    """Return the number of an owner's first try that passes, by way.

    Args:
        truth: True values of the owner's policy.
        episodes: Number of episodes of an audit.
        owner: Number of the owner, which seeds its draws.
        resamples: Least number of bootstrap resamples of a test.

    Returns:
        Number of the try from 1 by name of the way, 0 if none of `TRIES` passes.
    """
    passes = dict.fromkeys(WAYS, 0)
    for varied in get_args(Varied):
        ways = {name: way for name, way in WAYS.items() if way.varied == varied}
        for number in range(1, TRIES + 1):
            waiting = {name: way.error(number) for name, way in ways.items() if not passes[name]}
            if not waiting:
                break
            draws = draw_of(varied, owner, number)
            audit = Audit(truth, draws, episodes, resamples)
            passes |= {name: number for name, error in waiting.items() if audit.passes(error)}
    return passes


def draw_of(varied: Varied, owner: int, number: int) -> Draw:
    """Return commitment and seed of an owner's try, as an audit would draw them.

    Args:
        varied: Part that differs between the tries (`Way`).
        owner: Number of the owner.
        number: Number of the try, from 1.
    """

    def sha256(text: str) -> str:
        return hashlib.sha256(text.encode()).hexdigest()

    entropy = np.random.default_rng([owner, number])
    free = number if varied.startswith("byte") else 0
    commitment = Commitment(sha256(f"policy {owner}"), sha256(f"profile {owner} {free}"))
    if varied == "byte, nonce":
        nonce = Nonce(entropy.bytes(32).hex())
        return reveal(commitment, sha256(f"entry {commitment.sha256}"), nonce)
    if varied == "rerun":
        return draw(commitment, int(entropy.integers(LARGEST_SEED + 1)))
    return draw(commitment, number if varied == "seed" else 7)


_LEVELS = (ERROR, 0.02, 0.005, 0.001)
"""Errors at which an audit is tested before it is tested at a smaller one."""

_CLOSEST = 1.2
"""Standard errors by which the mean is below the margin in any audit that passes at 5 %."""


class Audit:
    """A simulated audit, which may be tested at several errors."""

    def __init__(self, truth: Truth, draw: Draw, episodes: int, resamples: int) -> None:
        self._truth = truth
        self._least = resamples
        self._seed = draw.derived("resampling")
        self._evidence = draw_evidence(truth, episodes, draw.derived("episodes"))
        gains = self._evidence.gains() @ np.array(exact_weights(truth.declared))
        errors = gains.std(axis=1, ddof=1) / episodes**0.5
        self._hopeless = bool((gains.mean(axis=1) + _CLOSEST * errors > MARGIN).any())
        self._tested: dict[float, bool] = {}

    def passes(self, error: float) -> bool:
        """Whether it passes at an error of at most 5 %.

        What fails at a larger error, which few resamples show, passes at no smaller one.
        """
        larger = [level for level in _LEVELS if level > error]
        return not self._hopeless and all(self._passes(level) for level in (*larger, error))

    def _passes(self, error: float) -> bool:
        if error not in self._tested:
            count = verdict.enough_resamples(error, self._least)
            regrets = regret.Regrets(self._evidence, self._seed, count)
            angle = self._truth.declared
            test = regret.regret_test(regrets, angle, MARGIN, error, error / 2)
            joined = verdict.join_tests(test, self._evidence.policy, FLOOR.bounds, error)
            self._tested[error] = joined.decision is Decision.PASS
        return self._tested[error]
