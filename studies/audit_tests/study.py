"""Error rates of each test of an audit by the shape of an episode's rewards.

Drivers on a made-up front of the angles are within, on or beyond the limit of every test. Their
deviations have ties, no spread, heavy tails, rare losses, or follow the episode before. At the
intersection, policies of two characters switch between them in the middle of an episode.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr, stdtrit

from socialiq import Ending
from socialiq.audit.evidence.outcomes import Evidence, Outcomes, Reference
from socialiq.audit.profile.profile import Bound
from socialiq.audit.request import DIAL, SHIPPED_DIAL
from socialiq.audit.verdict.bounds import bound_tests
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.direction import character_test, direction_test
from socialiq.audit.verdict.regret import Regrets, regret_test
from socialiq.audit.verdict.results import order_dependence
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle import exact_weights
from socialiq.storage import packaged_results
from socialiq.types import Row
from socialiq.worlds.highway.options import Contact
from socialiq.worlds.intersection import policies
from socialiq.worlds.registry import make
from socialiq_lab.audit_arena import course_of, default_declaration
from socialiq_lab.intersection.driving import Deciding
from socialiq_lab.study import Context, Findings, StageCallback, tracked
from studies.audit_angles import drivers
from studies.audit_angles.study import ERROR, Audits
from studies.audit_power.power import outcomes, shares

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


def decisions_of(shape: str, place: float, episodes: int, seed: int) -> dict[str, Decision]:
    """Return the decision of each test of a driver whose every measure has one position.

    Args:
        shape: One of `SHAPES`.
        place: One of the values of `POSITIONS`.
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
    loss = place * margin.regret
    turn = (loss - place * LENGTH) * ahead / aside  # so that D(30) is 0 on the limit
    rewards = np.outer(LENGTH - loss - SPREAD * lost, along)
    rewards += np.outer(turn - SPREAD * turned, across)
    delay = EFFECT.limit * (place + delayed)
    evidence = driven(rewards, chance < place * FLOOR.limit, delay)
    mixed = np.tile(LENGTH * along, (episodes, 1))
    mixed[chance < place * margin.beyond] += BEYOND * across
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
        config: Configuration of the study; `audits` are enough where a memory is to be found.
        on_stage: Returns the progress callback of a stage.
    """
    rows: list[Row] = []
    still = np.zeros(config.episodes)
    for shape, deviations in tracked(list(SHAPES.items()), on_stage, "order", "shapes"):
        audits = config.audits if shape in MEMORIES else config.orders
        found = 0
        for seed in range(config.first_seed, config.first_seed + audits):
            rng = np.random.default_rng([seed, list(SHAPES).index(shape)])
            rewards = deviations(latent_of(shape, rng, config.episodes, 2))
            found += order_dependence(driven(rewards, still > 0.0, still)) != ""
        rows.append({"shape": shape, "audits": audits} | shares(audits, found=found))
    return rows


def nearest_on_the_left(observation: np.ndarray) -> np.ndarray:
    """Return whether the nearest vehicle, of those that conflict if any do, is on the ego's left.

    Args:
        observation: Batch of observations of the intersection without the time.
    """
    rows = policies.in_metres(observation)
    cos = rows[:, :1, 5]
    sin = rows[:, :1, 6]
    x, y = (rows[:, 1:, column] - rows[:, :1, column] for column in (1, 2))
    meets = policies.conflict(rows, 3.0)
    away = np.where(rows[:, 1:, 0] > 0, np.hypot(x, y), np.inf)
    away = np.where(meets | ~meets.any(axis=1, keepdims=True), away, np.inf)
    leftwards = x * sin - y * cos  # the axis y points to the right of x
    return np.take_along_axis(leftwards, away.argmin(axis=1)[:, None], axis=1)[:, 0] > 0.0


def right_of_way(observation: np.ndarray) -> np.ndarray:
    """Return whether a vehicle of the crossing road conflicts, to which the ego has to yield.

    Args:
        observation: Batch of observations of the intersection without the time.
    """
    rows = policies.in_metres(observation)
    crossing = np.abs(rows[:, 1:, 3]) > np.abs(rows[:, 1:, 4])
    return (policies.conflict(rows, 3.0) & crossing).any(axis=1)


SWITCHES = {"left": nearest_on_the_left, "right of way": right_of_way}
"""Situations in which a policy has its first character."""

PAIRS = ((15.0, 75.0), (75.0, 15.0))


def switching_rows(config: Any, on_stage: StageCallback) -> list[Row]:
    """Return the shares of audits at 45 degrees that the dial and policies of two angles pass.

    Args:
        config: Configuration of the study.
        on_stage: Returns the progress callback of a stage.

    Returns:
        A row for each policy and number of episodes, with the columns of `Audits.shares`.
    """
    course = course_of(make(drivers.WORLD), config.pool, config.pool_seed)
    pool = drivers.drive(course, on_stage, references_only=True)
    audits = Audits.of(drivers.WORLD, 45.0, pool)
    dial = DialPolicy.load(packaged_results() / SHIPPED_DIAL)
    features = course.world.n_features
    tried: dict[str, Outcomes] = {"45 always": pool[f"{DIAL}45"].outcomes}
    for name, switch in SWITCHES.items():
        for first, second in PAIRS:
            here = dial.at(first)
            elsewhere = dial.at(second)

            def decide(rows: np.ndarray, switch=switch, here=here, elsewhere=elsewhere):
                actions = here.predict(rows)[0], elsewhere.predict(rows)[0]
                return np.where(switch(rows[:, :features]), *actions)

            title = f"{first:g} where {name}, else {second:g}"
            policy = Deciding(here.n_features, decide)
            tried[title] = course.drive(Reference(title, policy))
    return [
        {"policy": name, "episodes": episodes}
        | audits.shares(driver, episodes, config.switched, config.first_seed)
        for name, driver in tracked(list(tried.items()), on_stage, "audits", "policies")
        for episodes in config.lengths
    ]


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
