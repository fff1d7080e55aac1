"""Angles planted in simulated traffic: are they recovered, and do they predict.

Drivers of known angles drive the intersection, each its own episodes. From the first half of its
episodes the angle of each is inferred as from recordings (`recordings.trait`), and tested on the
second half. Two kinds of drivers: planners, and policies of one trained dial. Angles are inferred
from returns, where a candidate's rewards are those of a rollout that takes it first: planners
choose by these very returns, so that the model is true, and dials don't. And from another dial,
whose policies are the model of drivers: near the one that drives, and never equal to it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.special import softmax

from socialiq.nn.dial_policy import DialPolicy
from socialiq.plotting.style import COLORS, figure, finish
from socialiq.results_folder import Results
from socialiq.types import Row
from socialiq_lab.study import Context, Findings, Study, counter, view_of
from socialiq_lab.tables import groups, matching, mean
from socialiq_recordings.trait import traits
from socialiq_recordings.trait.hierarchy import direction
from socialiq_recordings.trait.models import Models, contrasts, fit_models, models_of, sample_of
from studies.angle_trait.driving import (
    CONFIDENCE,
    DIAL,
    INFERENCES,
    OTHER_DIAL,
    RANDOM,
    Config,
    Decided,
    Population,
    base_of,
    choices_of,
    drive,
    first_episodes,
)


def fit_family(
    decided: Decided, episodes: int, used: int, dial: DialPolicy, seed: int, step: float
) -> Models:
    """Infer angles with the policies of a dial as the model of drivers (`fit_models`).

    Its policies mixed are the base predictor of the rivals.

    Args:
        decided: All decisions.
        episodes: Episodes of a driver in `decided`.
        used: Episodes of a driver to use: half of them to infer.
        dial: The dial; it observes the time.
        seed: Of the shuffling.
        step: Of the angles integrated over, degrees.
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

    p(a | s) = (1 - ε) softmax(β Q_α(s, .))(a) + ε / n, with ε = `random` the share of choices at
    random among the n candidates. One whose value Q_α(s, a) is minus infinity is none.
    """
    finite = np.isfinite(values)[:, :, None, :]
    score = trait.shared[:, None] * np.where(finite, values[:, :, None, :], 0.0)
    chance = softmax(np.where(finite, score, -np.inf), axis=1)
    mixed = (1 - random) * chance + random / finite.sum(axis=1, keepdims=True)
    chance = np.where(finite, mixed, 0.0)
    log_p = np.log(np.maximum(chance, np.finfo(np.float64).tiny))
    return traits.Tabulated(log_p, np.einsum("dcsv,c->dsv", chance, grid))


def recovery(models: Models, angle: Float[np.ndarray, " driver"]) -> Row:
    """Return how the inferred angles compare with the planted ones; 0 for no correlation.

    Args:
        models: Of all drivers.
        angle: Planted angles, degrees.
    """
    posterior, grid = models.angle.drivers.sum(axis=1), models.angle.population.trait.value
    directions = [direction(grid, density, CONFIDENCE) for density in posterior]
    inferred = np.array([entry.angle for entry in directions])
    half_step = (grid[1] - grid[0]) / 2
    covered = [
        inferred_direction.low - half_step <= truth <= inferred_direction.high + half_step
        for inferred_direction, truth in zip(directions, angle, strict=True)
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
        for kind in dict(INFERENCES)
        for spread in config.spreads
        for repeat in range(config.repeats)
    ]
    count = counter(context.on_stage, "planted angles", len(cells), "populations")
    rows: list[Row] = []
    drivers: list[Row] = []
    for number, (kind, spread, repeat) in enumerate(cells):
        first = config.first_episode + (number + 1) * config.drivers * max(config.lengths)
        planted = config.mean + spread * np.random.default_rng(first).standard_normal(
            config.drivers
        )
        angle = planted.clip(dial.low, dial.high)
        decided = drive(Population(kind, angle, strength), dial, max(config.lengths), first)
        for source in [source for driver_kind, source in INFERENCES if driver_kind == kind]:
            for used in config.lengths:
                head = dict(zip(_KEYS, (kind, source, spread, used), strict=True))
                models = _inferred(config, decided, source, used, first)
                rows.append(head | {"repeat": repeat} | _row(models, angle, first))
                drivers += _drivers(head | {"repeat": repeat}, models, angle)
        count(number + 1)
    pooled = [_pooled(values, group) for values, group in groups(rows, *_KEYS).items()]
    return Findings({"populations": rows, "pooled": pooled, "drivers": drivers}, _summary(pooled))


def _inferred(config: Config, decided: Decided, source: str, used: int, seed: int) -> Models:
    """Return the models of each driver's first episodes, from returns or another dial."""
    episodes = max(config.lengths)
    if source == "returns":
        return fit_models(choices_of(decided, episodes, used), seed, config.step)
    other_dial = DialPolicy.load(OTHER_DIAL)
    return fit_family(decided, episodes, used, other_dial, seed, config.step)


_KEYS = ("kind", "inferred_from", "spread_planted", "episodes")


def _strength(config: Config) -> float:
    """Return β of planners per unit of return, from drivers who choose at random."""
    dial = DialPolicy.load(DIAL)
    at_random = Population("planner", np.full(config.drivers, config.mean), 0.0)
    decided = drive(at_random, dial, 2, config.first_episode)
    return config.strength / traits.reward_scale(choices_of(decided, 2, 2))


def _row(models: Models, angle: Float[np.ndarray, " driver"], seed: int) -> Row:
    tests = contrasts(models, seed % 2**31)
    sample = models.sample
    return {
        "decisions": len(sample.table),
        **recovery(models, angle[sample.identity]),
        **{f"over {test['angle_over']}": test["gain_nats"] for test in tests},
        "p_holm": tests[0]["p_holm"],
        "found": float(tests[0]["found"]),
        "beats_every_rival": float(all(entry["found"] for entry in tests)),
    }


def _drivers(head: Row, models: Models, angle: Float[np.ndarray, " driver"]) -> list[Row]:
    posterior, grid = models.angle.drivers.sum(axis=1), models.angle.population.trait.value
    rows = []
    for number, density in zip(models.sample.identity.tolist(), posterior, strict=True):
        inferred = direction(grid, density, CONFIDENCE)
        rows.append(head | {"driver": number, "planted": float(angle[number])} | inferred._asdict())
    return rows


def _pooled(values: tuple[Any, ...], group: list[Row]) -> Row:
    """Return the means over repeats."""
    names = [name for name in group[0] if name not in (*_KEYS, "repeat")]
    return dict(zip(_KEYS, values, strict=True)) | {name: mean(group, name) for name in names}


def _summary(pooled: list[Row]) -> dict[str, Any]:
    names = ("correlation", "covered", "spread", "over population", "found", "beats_every_rival")
    return {
        f"{row['kind']} from {row['inferred_from']}, spread {row['spread_planted']:g}, "
        f"{row['episodes']} episodes": {name: row[name] for name in names}
        for row in pooled
    }


def draw(results: Results) -> dict[str, Figure]:
    """Draw the inferred angles over the planted ones, by inference and number of episodes."""
    rows = results.tables["drivers"]
    used = sorted({row["episodes"] for row in rows})
    picture = figure(4.2 * len(used), 3.7 * len(INFERENCES))
    panels = picture.subplots(len(INFERENCES), len(used), sharex=True, sharey=True, squeeze=False)
    for line, (kind, source) in zip(panels, INFERENCES, strict=True):
        for axes, episodes in zip(line, used, strict=True):
            selected = matching(rows, kind=kind, inferred_from=source, episodes=episodes)
            _panel(axes, selected, f"{kind} from {source}, {episodes} episodes")
    return {"angles": picture}


def _panel(axes: Any, rows: list[Row], title: str) -> None:
    axes.plot([0, 90], [0, 90], color="#888888", linewidth=1.0)
    for spread, color in zip((True, False), ("prosocial", "egoistic"), strict=True):
        selected = [row for row in rows if (row["spread_planted"] > 0) == spread]
        axes.plot(
            [row["planted"] for row in selected],
            [row["angle"] for row in selected],
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
