"""Learners of experts of three strengths at the intersection, a trio of experts as the replicate.

The strength decides which of the thesis' tables come back: those with experts that are stopped
where their endings are nearest Table 6.2's are the thesis' on its own terms.
"""

import dataclasses
import itertools
import math
import operator
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.evaluation.episodes import OUTCOMES, policy_row, reward_row
from socialiq.evaluation.rollout import MODES
from socialiq.learners import dqn
from socialiq.learners.iq_learn import config as presets
from socialiq.social.angle import pooled_angle
from socialiq.types import Row
from socialiq.worlds.intersection.options import Options
from socialiq_lab.intersection import rows as intersection
from socialiq_lab.intersection import thesis_values
from socialiq_lab.intersection.driving import (
    BEST,
    LAST,
    MIXTURE,
    Driving,
    Recording,
    Shipped,
    copy_shipped,
    drive,
    episodes_at,
    evaluation,
    load_episodes,
    record_experts,
)
from socialiq_lab.intersection.thesis_tables import (
    PERCENT,
    compared,
    group_spread,
    separability,
)
from socialiq_lab.intersection.training import (
    Checks,
    ExpertRun,
    LearnerRun,
    train_expert,
    train_learner,
)
from socialiq_lab.jobs import Job
from socialiq_lab.registry import declaration
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import column, groups, mean, numeric_means, options_name, spread

READINGS: tuple[dict[str, Any], ...] = tuple(declaration("expert-strength")["readings"]["options"])
"""Changed options of the world in each reading of the reward."""
SHIPPED_TRIO = 40
"""Training seed of the strong experts, those of the intersection study."""
TARGETS = ("baseline", *MODES)
MEASURES = ("value", "collision", "at_fault_per_entry")
"""Measures that are compared over the strength of experts: J at the own angle, and two rates."""


def trios(config: Any) -> dict[str, tuple[int, ...]]:
    """Return the training seeds of the trios of each strength, the weakest first."""
    return {"weak": config.trios, "matched": config.trios, "strong": (SHIPPED_TRIO,)}


def learners(config: Any, strength: str) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return the targets and training seeds of the learners of one trio of a strength."""
    if strength == "matched":
        return TARGETS, config.seeds
    return tuple(MODES), config.seeds[:1] if strength == "weak" else config.seeds


def jobs(config: Any) -> Iterator[Job]:
    """Yield experts, their demonstrations, learners and evaluations of every strength."""
    for strength, seeds in trios(config).items():
        for trio in seeds:
            place = f"{strength}/{trio}"
            experts = tuple(f"experts/{place}/{mode}" for mode in MODES)
            for name, mode in zip(experts, MODES, strict=True):
                yield expert(config, name, strength, trio, mode)
                yield evaluation(name, Driving(driver=BEST, episodes=config.episodes), 3.0)
            recording = Recording(driver=BEST, episodes=config.pool_episodes)
            recorded = f"demonstrations/{place}"
            yield Job(recorded, record_experts, recording, experts, 6.0)
            for target, seed in itertools.product(*learners(config, strength)):
                name = f"learners/{place}/{target}/{seed}"
                yield Job(name, train_learner, learner(config, target, seed), (recorded,), 50.0)
                yield evaluation(name, Driving(driver=LAST, episodes=config.episodes), 3.0)
    every = tuple(f"experts/matched/{trio}/{mode}" for trio in config.trios for mode in MODES)
    for reading in READINGS:
        run = Driving(driver=BEST, episodes=config.episodes, options=Options(**reading))
        yield Job(f"readings/{options_name(reading)}", drive, run, every, 10.0)


def more_jobs(config: Any, work: Path) -> Iterator[Job]:
    """Yield learners of the first trio and seed with the best reading, unless it is the default.

    Args:
        config: Configuration of the study.
        work: Folder of the finished jobs.
    """
    best = min(readings(config, work), key=operator.itemgetter("score"))["reading"]
    by_name = {options_name(reading): Options(**reading) for reading in READINGS}
    options = by_name[best]
    if options == Options():
        return
    trio = config.trios[0]
    seed = config.seeds[0]
    experts = tuple(f"experts/matched/{trio}/{mode}" for mode in MODES)
    recording = Recording(driver=BEST, episodes=config.pool_episodes, options=options)
    recorded = f"demonstrations/reading/{trio}"
    yield Job(recorded, record_experts, recording, experts, 6.0)
    for target in TARGETS:
        name = f"learners/reading/{trio}/{target}/{seed}"
        run = dataclasses.replace(learner(config, target, seed), options=options)
        yield Job(name, train_learner, run, (recorded,), 50.0)
        yield evaluation(name, Driving(driver=LAST, episodes=config.episodes, options=options), 3.0)


def expert(config: Any, name: str, strength: str, trio: int, mode: str) -> Job:
    """Return the job that trains an expert, or takes that of the intersection study.

    Args:
        config: Configuration of the study.
        name: Name of the job.
        strength: Strength of the expert.
        trio: Training seed.
        mode: Mode of the expert.
    """
    if strength == "strong":
        shipped = Shipped(f"intersection/atlas/expert_{mode}.safetensors", BEST)
        return Job(name, copy_shipped, shipped)
    numbers = dqn.DQNHyperparameters(angle=MODES[mode], seed=trio)
    structure = dqn.DQNConfig(through_timeouts=config.through_timeouts, steps=config.weak_steps)
    if strength == "weak":
        return Job(name, train_expert, ExpertRun(structure, numbers), cost=20.0)
    structure = dataclasses.replace(structure, steps=config.matched_steps)
    printed = thesis_values.TABLE_6_2
    nearest = {ending: printed[ending][f"expert {mode}"][0] / 100 for ending in OUTCOMES}
    run = ExpertRun(structure, numbers, checks=Checks(times=config.checks), nearest=nearest)
    return Job(name, train_expert, run, cost=200.0)


def learner(config: Any, target: str, seed: int) -> LearnerRun:
    """Return the run of a learner with the calibrated preset, towards a mode or without a prior."""
    structure = dataclasses.replace(presets.INTERSECTION_CALIBRATED, updates=config.updates)
    if target == "baseline":
        structure = presets.baseline(structure)
    numbers = dataclasses.replace(
        presets.INTERSECTION_CALIBRATED_NUMBERS, angle=MODES.get(target, 0.0), seed=seed
    )
    return LearnerRun(structure, numbers, MIXTURE, config.size)


def compute_tables(config: Any, context: Context) -> Findings:
    """Compute every table from the jobs' folders alone.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.
    """
    episodes = intersection.evaluated(context.jobs, context.work)
    rows = {name: policy_row(name, "greedy", played) for (name, _), played in episodes.items()}
    spreads = {
        name: {metric: group_spread(played, config, metric) for metric in thesis_values.METRICS}
        for (name, _), played in episodes.items()
    }
    of_trios = {
        policy: [numeric_means([rows[name] for name in names]) for names in by_trio]
        for policy, by_trio in matched(config).items()
    }
    recordings = [context.work / f"demonstrations/matched/{trio}" for trio in config.trios]
    a_1, a_2 = separability_of_trios(recordings)
    tables = {
        "policies": list(rows.values()),
        "table_6_2": table_6_2(config, of_trios, spreads),
        "table_a_1": a_1,
        "table_a_2": a_2,
        "angles": angles(of_trios),
        "differences": compared({}, of_trios),
        "strength": strength_rows(config, rows),
        "readings": readings(config, context.work),
        "curves": intersection.curves(context.jobs, context.work),
        "times": intersection.times(context.jobs, context.work),
    }
    return Findings(tables, {})


def matched(config: Any) -> dict[str, list[list[str]]]:
    """Return the matched policies behind each column of Table 6.2: for each trio their names."""
    experts = {
        f"expert {mode}": [[f"experts/matched/{trio}/{mode}"] for trio in config.trios]
        for mode in MODES
    }
    return experts | {
        target: [
            [f"learners/matched/{trio}/{target}/{seed}" for seed in config.seeds]
            for trio in config.trios
        ]
        for target in TARGETS
    }


def table_6_2(
    config: Any, of_trios: Mapping[str, Sequence[Row]], spreads: Mapping[str, Mapping[str, float]]
) -> list[Row]:
    """Return Tables 6.1 and 6.2 of matched experts and their learners.

    Args:
        config: Configuration of the study.
        of_trios: Metrics of each policy, a row for each trio.
        spreads: Standard deviation of each metric over groups of episodes, by name of a policy.

    Returns:
        A row for each policy and metric, shares in percent: the thesis' mean and spread, the mean
        over trios with its standard deviation and range, the spread over groups of episodes, and
        its variance over the thesis'.
    """
    names = {policy: list(itertools.chain(*trios)) for policy, trios in matched(config).items()}
    table: list[Row] = []
    for policy, metric in itertools.product(thesis_values.POLICIES, thesis_values.METRICS):
        factor = 100 if metric in PERCENT else 1
        values = [factor * row[metric] for row in of_trios[policy]]
        printed, printed_spread = thesis_values.TABLE_6_2[metric][policy]
        over_groups = factor * float(np.mean([spreads[name][metric] for name in names[policy]]))
        ratio = (over_groups / printed_spread) ** 2 if printed_spread else ""
        table.append(
            {"policy": policy, "metric": metric, "thesis": printed}
            | {"thesis_spread": printed_spread, "ours": float(np.mean(values))}
            | {"over_trios": float(np.std(values, ddof=1)), "low": min(values), "high": max(values)}
            | {"over_evaluation": over_groups, "variance_ratio": ratio, "trios": len(values)}
        )
    return table


def separability_of_trios(recordings: Sequence[Path]) -> tuple[list[Row], list[Row]]:
    """Return Tables A.1 and A.2 of several trios: means over them, with their range.

    Args:
        recordings: Folder of the recordings of each trio.
    """
    first: list[Row] = []
    second: list[Row] = []
    for folder in recordings:
        a_1, a_2 = separability(folder)
        first += a_1
        second += a_2
    of_modes = groups(first, "mode", "signal").values()
    of_pairs = groups(second, "first", "second", "signal").values()
    return [over_trios(cells) for cells in of_modes], [over_trios(cells) for cells in of_pairs]


def over_trios(cells: Sequence[Row]) -> Row:
    """Return a cell with the means of `ours` and `ours_sd`, and `ours`' deviation and range.

    Args:
        cells: Rows of one cell of a table, one for each trio.
    """
    means = {name: mean(cells, name) for name in ("ours", "ours_sd") if name in cells[0]}
    ends = spread(cells, "ours")
    spreads = {"over_trios": float(np.std(column(cells, "ours"), ddof=1))}
    return cells[0] | means | spreads | {"low": ends["low"], "high": ends["high"]}


def angles(of_trios: Mapping[str, Sequence[Row]]) -> list[Row]:
    """Return the empirical angle of each policy in degrees: of the means, and the range of trios.

    Args:
        of_trios: Metrics of each policy, a row for each trio.
    """
    table: list[Row] = []
    for policy, rows in of_trios.items():
        angle, low, high = pooled_angle(column(rows, "r_env"), column(rows, "r_social"))
        label = {"policy": policy, "thesis": thesis_values.FIG_6_5.get(policy, "")}
        table.append(label | {"angle": angle, "low": low, "high": high})
    return table


def strength_rows(config: Any, rows: Mapping[str, Row]) -> list[Row]:
    """Return each learner beside its expert, means over training seeds, by strength and trio.

    Args:
        config: Configuration of the study.
        rows: Metrics of each policy.
    """
    table: list[Row] = []
    for strength, seeds in trios(config).items():
        _, training_seeds = learners(config, strength)
        for trio, (mode, angle), measure in itertools.product(seeds, MODES.items(), MEASURES):
            place = f"{strength}/{trio}/{mode}"
            names = [f"learners/{place}/{seed}" for seed in training_seeds]
            own = _measure(rows[f"experts/{place}"], measure, angle)
            others = [_measure(rows[name], measure, angle) for name in names]
            if "" in (own, *others):  # no vehicle entered the junction
                continue
            learned = float(np.mean(others))
            table.append(
                {"strength": strength, "trio": trio, "mode": mode, "measure": measure}
                | {"expert": own, "learner": learned, "difference": learned - own}
            )
    return table


def _measure(row: Row, measure: str, angle: float) -> Any:
    return intersection.value_at(row, angle) if measure == "value" else row[measure]


def readings(config: Any, work: Path) -> list[Row]:
    """Return how far Table A.1 is from the thesis' with each reading of the reward, same drivers.

    Args:
        config: Configuration of the study.
        work: Folder of the jobs.

    Returns:
        A row for each reading: the mean distance of the 12 means in the thesis' standard
        deviations, the mean absolute logarithm of the ratios of the 12 standard deviations, and
        their sum as the score; and r_social's mean and standard deviation of each mode.
    """
    table: list[Row] = []
    for reading in READINGS:
        name = options_name(reading)
        gaps: list[float] = []
        ratios: list[float] = []
        social: Row = {}
        for mode, printed in thesis_values.TABLE_A_1.items():
            drivers = [f"experts/matched/{trio}/{mode}/{BEST}" for trio in config.trios]
            folder = work / "readings" / name
            of_trios = [reward_row(load_episodes(episodes_at(folder, file))) for file in drivers]
            for signal, (thesis, thesis_sd) in printed.items():
                total, sd = (mean(of_trios, f"{_TOTALS[signal]}{end}") for end in ("", "_sd"))
                gaps.append(abs(total - thesis) / thesis_sd)
                ratios.append(abs(math.log(sd / thesis_sd)) if sd else math.inf)
                if signal == "g_social":
                    social |= {f"{mode}_r_social": total, f"{mode}_r_social_sd": sd}
        means = float(np.mean(gaps))
        sds = float(np.mean(ratios))
        score = {"means": means, "spreads": sds, "score": means + sds}
        table.append({"reading": name} | score | social)
    return table


_TOTALS = {
    "g_self": "classical_own",
    "g_global": "classical_others",
    "g_env": "r_env",
    "g_social": "r_social",
}
