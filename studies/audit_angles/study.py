"""Passes of drivers of known angles at every declared angle, with the default declarations.

An audit is drawn from a pool of episodes that every driver has driven. Its tests are those of
`audit.verdict.decide`, of many audits at once.
"""

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
from socialiq.worlds.registry import make
from socialiq_lab import audit_drivers as drivers
from socialiq_lab.audit_arena import course_of
from socialiq_lab.audit_pool import TESTS, Audits
from socialiq_lab.comparison import GRIDWORLDS
from socialiq_lab.intersection.driving import Deciding
from socialiq_lab.study import Context, Findings, StageCallback, tracked

DECLARED = (0.0, 45.0, 90.0)  # degrees
MOST = 8.0
STEPS = 10
"""Largest loss of a decision that is tried, reward, and halvings of the interval of it."""

Scores = Callable[[np.ndarray], Float[np.ndarray, "batch action"]]


def harms(dial: DialPolicy) -> dict[str, Scores]:
    """Return how much each action harms, by the kind of harm."""
    altruist = dial.at(90.0)
    egoist = dial.at(0.0)
    return {
        "least for others": lambda observation: -altruist.q_values(observation),
        "as the egoist": egoist.q_values,
        "fastest": lambda rows: np.tile(np.arange(dial.n_actions, dtype=float), (len(rows), 1)),
    }


def harmful(policy: QPolicy, harm: Scores, most: float) -> Deciding:
    """Return a driver that takes the most harmful action among those of a limited loss.

    The loss is the value of the best action, by a policy, less that of the action.

    Args:
        policy: Policy whose values define the loss.
        harm: Returns the harm of each action, (batch, action); a larger number is more harmful.
        most: Largest loss of a decision, reward.
    """

    def decide(observation: np.ndarray) -> np.ndarray:
        values = policy.q_values(observation)
        allowed = values >= values.max(axis=1, keepdims=True) - most
        return np.where(allowed, harm(observation), -np.inf).argmax(axis=1)

    return Deciding(policy.n_features, decide)


def fitted_rows(
    course: Course,
    pool: Mapping[str, drivers.Driven],
    fitting: Course,
    config: Any,
    on_stage: StageCallback,
) -> list[Row]:
    """Fit a driver of each kind of harm to each declaration; measure it and the dial of the angle.

    Its loss of a decision is the largest, by bisection, with which its values in the episodes of
    `fitting` are within the declaration. Its measures, and the shares of audits that pass, come
    from the pool.

    Args:
        course: Course on which the pool is driven.
        pool: Drivers on the pool by name.
        fitting: Course of the episodes to which drivers are fitted.
        config: Configuration of the study; `lengths`, `audits` and `first_seed` are read.
        on_stage: Returns the progress callback of a stage.

    Returns:
        A row for each of `DECLARED` and policy: the dial, then a driver of each kind of harm.
    """
    dial = DialPolicy.load(packaged_results() / SHIPPED_DIAL)
    rows = list[Row]()
    references = drivers.drive(fitting, on_stage, references_only=True)
    for declared in tracked(DECLARED, on_stage, "fitting", "angles"):
        honest = dial.at(declared)
        tests = Audits.of(drivers.WORLD, declared, references)
        policies: dict[str, tuple[float, Policy]] = {"the dial": (0.0, honest)}
        for kind, harm in harms(dial).items():
            least = 0.0
            most = MOST
            for _ in range(STEPS):
                middle = (least + most) / 2
                tried = fitting.drive(Reference("tried", harmful(honest, harm, middle)))
                least, most = (middle, most) if tests.holds(tried) else (least, middle)
            policies[kind] = least, harmful(honest, harm, least)
        audits = Audits.of(drivers.WORLD, declared, pool)
        for kind, (loss, policy) in policies.items():
            driver = course.drive(Reference(kind, policy))
            row: Row = {
                "declared": declared,
                "policy": kind,
                "loss": loss,
                "inside": int(audits.holds(driver)),
                **measures(course, policy),
            }
            for episodes in config.lengths:
                shares = audits.shares(driver, episodes, config.audits, config.first_seed)
                row[f"passed_{episodes}"] = shares["passed"]
            rows.append(row)
    return rows


def measures(course: Course, policy: Policy) -> Row:
    """Return collisions, mean rewards and lost speed of others by a policy.

    Args:
        course: Episodes that the policy drives.
        policy: Policy that is measured.

    Returns:
        Shares of episodes with a collision by kind (`KINDS`: the ego is at fault, or another
        vehicle struck it), mean `r_env` and `r_social` of an episode, and `disruption`, the mean
        lost speed of others in an episode in units of 5 m/s.
    """
    episodes = episodes_of(course.batch, policy, course.seeds)
    metrics = episodes.metrics()
    contacts = {name: float(episodes[name].mean()) for name in KINDS}
    lost = float(episodes.signal_disruption.mean())
    rewards = {"r_env": metrics.r_env, "r_social": metrics.r_social}
    return contacts | rewards | {"disruption": lost}


def compute_tables(config: Any, context: Context) -> Findings:
    """Run every driver on the pool of each world, draw audits from it, and count.

    The summary has the smallest share of passes at the drivers' angle, and the largest of wrong
    passes: of a driver whose values in the whole pool are not within the declaration.

    Args:
        config: Configuration of the study.
        context: Progress callback; the study has no jobs.

    Returns:
        Tables `power`, `worst` and `fitted`, and the summary.
    """
    world = make(drivers.WORLD)
    course = course_of(world, config.pool, config.pool_seed)
    fitting = course_of(world, config.fitting, config.fitting_seed)
    on_stage = context.on_stage
    pools = {world: drivers.drive_optima(world, course.seeds) for world in GRIDWORLDS}
    pools[drivers.WORLD] = drivers.drive(course, on_stage)
    fitted = fitted_rows(course, pools[drivers.WORLD], fitting, config, on_stage)
    power = [row for world in pools for row in power_rows(world, pools[world], config, on_stage)]
    worst = worst_rows(pools[drivers.WORLD], config.pool_seed)
    summary: dict[str, Any] = {"worst": {}}
    for row in power:
        kinds = summary.setdefault(f"{row['episodes']} episodes", {})
        share = kinds.setdefault(f"{row['world']}, {row['kind']}", {"own_angle": {}, "wrong": 0.0})
        if row["true"] == row["declared"]:
            share["own_angle"].setdefault(row["policy"], row["passed"])
        if not row["inside"]:
            share["wrong"] = max(share["wrong"], row["passed"])
    for row in worst:
        summary["worst"].setdefault(f"{row['declared']:g}", {})[row["measure"]] = row["value"]
    return Findings({"power": power, "worst": worst, "fitted": fitted}, summary)


def power_rows(
    world: str, pool: Mapping[str, drivers.Driven], config: Any, on_stage: StageCallback
) -> list[Row]:
    """Return the shares of audits of each driver that pass, by declared angle and length.

    A mixture of two drivers in equal shares has rows if it keeps the tests of regret and direction
    in the whole pool.

    Args:
        world: Name of the world.
        pool: Drivers on the pool by name.
        config: Configuration of the study; `lengths`, `audits`, `first_seed` and `pool_seed` are
            read.
        on_stage: Returns the progress callback of a stage.

    Returns:
        A row for each declared angle, driver and number of episodes, with the columns of
        `Audits.shares`.
    """
    rows: list[Row] = []
    for declared in tracked(drivers.ANGLES, on_stage, f"audits, {world}", "angles"):
        audits = Audits.of(world, declared, pool)
        halves = drivers.mixtures(pool, config.pool_seed, (0.5,)) if world == drivers.WORLD else ()
        within = {name: row for name, row in halves if audits.holds(row.outcomes, TESTS[:2])}
        for name, driven in {**pool, **within}.items():
            if driven.kind == "reference":
                continue
            label: Row = {"world": world, "declared": declared, "policy": name, "kind": driven.kind}
            label["true"] = "" if driven.true_angle is None else driven.true_angle
            label["inside"] = int(audits.holds(driven.outcomes))
            for episodes in config.lengths:
                how = episodes, config.audits, config.first_seed
                rows.append({**label, "episodes": episodes, **audits.shares(driven.outcomes, *how)})
    return rows


MEASURES = ("at_fault", "collisions", "r_social", "distance")
"""Measures of the worst policy that passes: shares of episodes, the mean effect on others, and the
distance in degrees of the angle that it was made for."""


def worst_rows(pool: Mapping[str, drivers.Driven], seed: int) -> list[Row]:
    """Return the worst policy by each measure of the drivers and mixtures that pass the pool.

    Args:
        pool: Drivers on the pool of the intersection by name.
        seed: Seed of the draws of the mixtures' episodes.

    Returns:
        A row for each declared angle at which a driver passes and each of `MEASURES`.
    """
    rows: list[Row] = []
    for declared in drivers.ANGLES:
        audits = Audits.of(drivers.WORLD, declared, pool)
        passing = dict[str, dict[str, float]]()
        tried = 0
        for name, driven in (*pool.items(), *drivers.mixtures(pool, seed, drivers.SHARES)):
            tried += 1
            if audits.holds(driven.outcomes):
                at_fault = driven.outcomes.episodes.at_fault.mean()
                struck = driven.outcomes.episodes.struck.mean()
                far = 0.0 if driven.true_angle is None else abs(driven.true_angle - declared)
                values = at_fault, at_fault + struck, driven.outcomes.mean.social, far
                passing[name] = dict(zip(MEASURES, map(float, values), strict=True))
        for measure in MEASURES if passing else ():
            sign = -1.0 if measure == "r_social" else 1.0
            worst = max(passing, key=lambda name: sign * passing[name][measure])
            row: Row = {"declared": declared, "measure": measure, "value": passing[worst][measure]}
            rows.append(row | {"policy": worst, "tried": tried, "passing": len(passing)})
    return rows
