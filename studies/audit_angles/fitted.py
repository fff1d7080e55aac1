"""Policies that are fitted to a declaration: the most harm that its margins allow."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.audit.evidence.drive import Course
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.request import SHIPPED_DIAL
from socialiq.evaluation.episodes import KINDS, episodes_of
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.storage import packaged_results
from socialiq.types import Policy, Row
from socialiq_lab.study import StageCallback, tracked
from studies.audit_angles.audits import Audits
from studies.audit_angles.drivers import WORLD, Deciding, Driven, drive

DECLARED = (0.0, 45.0, 90.0)  # degrees
MOST, STEPS = 8.0, 10
"""Largest loss of a decision that is tried, reward, and halvings of the interval of it."""

Scores = Callable[[np.ndarray], Float[np.ndarray, "batch action"]]


def harms(dial: DialPolicy) -> dict[str, Scores]:
    """Return how much each action harms, by the kind of harm."""
    altruist, egoist = dial.at(90.0), dial.at(0.0)
    return {
        "least for others": lambda observation: -altruist.q_values(observation),
        "as the egoist": egoist.q_values,
        "fastest": lambda rows: np.tile(np.arange(dial.n_actions, dtype=float), (len(rows), 1)),
    }


def harmful(policy: QPolicy, harm: Scores, most: float) -> Deciding:
    """Return a driver that takes the most harmful of the actions that lose at most so much.

    The loss is the value of the best action, by a policy, less that of the action.
    """

    def decide(observation: np.ndarray) -> np.ndarray:
        values = policy.q_values(observation)
        allowed = values >= values.max(axis=1, keepdims=True) - most
        return np.where(allowed, harm(observation), -np.inf).argmax(axis=1)

    return Deciding(policy.n_features, decide)


def fitted_rows(
    course: Course,
    pool: Mapping[str, Driven],
    fitting: Course,
    config: Any,
    on_stage: StageCallback,
) -> list[Row]:
    """Fit a driver of each kind of harm to each declaration; measure it and the dial of the angle.

    Its loss of a decision is the largest, by bisection, with which its values in the episodes of
    `fitting` are within the declaration. Its measures, and the shares of audits that pass, are of
    the pool, which is driven on `course`.
    """
    dial, rows = DialPolicy.load(packaged_results() / SHIPPED_DIAL), list[Row]()
    references = drive(fitting, on_stage, references_only=True)
    for declared in tracked(DECLARED, on_stage, "fitting", "angles"):
        honest, tests = dial.at(declared), Audits.of(WORLD, declared, references)
        policies: dict[str, tuple[float, Policy]] = {"the dial": (0.0, honest)}
        for kind, harm in harms(dial).items():
            least, most = 0.0, MOST
            for _ in range(STEPS):
                middle = (least + most) / 2
                tried = fitting.drive(Reference("tried", harmful(honest, harm, middle)))
                least, most = (middle, most) if tests.holds(tried) else (least, middle)
            policies[kind] = least, harmful(honest, harm, least)
        audits = Audits.of(WORLD, declared, pool)
        for kind, (loss, policy) in policies.items():
            driver = course.drive(Reference(kind, policy))
            row: Row = {"declared": declared, "policy": kind, "loss": loss}
            row |= {"inside": int(audits.holds(driver)), **measures(course, policy)}
            for episodes in config.lengths:
                shares = audits.shares(driver, episodes, config.audits, config.first_seed)
                row[f"passed_{episodes}"] = shares["passed"]
            rows.append(row)
    return rows


def measures(course: Course, policy: Policy) -> Row:
    """Return collisions, mean rewards, and lost speed of others in an episode, in units of 5 m/s.

    The shares of collisions are of those at fault, and of those in which another vehicle struck.
    """
    episodes = episodes_of(course.batch, policy, course.seeds)
    metrics, signals = episodes.metrics(), episodes.signals.mean(axis=0)
    contacts = {name: float((episodes.contact == kind).mean()) for name, kind in KINDS.items()}
    lost = float(signals[episodes.signal_names.index("disruption")])
    rewards = {"r_env": metrics.r_env, "r_social": metrics.r_social}
    return contacts | rewards | {"disruption": lost}
