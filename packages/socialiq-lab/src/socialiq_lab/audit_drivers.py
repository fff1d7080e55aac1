"""Drivers on one pool of episodes: dials, weaker ones, experts, rules, rash ones and mixtures."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Int64

from socialiq.audit.evidence.drive import Course, exact_optima
from socialiq.audit.evidence.outcomes import COLUMNS, Outcomes, Reference
from socialiq.audit.request import DIAL, SHIPPED_DIAL, Trust, resolve_policy
from socialiq.audit.verdict.direction import driver_of, drivers_of
from socialiq.evaluation.measures import Episodes
from socialiq.evaluation.rollout import MODES
from socialiq.policies.drivers import ATLAS
from socialiq.storage import packaged_results
from socialiq.types import Policy
from socialiq.worlds.intersection import policies
from socialiq.worlds.registry import make
from socialiq_lab.intersection.driving import Deciding
from socialiq_lab.study import StageCallback, tracked

WORLD = "intersection"
ANGLES = tuple(15.0 * step for step in range(7))  # degrees, declared and true
FAMILIES = ("expert", "set", "iterated")
RULES = ("go", "wait", "idm", "gap_2s", "gap_3s", "gap_4s")
WEAKER = ("timed", "calibrated")
"""Dials that were trained with less: without the policy iterations of the shipped one."""

NEAR = 15.0
RASHNESS = 0.05, 0.1, 0.2
"""Distance in metres, and shares of decisions with a vehicle nearer in which a rash driver goes."""

SHARES = (0.1, 0.25, 0.5, 0.75, 0.9)
"""Shares of the episodes of a mixture that its first driver drives."""


class Driven(NamedTuple):
    """A driver on the pool."""

    outcomes: Outcomes
    kind: str  # optimum, dial, weaker dial, expert, rule, rash or mixture
    true_angle: float | None  # angle that it was made for, degrees
    reference: bool = False  # whether a default audit compares with it


def rash(policy: Policy, share: float) -> Deciding:
    """Return a driver that goes in a share of its decisions close to another vehicle.

    The random draws have a fixed seed.

    Args:
        policy: Driver that makes all other decisions.
        share: Share of the decisions with a vehicle nearer than `NEAR` metres in which the driver
            goes.
    """
    features = make(WORLD).n_features
    rng = np.random.default_rng(7)

    def decide(observation: np.ndarray) -> np.ndarray:
        rows = policies.in_metres(observation[:, :features])
        away = np.hypot(*(rows[:, 1:, column] - rows[:, :1, column] for column in (1, 2)))
        near = (np.where(rows[:, 1:, 0] > 0, away, np.inf) < NEAR).any(axis=1)
        goes = near & (rng.random(len(rows)) < share)
        return np.where(goes, 2, policy.predict(observation)[0])

    return Deciding(getattr(policy, "n_features", features), decide)


def specifications() -> Iterator[tuple[str, str, str, float | None]]:
    """Yield name, specification, kind and true angle of every driver that is driven."""
    results = packaged_results()
    for angle in ANGLES:
        yield f"{DIAL}{angle:g}", str(results / SHIPPED_DIAL), "dial", angle
        for family in WEAKER:
            path = (results / SHIPPED_DIAL).with_name(f"{family}.safetensors")
            yield f"{family}_{angle:g}", str(path), "weaker dial", angle
    for family, (mode, angle) in itertools.product(FAMILIES, MODES.items()):
        if (family, mode) != ("iterated", "altruistic"):  # there is none
            yield f"{family}_{mode}", f"{ATLAS}{family}_{mode}", "expert", angle
    for rule in RULES:
        yield rule, rule, "rule", None


def drive(
    course: Course, on_stage: StageCallback, references_only: bool = False
) -> dict[str, Driven]:
    """Run every driver on a course, or those alone that a default audit compares with.

    Args:
        course: Episodes that all drivers share.
        on_stage: Returns the progress callback of a stage.
        references_only: Whether to leave out the drivers that a default audit does not compare
            with.

    Returns:
        Drivers on the course by name.
    """
    pool = dict[str, Driven]()
    specified = list(specifications())
    for name, spec, kind, angle in tracked(specified, on_stage, "driving", "drivers"):
        compared = kind in ("dial", "expert", "rule") and not name.startswith("iterated")
        if references_only and not compared:
            continue
        policy = resolve_policy(spec, course.world, angle or 0.0, Trust()).policy
        reference = Reference(name, policy, angle if kind == "dial" else None)
        pool[name] = Driven(course.drive(reference), kind, angle, compared)
        rash_angles = (0.0, 45.0, 90.0) if kind == "dial" and not references_only else ()
        for share in RASHNESS if angle in rash_angles else ():
            title = f"{name}, rash in {100 * share:g} %"
            driver = course.drive(Reference(title, rash(policy, share)))
            pool[title] = Driven(driver, "rash", angle)
    return pool


def drive_optima(world: str, seeds: Int64[np.ndarray, " episode"]) -> dict[str, Driven]:
    """Run the exact optima of a gridworld on the pool; those of the angles are policies too.

    Args:
        world: Name of the gridworld.
        seeds: Seed of each episode.

    Returns:
        Drivers by name: the references of an audit, then "optimum of ANGLE" for each of `ANGLES`.
    """
    optima = exact_optima(Course(make(world), seeds))
    pool = {row.name: Driven(row, "reference", None, reference=True) for row in optima}
    drivers = drivers_of(optima)
    for angle in ANGLES:
        driver = driver_of(drivers, angle)
        assert driver is not None
        pool[f"optimum of {angle:g}"] = Driven(driver.outcomes, "optimum", angle)
    return pool


def mixtures(
    pool: Mapping[str, Driven], seed: int, shares: Sequence[float]
) -> Iterator[tuple[str, Driven]]:
    """Yield the policies that draw one of two drivers for each episode.

    Args:
        pool: Drivers on the pool by name; dials, experts and rules are mixed.
        seed: Seed of the draws of the episodes, which are the same for all mixtures.
        shares: Shares of the episodes that the first driver drives, from 0 to 1.

    Yields:
        Name and driver of each mixture, for each pair of drivers and each share.
    """
    kinds = ("dial", "expert", "rule")
    single = [name for name, driven in pool.items() if driven.kind in kinds]
    episodes = next(iter(pool.values())).outcomes.episodes
    draw = np.random.default_rng(seed).random(len(episodes.length))
    for first, second in itertools.combinations(single, 2):
        for share in shares:
            pair = pool[first], pool[second]
            name = f"{100 * share:g} % {first}, else {second}"
            episodes = [driven.outcomes.episodes for driven in pair]
            columns = {
                column: np.where(draw < share, *(values[column] for values in episodes))
                for column in COLUMNS
            }
            yield name, Driven(Outcomes(name, Episodes(columns)), "mixture", None)
