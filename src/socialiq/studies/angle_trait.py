"""Angles planted in simulated traffic: are they recovered, and do they predict.

Drivers of known angles drive the intersection, each its own episodes. From the first half of its
episodes the angle of each is inferred as from recordings (`recordings.trait`), and tested on the
second half. A candidate's rewards are the returns of a rollout that takes it first. Two kinds of
drivers: planners choose by these very returns, so that the inferred model is true; dials are the
policies of one trained dial, whose own values are not known to the inference.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int64
from matplotlib.figure import Figure
from scipy.special import softmax

from socialiq.errors import UserError
from socialiq.evaluation.branching import branched_returns
from socialiq.experiments.results import Results
from socialiq.experiments.study import Context, Findings, Study, counter, view_of
from socialiq.experiments.tables import groups, matching, mean
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.plotting.style import COLORS, figure, finish
from socialiq.recordings.prediction.choices import ChoiceTable
from socialiq.recordings.trait.choice_model import reward_scale
from socialiq.recordings.trait.contrasts import contrasts
from socialiq.recordings.trait.hierarchy import direction
from socialiq.recordings.trait.models import Models, fit_models
from socialiq.recordings.trait.power import before
from socialiq.storage import packaged_results
from socialiq.types import Ending, RewardPair, Row
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.state import ACTIONS

DIAL = packaged_results() / "intersection-dial" / "dial.safetensors"
KINDS = ("planner", "dial")
MIXED = 10
"""Angles of the dial whose policies are the base predictor of dials; that of planners is even."""

RANDOM = 0.05
"""Share of random actions in it."""

CONFIDENCE = 0.9
"""Of the drivers' intervals."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    first_episode: int = 61_000_000
    """Seed of the first episode. 50,000,000 to 50,999,999 were used in development."""
    repeats: int = 2
    """Populations of each kind and spread."""
    drivers: int = 30
    """Drivers of a population."""
    lengths: tuple[int, ...] = (2, 16)
    """Episodes of a driver that are used, half to infer and half to test."""
    mean: float = 45.0
    """Mean of the planted angles, degrees."""
    spreads: tuple[float, ...] = (0.0, 25.0)
    """Standard deviations of the planted angles; angles are cut off at 0 and 90 degrees."""
    strength: float = 3.0
    """β of planners, per typical difference of returns."""
    step: float = 10.0
    """Of the angles integrated over, degrees."""

    def __post_init__(self) -> None:
        """Check what no population can be made of."""
        if not self.lengths or any(one < 2 or one % 2 for one in self.lengths):
            raise UserError(f"lengths must be even numbers from 2, got {list(self.lengths)}")
        if self.drivers < 2 or self.repeats < 1:
            raise UserError("drivers must be at least 2, and repeats at least 1")
        if not self.step > 0 or 360 % self.step:
            raise UserError(f"step must divide 360, got {self.step:g}")


class Population(NamedTuple):
    """Drivers of known angles.

    Attributes:
        kind: One of `KINDS`.
        angle: Of each driver, degrees.
        strength: β of planners, per unit of return.
    """

    kind: str
    angle: Float[np.ndarray, " driver"]
    strength: float


class Decided(NamedTuple):
    """Decisions of all drivers, in the order of time.

    Attributes:
        row: Number of the episode, driver by driver.
        log_base: log p of each action by the base predictor.
        env: Return of each action in r_env.
        social: Return of each action in r_social.
        action: The action taken.
    """

    row: Int64[np.ndarray, " decision"]
    log_base: Float[np.ndarray, "decision action"]
    env: Float[np.ndarray, "decision action"]
    social: Float[np.ndarray, "decision action"]
    action: Int64[np.ndarray, " decision"]


def drive(population: Population, dial: DialPolicy, episodes: int, first_episode: int) -> Decided:
    """Drive every driver's episodes side by side, with the returns of every action.

    After its first action a rollout follows the dial at its middle, for every driver the same.

    Args:
        population: The drivers.
        dial: The trained dial.
        episodes: Number of episodes of each driver.
        first_episode: Seed of the first episode.
    """
    size = len(population.angle) * episodes
    batch, copies = Batch(Options(), size), Batch(Options(), size * len(ACTIONS))
    rng = np.random.default_rng(first_episode)
    batch.reset(first_episode)
    middle = dial.at((dial.low + dial.high) / 2)
    mixed = [dial.at(angle) for angle in np.linspace(dial.low, dial.high, MIXED).tolist()]
    policies = [dial.at(angle) for angle in population.angle] if population.kind == "dial" else []
    driver, found = np.repeat(np.arange(len(population.angle)), episodes), []
    running = np.ones(size, bool)
    while running.any():
        returns = branched_returns(batch, copies, lambda seen: middle.predict(seen)[0])
        if policies:
            seen = batch.observation.reshape(len(policies), episodes, -1)
            each = [one.predict(rows)[0] for one, rows in zip(policies, seen, strict=True)]
            action = np.concatenate(each)
        else:
            action = _planned(population, returns, driver, rng)
        rows = np.flatnonzero(running)
        base = _base(mixed if policies else [], batch.observation[rows])
        found.append((rows, base, returns.env[rows], returns.social[rows], action[rows]))
        made = batch.step(np.where(running, action, 0), auto_reset=False, rows=running)
        running &= made.ending == int(Ending.NONE)
    return Decided(*(np.concatenate(column) for column in zip(*found, strict=True)))


def _base(
    mixed: list[QPolicy], seen: Float[np.ndarray, "row feature"]
) -> Float[np.ndarray, "row action"]:
    """Return log p by the mixture of some policies, with `RANDOM` of random actions."""
    even = np.full((len(seen), len(ACTIONS)), 1 / len(ACTIONS))
    if not mixed:
        return np.log(even)
    chosen = [np.eye(len(ACTIONS))[one.predict(seen)[0]] for one in mixed]
    return np.log((1 - RANDOM) * np.mean(chosen, axis=0) + RANDOM * even)


def _planned(
    population: Population,
    returns: RewardPair,
    driver: Int64[np.ndarray, " row"],
    rng: np.random.Generator,
) -> Int64[np.ndarray, " row"]:
    """Draw actions with probabilities in proportion to exp(β R(α)) of the returns."""
    radians = np.radians(population.angle)[driver, None]
    score = np.cos(radians) * returns.env + np.sin(radians) * returns.social
    below = softmax(population.strength * score, axis=1).cumsum(axis=1)
    return (below < rng.random((len(below), 1)) * below[:, -1:]).sum(axis=1)


def choices_of(decided: Decided, episodes: int, used: int) -> ChoiceTable:
    """Return the decisions of each driver's first episodes as choices.

    Every driver drives alone, so that each is a chain.

    Args:
        decided: All decisions.
        episodes: Episodes of a driver in `decided`.
        used: Episodes of a driver to use: half of them to infer.
    """
    kept = decided.row % episodes < used
    row, log_base, env, social, action = (column[kept] for column in decided)
    driver, episode = np.divmod(row, episodes)
    order = np.lexsort([np.arange(len(row)), row])
    time = np.empty(len(row))
    time[order] = np.arange(len(row))
    half = (episode >= used // 2).astype(np.int64)
    grid = np.arange(len(ACTIONS), dtype=np.float64) - 1.0
    off = grid[action] - np.exp(log_base) @ grid
    return ChoiceTable(
        driver=driver,
        chain=driver,
        site=np.zeros_like(driver),
        time=time,
        half=half,
        conflict=np.ones(len(row), bool),
        moving=np.ones(len(row), bool),
        grid=grid,
        log_base=log_base,
        r_env=env,
        r_social=social,
        acceleration=grid[action],
        residual=before(off, driver, time),
    )


def recovery(models: Models, angle: Float[np.ndarray, " driver"]) -> Row:
    """Return how the inferred angles compare with the planted ones; 0 for no correlation.

    Args:
        models: Of all drivers.
        angle: Planted angles, degrees.
    """
    posterior = models.angle.drivers.sum(axis=1)
    found = [direction(models.trait.value, one, CONFIDENCE) for one in posterior]
    inferred = np.array([one.angle for one in found])
    half_step = (models.trait.value[1] - models.trait.value[0]) / 2
    covered = [
        one.low - half_step <= truth <= one.high + half_step
        for one, truth in zip(found, angle, strict=True)
    ]
    varied = np.ptp(angle) > 0 and np.ptp(inferred) > 0
    low, middle, high = models.angle.population.quantiles("spread", (0.025, 0.5, 0.975))
    return {
        "correlation": float(np.corrcoef(angle, inferred)[0, 1]) if varied else 0.0,
        "mean_inferred": float(inferred.mean()),
        "error": float(np.abs(inferred - angle).mean()),
        "covered": float(np.mean(covered)),
        "spread": middle,
        "spread_low": low,
        "spread_high": high,
    }


def compute_tables(config: Config, context: Context) -> Findings:
    """Drive all populations, infer and test."""
    dial, strength = DialPolicy.load(DIAL), _strength(config)
    cells = [
        (kind, spread, repeat)
        for kind in KINDS
        for spread in config.spreads
        for repeat in range(config.repeats)
    ]
    count = counter(context.on_stage, "planted angles", len(cells), "populations")
    rows: list[Row] = []
    drivers: list[Row] = []
    for number, (kind, spread, repeat) in enumerate(cells):
        first = config.first_episode + (number + 1) * config.drivers * max(config.lengths)
        rng = np.random.default_rng(first)
        drawn = config.mean + spread * rng.standard_normal(config.drivers)
        angle = drawn.clip(dial.low, dial.high)
        decided = drive(Population(kind, angle, strength), dial, max(config.lengths), first)
        for used in config.lengths:
            head = {"kind": kind, "spread_planted": spread, "episodes": used, "repeat": repeat}
            table = choices_of(decided, max(config.lengths), used)
            models = fit_models(table, first, config.step)
            rows.append(head | _row(models, angle, first))
            drivers += _drivers(head, models, angle)
        count(number + 1)
    pooled = [_pooled(values, group) for values, group in groups(rows, *_KEYS).items()]
    return Findings({"populations": rows, "pooled": pooled, "drivers": drivers}, _summary(pooled))


_KEYS = ("kind", "spread_planted", "episodes")


def _strength(config: Config) -> float:
    """Return β of planners per unit of return, from drivers who choose at random."""
    dial = DialPolicy.load(DIAL)
    at_random = Population("planner", np.full(config.drivers, config.mean), 0.0)
    decided = drive(at_random, dial, 2, config.first_episode)
    return config.strength / reward_scale(choices_of(decided, 2, 2))


def _row(models: Models, angle: Float[np.ndarray, " driver"], seed: int) -> Row:
    tests = contrasts(models, seed % 2**31)
    sample = models.sample
    return {
        "decisions": len(sample.table),
        **recovery(models, angle[sample.identity]),
        **{f"over {one['angle_over']}": one["gain_nats"] for one in tests},
        "p_holm": tests[0]["p_holm"],
        "found": float(tests[0]["found"]),
        "beats_every_rival": float(all(one["found"] for one in tests)),
    }


def _drivers(head: Row, models: Models, angle: Float[np.ndarray, " driver"]) -> list[Row]:
    posterior = models.angle.drivers.sum(axis=1)
    rows = []
    for number, one in zip(models.sample.identity.tolist(), posterior, strict=True):
        found = direction(models.trait.value, one, CONFIDENCE)
        rows.append(head | {"driver": number, "planted": float(angle[number])} | found._asdict())
    return rows


def _pooled(values: tuple[Any, ...], group: list[Row]) -> Row:
    """Return the means over repeats."""
    names = [name for name in group[0] if name not in (*_KEYS, "repeat")]
    return dict(zip(_KEYS, values, strict=True)) | {name: mean(group, name) for name in names}


def _summary(pooled: list[Row]) -> dict[str, Any]:
    names = ("correlation", "covered", "spread", "over population", "found", "beats_every_rival")
    return {
        f"{row['kind']}, spread {row['spread_planted']:g}, {row['episodes']} episodes": {
            name: row[name] for name in names
        }
        for row in pooled
    }


def draw(results: Results) -> dict[str, Figure]:
    """Draw the inferred angles over the planted ones, by kind and number of episodes."""
    rows = results.tables["drivers"]
    used = sorted({row["episodes"] for row in rows})
    drawn = figure(4.2 * len(used), 7.4)
    panels = drawn.subplots(len(KINDS), len(used), sharex=True, sharey=True, squeeze=False)
    for line, kind in zip(panels, KINDS, strict=True):
        for axes, episodes in zip(line, used, strict=True):
            _panel(
                axes, matching(rows, kind=kind, episodes=episodes), f"{kind}, {episodes} episodes"
            )
    return {"angles": drawn}


def _panel(axes: Any, rows: list[Row], title: str) -> None:
    axes.plot([0, 90], [0, 90], color="#888888", linewidth=1.0)
    for spread, color in zip((True, False), ("prosocial", "egoistic"), strict=True):
        mine = [row for row in rows if (row["spread_planted"] > 0) == spread]
        axes.plot(
            [row["planted"] for row in mine],
            [row["angle"] for row in mine],
            "." if spread else "x",
            color=COLORS[color],
            alpha=0.6,
            label="angles differ" if spread else "all drivers alike",
        )
    finish(axes, title, 8, xlabel="planted angle, degrees", ylabel="inferred angle, degrees")


STUDY = Study(
    name="angle-trait",
    Config=Config,
    tables=compute_tables,
    figures=draw,
    view=view_of(
        "pooled",
        *_KEYS,
        "correlation",
        "covered",
        "spread",
        "over population",
        "over progress gain",
        "found",
        "beats_every_rival",
        title="Planted angles: means over repeats",
    ),
)
