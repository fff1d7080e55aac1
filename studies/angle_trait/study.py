"""Angles planted in simulated traffic: are they recovered, and do they predict.

From the first half of each driver's episodes its angle is inferred as from recordings, and tested
on the second half. Planners choose by the very returns of the model, so that it is true; policies
of a dial don't, and are also inferred by another dial, near the one that drives, never equal to it.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int64
from scipy.special import softmax

from socialiq import Ending, QPolicy, UserError
from socialiq.evaluation.branching import branched_returns, observed
from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import packaged_results
from socialiq.types import Row
from socialiq.worlds.intersection import options, world
from socialiq_lab.study import Context, Findings, tracked
from socialiq_lab.tables import groups, mean
from socialiq_recordings.prediction.choices import ChoiceTable
from socialiq_recordings.trait import traits
from socialiq_recordings.trait.hierarchy import Direction, direction
from socialiq_recordings.trait.models import Models, contrasts, fit_models, models_of, sample_of
from socialiq_recordings.trait.power import before

DIAL = packaged_results() / "intersection-dial" / "dial.safetensors"
"""The dial whose policies drive; its middle ends the rollouts."""

OTHER_DIAL = packaged_results() / "intersection-dial-clock" / "calibrated.safetensors"
"""The dial that is the model of drivers: of another training, seed, network and observation."""

INFERENCES = (("planner", "returns"), ("dial", "returns"), ("dial", "another dial"))
"""Kinds of drivers, and what their angles are inferred from."""

MIXED = 10
"""Angles of the dial whose policies are the base predictor of dials; that of planners is even."""

RANDOM = 0.05  # share of random actions in it
CONFIDENCE = 0.9  # of the drivers' intervals


class Population(NamedTuple):
    """Drivers of known angles."""

    kind: str  # planner or dial
    angle: Float[np.ndarray, " driver"]  # of each driver, degrees
    strength: float  # β of planners, per unit of return


class Decided(NamedTuple):
    """Decisions of all drivers, in the order of time."""

    row: Int64[np.ndarray, " decision"]  # number of the episode, driver by driver
    log_base: Float[np.ndarray, "decision action"]  # log p of each action by the base predictor
    env: Float[np.ndarray, "decision action"]  # return of each action in r_env
    social: Float[np.ndarray, "decision action"]  # return of each action in r_social
    action: Int64[np.ndarray, " decision"]  # the action taken
    seen: Float32[np.ndarray, "decision feature"]  # what the ego observes, and the time


def drive(population: Population, dial: DialPolicy, episodes: int, first_episode: int) -> Decided:
    """Drive each driver's episodes side by side, with the returns of every action.

    After its first action a rollout follows the dial at its middle, for every driver the same.
    """
    size = len(population.angle) * episodes
    batch = world.Batch(options.Options(), size)
    rng = np.random.default_rng(first_episode)
    batch.reset(first_episode)
    middle = dial.at((dial.low + dial.high) / 2)
    mixed = [dial.at(angle) for angle in np.linspace(dial.low, dial.high, MIXED).tolist()]
    policies = [dial.at(angle) for angle in population.angle] if population.kind == "dial" else []
    driver, columns = np.repeat(np.arange(len(population.angle)), episodes), []
    running = np.ones(size, bool)
    clock = dial.n_features > batch.observation.shape[1]
    while running.any():
        returns = branched_returns(batch, lambda rows: middle.predict(rows)[0], clock)
        observation = observed(batch, clock)
        if policies:
            of_driver = observation.reshape(len(policies), episodes, -1)
            actions = [
                policy.predict(rows)[0] for policy, rows in zip(policies, of_driver, strict=True)
            ]
            action = np.concatenate(actions)
        else:
            radians = np.radians(population.angle)[driver, None]
            score = np.cos(radians) * returns.env + np.sin(radians) * returns.social
            below = softmax(population.strength * score, axis=1).cumsum(axis=1)
            action = (below < rng.random((len(below), 1)) * below[:, -1:]).sum(axis=1)
        rows = np.flatnonzero(running)
        base = base_of(mixed if policies else [], observation[rows])
        observation = observed(batch, clock=True)[rows]
        decided = (base, returns.env[rows], returns.social[rows], action[rows], observation)
        columns.append((rows, *decided))
        step = batch.step(np.where(running, action, 0), auto_reset=False, rows=running)
        running &= step.ending == int(Ending.NONE)
    return Decided(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def base_of(
    mixed: list[QPolicy], observation: Float[np.ndarray, "row feature"]
) -> Float[np.ndarray, "row action"]:
    """Return log p by the mixture of policies, a share `RANDOM` at random; even without any."""
    even = np.full((len(observation), len(options.ACTIONS)), 1 / len(options.ACTIONS))
    if not mixed:
        return np.log(even)
    chosen = [
        np.eye(len(options.ACTIONS))[policy.predict(observation[:, : policy.n_features])[0]]
        for policy in mixed
    ]
    return np.log((1 - RANDOM) * np.mean(chosen, axis=0) + RANDOM * even)


def first_episodes(decided: Decided, episodes: int, used: int) -> Decided:
    """Return the decisions of each driver's first episodes, of so many episodes."""
    is_used = decided.row % episodes < used
    return Decided(*(column[is_used] for column in decided))


def choices_of(decided: Decided, episodes: int, used: int) -> ChoiceTable:
    """Return each driver's first `used` of its `episodes` as choices; half are to infer."""
    row, log_base, env, social, action, *_ = first_episodes(decided, episodes, used)
    driver, episode = np.divmod(row, episodes)
    order = np.lexsort([np.arange(len(row)), row])
    time = np.empty(len(row))
    time[order] = np.arange(len(row))
    half = (episode >= used // 2).astype(np.int64)
    grid = np.arange(len(options.ACTIONS), dtype=np.float64) - 1.0
    off = grid[action] - np.exp(log_base) @ grid
    return ChoiceTable(
        driver=driver,
        chain=driver,
        time=time,
        half=half,
        conflict=np.ones(len(row), bool),
        grid=grid,
        log_base=log_base,
        r_env=env,
        r_social=social,
        acceleration=grid[action],
        residual=before(off, driver, time),
    )


_KEYS = ("kind", "inferred_from", "spread_planted", "episodes")


def compute_tables(config: Any, context: Context) -> Findings:
    """Drive all populations, infer and test."""
    if not config.lengths or any(length < 2 or length % 2 for length in config.lengths):
        raise UserError(f"lengths must be even numbers from 2, got {list(config.lengths)}")
    if config.drivers < 2 or config.repeats < 1:
        raise UserError("drivers must be at least 2, and repeats at least 1")
    if not config.step > 0 or 360 % config.step:
        raise UserError(f"step must divide 360, got {config.step:g}")
    dial, strength, episodes = DialPolicy.load(DIAL), strength_of(config), max(config.lengths)
    cells = [
        (kind, spread, repeat)
        for kind in dict(INFERENCES)
        for spread in config.spreads
        for repeat in range(config.repeats)
    ]
    rows: list[Row] = []
    drivers: list[Row] = []
    for number, (kind, spread, repeat) in enumerate(
        tracked(cells, context.on_stage, "planted angles", "populations"), start=1
    ):
        first = config.first_episode + number * config.drivers * episodes
        drawn = np.random.default_rng(first).standard_normal(config.drivers)
        angle = (config.mean + spread * drawn).clip(dial.low, dial.high)
        decided = drive(Population(kind, angle, strength), dial, episodes, first)
        sources = [source for driver_kind, source in INFERENCES if driver_kind == kind]
        for source, used in ((source, used) for source in sources for used in config.lengths):
            label: Row = dict(zip(_KEYS, (kind, source, spread, used), strict=True))
            label |= {"repeat": repeat}
            models = inferred(config, decided, source, used, first)
            rows.append(label | population_row(models, angle, first))
            for driver, posterior in zip(models.sample.identity, directions(models), strict=True):
                planted = {"driver": int(driver), "planted": float(angle[driver])}
                drivers.append(label | planted | posterior._asdict())
    pooled: list[Row] = []
    for values, group in groups(rows, *_KEYS).items():
        names = [name for name in group[0] if name not in (*_KEYS, "repeat")]
        means = {name: mean(group, name) for name in names}
        pooled.append(dict(zip(_KEYS, values, strict=True)) | means)
    names = ("correlation", "covered", "spread", "over population", "found", "beats_every_rival")
    summary = {
        f"{row['kind']} from {row['inferred_from']}, spread {row['spread_planted']:g}, "
        f"{row['episodes']} episodes": {name: row[name] for name in names}
        for row in pooled
    }
    return Findings({"populations": rows, "pooled": pooled, "drivers": drivers}, summary)


def strength_of(config: Any) -> float:
    """Return β of planners per unit of return, from drivers who choose at random."""
    at_random = Population("planner", np.full(config.drivers, config.mean), 0.0)
    decided = drive(at_random, DialPolicy.load(DIAL), 2, config.first_episode)
    return config.strength / traits.reward_scale(choices_of(decided, 2, 2))


def inferred(config: Any, decided: Decided, source: str, used: int, seed: int) -> Models:
    """Return the models of each driver's first episodes, from returns or another dial."""
    episodes = max(config.lengths)
    if source == "returns":
        return fit_models(choices_of(decided, episodes, used), seed, config.step)
    return fit_family(decided, episodes, used, DialPolicy.load(OTHER_DIAL), seed, config.step)


def value_scale(values: Float[np.ndarray, "decision candidate value"]) -> float:
    """Return the typical difference of value between candidates; 1 if there is none."""
    variance = values.var(axis=1, where=np.isfinite(values)) if values.size else np.zeros(1)
    scale = float(np.sqrt(variance.mean()))
    return scale if scale > traits.LEAST_SCALE else 1.0


def tabulate_family(
    values: Float[np.ndarray, "decision candidate value"],
    grid: Float[np.ndarray, " candidate"],
    trait: traits.Trait,
    random: float,
) -> traits.Tabulated:
    """Return log p(a | s) of every candidate, and the mean candidate, by β and angle of a family.

    p(a | s) = (1 - ε) softmax(β Q_α(s, .))(a) + ε / n; a value of minus infinity is no candidate.
    """
    finite = np.isfinite(values)[:, :, None, :]
    score = trait.shared[:, None] * np.where(finite, values[:, :, None, :], 0.0)
    chance = softmax(np.where(finite, score, -np.inf), axis=1)
    mixed = (1 - random) * chance + random / finite.sum(axis=1, keepdims=True)
    chance = np.where(finite, mixed, 0.0)
    log_p = np.log(np.maximum(chance, np.finfo(np.float64).tiny))
    return traits.Tabulated(log_p, np.einsum("dcsv,c->dsv", chance, grid))


def fit_family(
    decided: Decided, episodes: int, used: int, dial: DialPolicy, seed: int, step: float
) -> Models:
    """Infer angles with the policies of a dial as the model of drivers (`fit_models`).

    Its policies mixed are the base predictor of the rivals; `step` is in degrees.
    """
    angle = np.linspace(dial.low, dial.high, max(2, round((dial.high - dial.low) / step) + 1))
    policies = [dial.at(value) for value in angle.tolist()]
    decisions = first_episodes(decided, episodes, used)
    decisions = decisions._replace(log_base=base_of(policies, decisions.seen))
    sample = sample_of(choices_of(decisions, episodes, used))
    values = np.stack([policy.q_values(decisions.seen) for policy in policies], axis=2)
    trait = traits.family_trait(angle, scale=value_scale(values))
    every = tabulate_family(values, sample.table.grid, trait, RANDOM)
    of_chosen = every.at(np.arange(len(sample.table)), sample.table.chosen)
    gain = traits.progress_trait(scale=traits.reward_scale(sample.table))
    of_gain = traits.evaluate(sample.table, gain)
    return models_of(sample, trait, of_chosen, gain, of_gain, seed, every=every)


def directions(models: Models) -> list[Direction]:
    """Return the inferred angle of each driver, with its interval."""
    posteriors, grid = models.angle.drivers.sum(axis=1), models.angle.population.trait.value
    return [direction(grid, density, CONFIDENCE) for density in posteriors]


def population_row(models: Models, angle: Float[np.ndarray, " driver"], seed: int) -> Row:
    """Return how angles are recovered, and what they predict beyond each rival."""
    tests = contrasts(models, seed % 2**31)
    return {
        "decisions": len(models.sample.table),
        **recovery(models, angle[models.sample.identity]),
        **{f"over {test['angle_over']}": test["gain_nats"] for test in tests},
        "p_holm": tests[0]["p_holm"],
        "found": float(tests[0]["found"]),
        "beats_every_rival": float(all(entry["found"] for entry in tests)),
    }


def recovery(models: Models, angle: Float[np.ndarray, " driver"]) -> Row:
    """Return how the inferred angles compare with the planted ones; 0 for no correlation."""
    posteriors = directions(models)
    means = np.array([entry.angle for entry in posteriors])
    grid = models.angle.population.trait.value
    half_step = (grid[1] - grid[0]) / 2
    covered = [
        entry.low - half_step <= truth <= entry.high + half_step
        for entry, truth in zip(posteriors, angle, strict=True)
    ]
    varied = np.ptp(angle) > 0 and np.ptp(means) > 0
    low, middle, high = models.angle.population.quantiles("spread", (0.025, 0.5, 0.975))
    return {
        "correlation": float(np.corrcoef(angle, means)[0, 1]) if varied else 0.0,
        "mean_inferred": float(means.mean()),
        "error": float(np.abs(means - angle).mean()),
        "covered": float(np.mean(covered)),
        "spread": middle,
        "spread_low": low,
        "spread_high": high,
    }
