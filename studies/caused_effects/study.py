"""Comparison of a dial of what it causes with the dial of Eq 4.2, on the same episodes.

Both are trained by policy iteration from the same dial. The social reward of the first is what the
same episode without the ego shows that it caused; `evaluation.effects` measures both.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from socialiq.errors import one_of
from socialiq.evaluation.effects import COUNTS, expected_delay
from socialiq.evaluation.rollout import MODES
from socialiq.learners.dial.config import OfflineDialConfig, OfflineDialHyperparameters
from socialiq.social.angle import exact_weights, score
from socialiq.statistics.comparisons import paired_difference
from socialiq.types import RewardPair, Row
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import expert_policy
from socialiq_lab.intersection.driving import (
    atlas_demonstrations,
    seeds_of_blocks,
    shipped_dials,
)
from socialiq_lab.intersection.effects import (
    EffectsRun,
    effects_of,
    effects_row,
    measure_effects,
)
from socialiq_lab.intersection.training import (
    MixtureRuns,
    first_dial,
    iteration_jobs,
    train_runs,
)
from socialiq_lab.jobs import Job
from socialiq_lab.study import Context, Findings

CAUSED = "caused"
EQ_4_2 = "eq_4_2"
OFFLINE = "offline"
SHIPPED = {
    "start": "intersection-dial-clock/timed.safetensors",
    EQ_4_2: "intersection-dial-clock/iterated.safetensors",
}
"""Dials of the study intersection-dial: the one that both begin with, and that of Eq 4.2."""
MEANS = (
    "r_env", "r_caused", "r_eq_4_2", "delay", "braking", "gap_below_1_s", "collision", "arrival",
)  # fmt: skip
MEASURES = MEANS + COUNTS
"""Measures of an episode: of which a table has the mean, and numbers of vehicles."""
_SHARES = ("gap_below_1_s", "collision", "arrival")
_ERRORS = ("not_caused_of_charged", "missed_of_caused", "gained_of_credited", "lost_of_credited")
SUMMARISED = ("r_env", "r_eq_4_2", "delay", "braking", *_SHARES, *_ERRORS)


def jobs(config: Any) -> list[Job]:
    """Return the jobs: train from the start and from demonstrations, drive every dial and driver.

    Raises:
        UserError: If a driver is unknown.
    """
    for name in config.drivers:
        one_of("driver", name, (*Intersection.drivers, *atlas.names()))
    seeds = seeds_of_blocks(config.blocks, config.episodes)
    listed = shipped_dials(SHIPPED)
    listed += iteration_jobs(config, "dials/start", 4, 2, 600.0, effects=config.effects)
    demonstrations = atlas_demonstrations(config.demonstrated, config.effects)
    listed.append(demonstrations)
    offline_dial = OfflineDialConfig(updates=config.offline_updates)
    for seed in config.offline_seeds:
        mixture = MixtureRuns(
            structure=offline_dial,
            numbers=OfflineDialHyperparameters(),
            seeds=(seed,),
            size=config.size,
        )
        inputs = (demonstrations.name,)
        listed.append(Job(f"offline/{seed}", train_runs, mixture, inputs, 100.0))
    turns = tuple(f"@{angle:g}" for angle in config.angles)
    driving = EffectsRun(turns, MEASURES, seeds, effects=config.effects)
    for name, inputs in _dials(config):
        listed.append(Job(f"driving/{name}", measure_effects, driving, (inputs,), 300.0))
    for name in config.drivers:
        run = replace(driving, drivers=(name,))
        listed.append(Job(f"drivers/{name}", measure_effects, run, (), 30.0))
    return listed


def _dials(config: Any) -> list[tuple[str, str]]:
    """Return the name of each dial that drives, and of the job that makes it."""
    trained = [(f"{CAUSED} {seed}", f"training/{seed}") for seed in config.seeds]
    trained += [(f"{OFFLINE} {seed}", f"offline/{seed}") for seed in config.offline_seeds]
    return [(EQ_4_2, f"dials/{EQ_4_2}"), *trained]


def compute_tables(config: Any, context: Context) -> Findings:
    """Return each dial's measures at each angle, differences of both, and values at each angle.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        Tables `effects`, `differences`, `values` and `drivers`, the summary, and the first seed's
        dial.
    """
    work = context.work
    driven = {
        name: dict(zip(config.angles, effects_of(work / "driving" / name)[:, 0], strict=True))
        for name, _ in _dials(config)
    }
    trained = [driven[f"{CAUSED} {seed}"] for seed in config.seeds]
    offline = [driven[f"{OFFLINE} {seed}"] for seed in config.offline_seeds]
    dials = {CAUSED: trained, OFFLINE: offline, EQ_4_2: [driven[EQ_4_2]]}
    rows = [
        {"dial": dial, "angle": angle} | measured_row([run[angle] for run in runs])
        for dial, runs in dials.items()
        for angle in config.angles
    ]
    differences: list[Row] = []
    for name, angle in itertools.product(("delay", "braking", *_SHARES), config.angles):
        column = MEASURES.index(name)
        means = np.mean([run[angle][:, column] for run in trained], axis=0)
        change = paired_difference(means, driven[EQ_4_2][angle][:, column])
        row = {"angle": angle, "measure": name, "difference": change.mean}
        differences.append(row | {"low": change.low, "high": change.high})
    values = [row for angle in config.angles for row in value_rows(trained, angle)]
    drivers = [
        {"driver": name} | measured_row(effects_of(work / "drivers" / name)[0])
        for name in config.drivers
    ]
    summary: dict[str, Any] = {dial: {} for dial in dials}
    for row in rows:
        summary[row["dial"]][f"{row['angle']:g}"] = {name: row[name] for name in SUMMARISED}
    table = tabulate(make_grid("crossing7"))
    summary["crossing7"] = {  # cells that others lose by the optimum of each mode, exactly
        mode: expected_delay(table, expert_policy(table, angle)) for mode, angle in MODES.items()
    }
    for row in drivers:
        summary[row["driver"]] = {name: row[name] for name in SUMMARISED}
    tables = {"effects": rows, "differences": differences, "values": values, "drivers": drivers}
    return Findings(tables, summary, first_dial(config, context))


def measured_row(runs: Sequence[np.ndarray]) -> Row:
    """Return means over training seeds, intervals over episodes, ranges over seeds, and shares."""
    row = effects_row(MEANS, runs)
    counts = np.sum([run[:, len(MEANS) :].sum(axis=0) for run in runs], axis=0)
    charged, not_caused, caused, missed, credited, gained, lost = counts.tolist()
    row["not_caused_of_charged"] = not_caused / max(charged, 1.0)
    row["missed_of_caused"] = missed / max(caused, 1.0)
    row["gained_of_credited"] = gained / max(credited, 1.0)
    return row | {"lost_of_credited": lost / max(credited, 1.0)}


def value_rows(trained: Sequence[Mapping[float, np.ndarray]], angle: float) -> list[Row]:
    """Return the gain in J(α) at an angle by the dials' settings of other angles.

    Args:
        trained: Measures (episode, measure) by angle of the dial of each training seed.
        angle: Angle in degrees at which values count.

    Returns:
        A row for each other setting: mean gain over seeds, and its interval if there are two seeds
        or more.
    """
    scored = [
        {setting: float(score(exact_weights(angle), RewardPair(*run[setting][:, :2].mean(axis=0))))
         for setting in run}
        for run in trained
    ]  # fmt: skip
    rows: list[Row] = []
    for setting in trained[0]:
        if setting != angle:
            gains = [values[setting] - values[angle] for values in scored]
            change = paired_difference(gains, [0.0] * len(gains)) if len(gains) > 1 else None
            row: Row = {"angle": angle, "setting": setting, "gain": float(np.mean(gains))}
            row |= {"low": change.low, "high": change.high} if change else {}
            rows.append(row)
    return rows
