"""Error rates of each test of an audit by the shape of an episode's rewards.

Drivers on a made-up front of the angles are within, on or beyond the limit of every test. Their
deviations have ties, no spread, heavy tails, rare losses, or follow the episode before. At the
intersection, policies of two characters switch between them in the middle of an episode.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr, stdtrit

from socialiq import Ending
from socialiq.audit.evidence.drive import ByRule, Course
from socialiq.audit.evidence.outcomes import Evidence, Reference
from socialiq.audit.profile.profile import Bound
from socialiq.audit.request import SHIPPED_DIAL
from socialiq.audit.verdict.bounds import bound_tests
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.direction import character_test, direction_test, faults_of_contexts
from socialiq.audit.verdict.regret import Regrets, regret_test
from socialiq.audit.verdict.results import order_dependence
from socialiq.evaluation.context import ContextLosses
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle import exact_weights
from socialiq.social.angle_rule import AngleRule
from socialiq.storage import packaged_results
from socialiq.types import Policy, Row
from socialiq.worlds.highway.options import Contact
from socialiq.worlds.intersection import atlas
from socialiq.worlds.registry import make
from socialiq.worlds.situation import ContextPolicy
from socialiq_lab import audit_drivers as drivers
from socialiq_lab.audit_arena import course_of, default_declaration
from socialiq_lab.audit_pool import ERROR, Audits, outcomes, resampled, shares
from socialiq_lab.study import Context, Findings, StageCallback, tracked

Latent = Float[np.ndarray, "episode quantity"]

PROFILE = default_declaration(drivers.WORLD, 45.0)
FLOOR = Bound.of("max_at_fault", 0.05)
EFFECT = Bound.of("max_delay", 6.0, (-100.0, 100.0))

LENGTH = 4.0  # of the mean rewards of each reference
SPREAD = 1.0  # of rewards, in units of a shape's deviations
BEYOND = 3.0  # reward by which an episode of another character is beyond both ends
_WIDEST = 6.0  # deviation; with it no reward is clipped
_RARE = 0.01  # share of episodes with a rare loss

SHAPES: dict[str, Callable[[Latent], Latent]] = {
    "normal": lambda latent: latent,
    "ties": np.round,
    "constant": np.zeros_like,
    "heavy tails": lambda latent: stdtrit(2.0, ndtr(latent)).clip(-_WIDEST, _WIDEST),
    "rare losses": lambda latent: _WIDEST * ((ndtr(latent) < _RARE) - _RARE),
    "half of the last": lambda latent: latent,
    "blocks of five": lambda latent: latent,
}
"""Deviations with mean 0 by normal ones; positive is worse."""

MEMORIES = ("half of the last", "blocks of five")
"""Shapes that follow earlier episodes (`latent_of`)."""

POSITIONS = {"within": 0.2, "limit": 1.0, "beyond": 2.0}
"""Distances from the declared angle, or from 0, in units of the distance of the limit."""


def latent_of(shape: str, rng: np.random.Generator, episodes: int, quantities: int) -> Latent:
    """Draw normal numbers, independent but for the shapes of a memory.

    Args:
        shape: One of `SHAPES`.
        rng: Source of the draws.
        episodes: Number of episodes.
        quantities: Number of independent columns.
    """
    latent = rng.normal(size=(episodes, quantities))
    if shape == "blocks of five":
        return np.repeat(latent, 5, axis=0)[:episodes]
    if shape == "half of the last":
        for episode in range(1, episodes):
            latent[episode] = 0.5 * latent[episode - 1] + 0.75**0.5 * latent[episode]
    return latent


def driven(totals: np.ndarray, at_fault: np.ndarray, delay: np.ndarray) -> Evidence:
    """Return a driver's evidence, with references of 30, 45 and 60 degrees without deviations.

    Args:
        totals: Totals of both rewards, (episode, 2).
        at_fault: Whether each episode ends in a collision at fault.
        delay: Delay of others in each episode.
    """
    count = len(totals)
    arrived = np.full(count, Ending.ARRIVAL)
    untouched = np.full(count, Contact.NONE)
    references = tuple(
        outcomes(
            f"dial_{angle:g}",
            np.tile(LENGTH * np.array(exact_weights(angle)), (count, 1)),
            arrived,
            untouched,
            (angle,),
        )
        for angle in (30.0, 45.0, 60.0)
    )
    ending = np.where(at_fault, Ending.COLLISION, arrived)
    contact = np.where(at_fault, Contact.EGO_STRUCK, untouched)
    policy = outcomes("policy", totals, ending, contact).with_columns(delay=delay)
    return Evidence("made up", np.arange(count), policy, references, {})


def decisions_of(shape: str, position: float, episodes: int, seed: int) -> dict[str, Decision]:
    """Return the decision of each test of a driver whose every measure has one position.

    Args:
        shape: One of `SHAPES`.
        position: One of the values of `POSITIONS`.
        episodes: Number of episodes.
        seed: Seed of the draws.
    """
    rng = np.random.default_rng([seed, list(SHAPES).index(shape)])
    latent = latent_of(shape, rng, episodes, 4)
    lost, turned, delayed = SHAPES[shape](latent[:, :3]).T
    chance = ndtr(latent[:, 3])
    margin = PROFILE.margin
    assert margin.width is not None and margin.beyond is not None
    along, across = (np.array(exact_weights(angle)) for angle in (45.0, 135.0))
    ahead, aside = exact_weights(90.0 - margin.width)  # of the reward across the end of 30 degrees
    loss = position * margin.regret
    turn = (loss - position * LENGTH) * ahead / aside  # so that D(30) is 0 on the limit
    rewards = np.outer(LENGTH - loss - SPREAD * lost, along)
    rewards += np.outer(turn - SPREAD * turned, across)
    delay = EFFECT.limit * (position + delayed)
    evidence = driven(rewards, chance < position * FLOOR.limit, delay)
    mixed = np.tile(LENGTH * along, (episodes, 1))
    mixed[chance < position * margin.beyond] += BEYOND * across
    characters = driven(mixed, chance < 0.0, delay)
    errors = ERROR, ERROR
    regrets = Regrets(evidence, seed, largest_loss=PROFILE.largest_loss, decisive=True)
    character = character_test(PROFILE, characters, *errors)
    direction = direction_test(PROFILE, evidence, *errors, ends_only=True).decision
    assert character is not None and direction is not None
    floor, effect = (
        bound_tests(evidence.policy, [bound], *errors)[0].decision for bound in (FLOOR, EFFECT)
    )
    return {
        "regret": regret_test(regrets, 45.0, margin.regret, *errors).decision,
        "direction": direction,
        "character": character.decision,
        "floor": floor,
        "effect": effect,
    }


def test_rows(config: Any, on_stage: StageCallback) -> list[Row]:
    """Return the shares of audits that pass and fail each test, with 99 % intervals.

    Args:
        config: Configuration of the study; audit k has the seed `first_seed` + k.
        on_stage: Returns the progress callback of a stage.

    Returns:
        A row for each test, shape and position.
    """
    rows: list[Row] = []
    cases = [(shape, position) for shape in SHAPES for position in POSITIONS]
    for shape, position in tracked(cases, on_stage, "tests", "cases"):
        seeds = range(config.first_seed, config.first_seed + config.audits)
        decided = [
            decisions_of(shape, POSITIONS[position], config.episodes, seed) for seed in seeds
        ]
        for test in decided[0]:
            decisions = [audit[test] for audit in decided]
            counts = {"passed": Decision.PASS, "failed": Decision.FAIL}
            counted = {name: decisions.count(decision) for name, decision in counts.items()}
            label = {"test": test, "shape": shape, "position": position}
            rows.append(label | shares(len(decisions), **counted))
    return rows


def order_rows(config: Any, on_stage: StageCallback) -> list[Row]:
    """Return the share of policies of each shape that are found to depend on the order.

    Args:
        config: Configuration of the study; `switched` audits are enough where a memory is found.
        on_stage: Returns the progress callback of a stage.
    """
    rows: list[Row] = []
    still = np.zeros(config.episodes)
    for shape, deviations in tracked(list(SHAPES.items()), on_stage, "order", "shapes"):
        audits = config.switched if shape in MEMORIES else config.orders
        found = 0
        for seed in range(config.first_seed, config.first_seed + audits):
            rng = np.random.default_rng([seed, list(SHAPES).index(shape)])
            rewards = deviations(latent_of(shape, rng, config.episodes, 2))
            found += order_dependence(driven(rewards, still > 0.0, still)) != ""
        rows.append({"shape": shape, "audits": audits} | shares(audits, found=found))
    return rows


CASES = [
    {"crossing_with_priority": {"at_least": 1}, "nearest_on_the_left": {"at_least": 1}},
    {"crossing_with_priority": {"at_least": 1}},
    {"nearest_on_the_left": {"at_least": 1}},
]
"""Situations: whether a vehicle with the right of way conflicts, the nearest one is on the left, or
both; else neither."""


def rule_of(angles: Sequence[float]) -> AngleRule:
    """Return the rule of an angle in degrees for each of `CASES`, and of one elsewhere."""
    *inside, default = angles
    when = [{"angle": angle, **case} for angle, case in zip(inside, CASES, strict=True)]
    return AngleRule.of({"format": 1, "world": drivers.WORLD, "default": default, "when": when})


SWITCHES = {
    f"{first:g} {where}, else {second:g}": tuple(first if here else second for here in inside)
    for where, inside in (
        ("to the left", (True, False, True, False)),
        ("to those with priority", (True, True, False, False)),
    )
    for first, second in ((15.0, 75.0), (75.0, 15.0))
}
"""Angles in each situation of policies whose mean is near that of 45 degrees."""

EXPERTS = ("set_prosocial", "expert_prosocial")


def tried(dial: DialPolicy, weaker: DialPolicy) -> Iterator[tuple[str, float, Policy]]:
    """Yield name, declared angle in degrees and policy of every driver that is audited."""
    for angle in drivers.ANGLES:
        yield f"weaker dial, {angle:g}", angle, weaker.at(angle)
    yield "dial, 45", 45.0, dial.at(45.0)
    for name in EXPERTS:
        yield name, 45.0, atlas.load(name)
    for name, angles in SWITCHES.items():
        yield name, 45.0, ContextPolicy.of(dial, rule_of(angles))


def switching_rows(config: Any, on_stage: StageCallback) -> list[Row]:
    """Return the shares of audits of policies of one character and of two.

    Args:
        config: Configuration of the study.
        on_stage: Returns the progress callback of a stage.

    Returns:
        A row for each policy and number of episodes: share `named` in which the declared angle in
        each situation is found to be another, and the columns of `Audits.shares` without a rule.
    """
    course = course_of(make(drivers.WORLD), config.pool, config.pool_seed)
    pool = drivers.drive(course, on_stage, references_only=True)
    path = packaged_results() / SHIPPED_DIAL
    dial = DialPolicy.load(path)
    weaker = DialPolicy.load(path.with_name("timed.safetensors"))
    rows: list[Row] = []
    for name, angle, policy in tracked(list(tried(dial, weaker)), on_stage, "switching", "drivers"):
        rule = rule_of([angle] * (len(CASES) + 1))
        profile = replace(default_declaration(drivers.WORLD, angle), rule=rule)
        candidates = tuple(end for end in (angle - 30.0, angle + 30.0) if 0.0 <= end <= 90.0)
        measured = Course(course.world, course.seeds, by_rule=ByRule(rule, dial))
        driver = measured.drive(Reference(name, policy), True, candidates)
        assert driver.contexts is not None
        audits = Audits.of(drivers.WORLD, angle, pool)
        for episodes in config.lengths:
            how = episodes, config.switched, config.first_seed
            named = 0
            for drawn in resampled(config.pool, *how):
                losses = ContextLosses(*(column[drawn] for column in driver.contexts))
                named += faults_of_contexts(profile, losses, candidates, ERROR) != []
            label: Row = {"policy": name, "declared": angle, "episodes": episodes}
            label["named"] = named / config.switched
            rows.append(label | audits.shares(driver, *how))
    return rows


def compute_tables(config: Any, context: Context) -> Findings:
    """Count decisions of simulated and driven audits.

    Args:
        config: Configuration of the study.
        context: Progress callback; the study has no jobs.

    Returns:
        Tables `tests`, `orders` and `switching`.
    """
    return Findings(
        {
            "tests": test_rows(config, context.on_stage),
            "orders": order_rows(config, context.on_stage),
            "switching": switching_rows(config, context.on_stage),
        },
        {},
    )
