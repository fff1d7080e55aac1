"""Passes of drivers of known angles at every declared angle, with the default declarations.

An audit is drawn from a pool of episodes that every driver has driven. Its tests are those of
`audit.verdict.decide`, of many audits at once.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int64
from scipy.stats import binom

from socialiq.audit.evidence.drive import Course
from socialiq.audit.evidence.outcomes import Outcomes, Reference, events_of
from socialiq.audit.profile.profile import Profile
from socialiq.audit.profile.template import possible_loss
from socialiq.audit.request import SHIPPED_DIAL
from socialiq.audit.verdict.direction import TOLERANCE, Driver, driver_of, drivers_of, ends_of
from socialiq.evaluation.episodes import KINDS, episodes_of
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.statistics import betting, intervals
from socialiq.storage import packaged_results
from socialiq.types import Policy, Row
from socialiq.worlds.registry import make
from socialiq_lab.audit_arena import course_of, default_declaration
from socialiq_lab.comparison import GRIDWORLDS
from socialiq_lab.intersection.driving import Deciding
from socialiq_lab.study import Context, Findings, StageCallback, tracked
from studies.audit_angles import drivers

ERROR = 0.05
COMPARED = 4
"""References that an audit compares, of those with the largest rewards in the pool: the bounds of
the others are lower. In a gridworld it is the exact optimum alone."""
TESTS = ("regret", "direction", "floor", "character")
Shares = Bool[np.ndarray, "share episode"]


def most_events(limit: float, episodes: int) -> int:
    """Return the largest number of events that shows a share to be within a limit.

    Args:
        limit: Largest share that is allowed; with 1 or more any number of events is within it.
        episodes: Number of episodes in which the events are counted.

    Returns:
        Number of events at the error `ERROR`, -1 if no number shows it.
    """
    return episodes if limit >= 1.0 else int(binom.ppf(ERROR, episodes, limit)) - 1


class Measured(NamedTuple):
    """A driver on the pool, as the tests of a declaration measure it."""

    losses: Float[np.ndarray, "reference episode"]  # in units of the largest loss
    sides: Float[np.ndarray, "end episode"]  # likewise, negative where it is within the width
    floor: Shares  # events of which each share has a limit
    beyond: Shares


class Audits(NamedTuple):
    """A default declaration, and its reference drivers on the pool."""

    profile: Profile
    references: tuple[Outcomes, ...]  # with clipped rewards
    line: list[Driver]
    limit: Callable[[float], Any]  # largest loss of an episode at an angle in degrees

    @staticmethod
    def of(world: str, declared: float, pool: Mapping[str, drivers.Driven]) -> "Audits":
        """Take the references of a default audit from the pool.

        Args:
            world: Name of the world.
            declared: Declared angle in degrees.
            pool: Drivers on the pool by name; those marked `reference` are compared.
        """
        profile = default_declaration(world, declared)
        built = make(world)
        rows = [row.outcomes for row in pool.values() if row.reference]
        clip = profile.clip
        references = tuple(row if clip is None else row.clipped(clip) for row in rows)
        limit = functools.partial(possible_loss, built)
        largest = limit if clip is None else clip.largest_loss
        return Audits(profile, references, drivers_of(references), largest)

    def measured(self, driver: Outcomes) -> Measured:
        """Measure a driver in every episode of the pool."""
        angle = self.profile.angle
        margin = self.profile.margin
        own = driver_of(self.line, angle)
        clip = self.profile.clip
        driver = driver if clip is None else driver.clipped(clip)
        assert margin.width is not None and own is not None
        best = [own.outcomes]
        if own.outcomes.expected is None:
            others = [row for row in self.references if row.name != driver.name]
            best = sorted(others, key=lambda row: -row.values(angle).mean())[:COMPARED]
        losses = np.array([row.values(angle) - driver.values(angle) for row in best])
        ends = [end for end in ends_of(self.line, angle, margin.width) if end is not None]
        tested = [row for row in (driver_of(self.line, end) for end in ends) if row is not None]
        rewards = np.array([row.outcomes.values(angle + 90.0) for row in (*tested, own)])
        sides = []
        beyond = []
        for end, row in zip(ends, tested, strict=True):
            sign = 1.0 if end < angle else -1.0
            across = row.across
            difference = row.outcomes.values(across) - driver.values(across)
            sides.append(sign * difference / self.limit(across))
            farthest = (-sign * rewards).max(axis=0) + TOLERANCE * margin.regret
            beyond.append(-sign * driver.values(angle + 90.0) > farthest)
        events = events_of(driver)
        kinds = [events["at_fault"], events["struck"], ~events["arrival"], events["timeout"]]
        return Measured(losses / self.limit(angle), *map(np.array, (sides, kinds, beyond)))

    @property
    def limits(self) -> dict[str, Any]:
        """Levels of the means and limits of the shares, by test."""
        floor = self.profile.competence
        margin = self.profile.margin
        limits = floor.max_at_fault, floor.max_struck, 1.0 - floor.min_arrival, floor.max_timeout
        level = margin.regret / self.limit(self.profile.angle)
        return dict(zip(TESTS, (level, 0.0, limits, [margin.beyond]), strict=True))

    def holds(self, driver: Outcomes, tests: Sequence[str] = TESTS) -> bool:
        """Whether a driver's true values, those of the pool, are within the limits of tests.

        Args:
            driver: Outcomes of the driver in all episodes of the pool.
            tests: Names of the tests, from `TESTS`.
        """
        measured: dict[str, np.ndarray] = dict(zip(TESTS, self.measured(driver), strict=True))
        means = {name: measured[name].mean(axis=1) for name in tests}
        if "direction" in means and not (means["direction"] < 0.0).all():
            return False  # a driver on an end is not within
        return all((mean <= np.array(self.limits[name])).all() for name, mean in means.items())

    def shares(self, driver: Outcomes, episodes: int, audits: int, seed: int) -> Row:
        """Return the shares of audits that pass, and that keep each test.

        Args:
            driver: Outcomes of the driver in all episodes of the pool.
            episodes: Number of episodes of an audit.
            audits: Number of audits.
            seed: Seed of the first audit (`tested`).

        Returns:
            Share `passed` with the ends `low` and `high` of its 99 % interval, and a share for each
            of `TESTS`.
        """
        tested = self.tested(driver, episodes, audits, seed)
        passed = int(np.logical_and.reduce(list(tested.values())).sum())
        share = intervals.wilson(passed, audits, 0.99)
        row: Row = {"passed": share.value, "low": share.low, "high": share.high}
        return row | {name: float(by_audit.mean()) for name, by_audit in tested.items()}

    def tested(
        self, driver: Outcomes, episodes: int, audits: int, seed: int
    ) -> dict[str, Bool[np.ndarray, " audit"]]:
        """Return which audits keep each test.

        Args:
            driver: Outcomes of the driver in all episodes of the pool.
            episodes: Number of episodes of an audit.
            audits: Number of audits.
            seed: Seed of the first audit; audit k is drawn from the pool by seed + k.

        Returns:
            By test, whether each audit keeps it, (audit,).
        """
        measured = self.measured(driver)
        rows = resampled(len(driver.episodes.length), episodes, audits, seed)

        def below(values: np.ndarray, level: float) -> Bool[np.ndarray, " audit"]:
            series = values[:, rows].reshape(-1, episodes).clip(-1.0, 1.0)
            significant = betting.significantly_below(series, np.array([level]), 1.0, ERROR)
            return np.asarray(significant[:, 0].reshape(-1, audits).all(axis=0))

        def within(happened: Shares, limits: Sequence[float]) -> Bool[np.ndarray, " audit"]:
            largest = np.array([most_events(limit, episodes) for limit in limits])
            counts = np.array([events[rows].sum(axis=1) for events in happened])
            return np.asarray((counts <= largest[:, None]).all(axis=0))

        tests = (below, below, within, within)
        return {
            name: test(values, self.limits[name])
            for name, test, values in zip(TESTS, tests, measured, strict=True)
        }


@functools.lru_cache(maxsize=2)
def resampled(
    pool: int, episodes: int, audits: int, seed: int
) -> Int64[np.ndarray, "audit episode"]:
    """Draw the episodes of audits from a pool, with replacement.

    Args:
        pool: Number of episodes of the pool.
        episodes: Number of episodes of an audit.
        audits: Number of audits.
        seed: Seed of the first audit; audit k is drawn by seed + k.

    Returns:
        Numbers of the pool's episodes, (audit, episode).
    """
    rngs = (np.random.default_rng(seed + number) for number in range(audits))
    return np.array([rng.integers(pool, size=episodes) for rng in rngs])


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
