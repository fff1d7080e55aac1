"""Effect of a malicious minority on learners, with honest and with forged labels (thesis 1, 8.3).

The 7x7 world has the option in which the ego can collide. Labels that are computed again leave the
honest episodes of a forged set, so all attackers share these trainings; where labels are honest no
episode is dropped; a learner that reads no label has one training for honest and forged ones.
"""

import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.audit.profile.template import USUAL
from socialiq.demonstrations.trust import consistency
from socialiq.evaluation import malice
from socialiq.evaluation.rollout import trajectory_datasets
from socialiq.learners.dial import config as dial
from socialiq.statistics.bootstrap import resample_rows
from socialiq.types import Row
from socialiq_lab import comparison, comparison_runs
from socialiq_lab.audit_arena import RESAMPLES
from socialiq_lab.comparison_runs import Learner, Run, iq_learn, offline
from socialiq_lab.jobs import Job, Part, StageCallback, keeps_rows
from socialiq_lab.registry import declaration
from socialiq_lab.study import Context, Findings, tracked
from socialiq_lab.tables import column, groups, labelled, mean
from studies.poison import robust
from studies.poison.places import ATTACKERS, GRID, ROAD, Grid, Poison, Road, contaminated

METHODS = comparison.declared_methods(declaration("poison"))
"""The learners by name."""
MARGIN = USUAL[GRID].margin
"""Regret at which a learner counts as broken: the audit's default margin."""
HARM = 0.01
"""Rise of the share of collisions at which a learner counts as broken."""
MEASURES = ("regret", "collision")
PLACES = {GRID: Grid, ROAD: Road}
CASES = ("honest", "forged", "recomputed")
OFFLINE = dial.PRESETS["offline"]

LEARNERS: Mapping[str, Learner] = {
    **comparison_runs.LEARNERS,
    "medians": iq_learn(robust.MediansOfMeans),
    "dial_offline": comparison_runs.dialled(
        dataclasses.replace(OFFLINE.structure, redraw_times=0), OFFLINE.numbers, "discount"
    ),
    "ciql": iq_learn(robust.ConfidenceWeighted),
    "ril_co": iq_learn(robust.CoPseudoLabelling),
    "ileed": offline(robust.ExpertiseEstimating),
}
"""By the `learner` of a method in STUDY.toml."""


def poisons(config: Any, world: str) -> list[Poison]:
    """Return every contamination of a world; an adaptive forger differs by its labels alone.

    Args:
        config: Configuration of the study.
        world: `GRID` or `ROAD`; the latter has one attacker.
    """
    attackers = tuple(ATTACKERS)
    shares = config.shares
    if world == ROAD:
        attackers = ("hater",)
        shares = config.road_shares
    return [
        Poison(attacker, case, share, seed)
        for attacker, case in itertools.product(attackers, CASES)
        for share in shares
        for seed in config.seeds
        if (attacker, case) != ("adaptive", "honest")
    ]


def jobs(config: Any) -> list[Job]:
    """Return a job for each world and method, and one for the checks of data.

    Raises:
        UserError: If a world is unknown.
    """
    comparison.check_names(config, worlds=PLACES)
    methods = {GRID: config.methods, ROAD: config.road_methods}
    trained = [
        Job(f"{world}/{name}", table_rows, Part(config, (world, name)))
        for world in config.worlds
        for name in methods[world]
    ]
    checks = [Job("checks", table_rows, Part(config))] if GRID in config.worlds else []
    return trained + checks


@keeps_rows
def table_rows(part: Part, _folder: Path, on_stage: StageCallback) -> dict[str, list[Row]]:
    """Train and audit a method on every contamination, or check the data."""
    if not part.of:
        return {"checks": list(check_rows(part.study, Grid(part.study), on_stage))}
    world, name = part.of
    return {"policies": list(learned(part.study, world, name, on_stage))}


def learned(config: Any, world: str, name: str, on_stage: StageCallback) -> Iterator[Row]:
    """Train a method on every contamination; yield the row of each set and angle.

    Args:
        config: Configuration of the study.
        world: `GRID` or `ROAD`.
        name: Name of the method, from `METHODS`.
        on_stage: Returns the progress callback of a stage.
    """
    ground = PLACES[world](config)
    wanted = poisons(config, world)
    angles = tuple[float, ...](config.angles)
    method = METHODS[name]
    reads = "rewards" in METHODS[name].told
    sets = list(dict.fromkeys(poison.training(reads) for poison in wanted))
    recorded = [contaminated(ground, poison) for poison in sets]
    arena = ground.arena(recorded, on_stage(name))
    served = method.served(angles)
    setting = ground.settings.get(name, (method.settings or ((),))[0])
    runs = [
        Run(angle, poison.seed, number, setting)
        for angle in served
        for number, poison in enumerate(sets)
    ]
    rows: dict[tuple[Poison, float], Row] = {}
    policies = comparison_runs.trained(LEARNERS[method.learner], arena, method, runs)
    trained = list(zip(runs, policies, strict=True))
    for run, policy in tracked(trained, on_stage, f"{name}, audits", "policies"):
        for angle in served[run.angle]:
            measured = ground.measured(comparison_runs.turned(policy, angle), angle)
            rows[sets[run.dataset], angle] = measured
    for poison, angle in itertools.product(wanted, angles):
        label = {"world": world, "method": name} | poison._asdict() | {"angle": angle}
        yield label | rows[poison.training(reads), angle]


def check_rows(config: Any, grid: Grid, on_stage: StageCallback) -> Iterator[Row]:
    """Yield the shares of episodes that `data trust` flags, without and with a reference.

    Args:
        config: Configuration of the study.
        grid: Place of the 7x7 world.
        on_stage: Returns the progress callback of a stage.

    Yields:
        A row for each attacker, share and basis, with the shares of honest and of bad episodes
        flagged.
    """
    reference = trajectory_datasets(grid.table, [99], max(config.each // 3, 2))[0]
    pairs = itertools.product(ATTACKERS, config.shares)
    every = [(name, share) for name, share in pairs if share or name == "hater"]
    for (attacker, share), basis in tracked(
        list(itertools.product(every, (None, reference))), on_stage, "checks", "settings"
    ):
        rates = []
        for seed in config.check_seeds:
            data = contaminated(grid, Poison(attacker, "forged", float(share), seed))
            bad = np.array([data.mode_names[m] == malice.MODE for m in data.episode_modes])
            flagged = consistency(data, basis).flagged
            rates.append((flagged[~bad].mean(), flagged[bad].mean() if bad.any() else np.nan))
        false, caught = np.array(rates).T
        row: Row = {
            "attacker": attacker,
            "share": share,
            "reference": basis is not None,
            "false_alarms": false.mean(),
            "most_false_alarms": false.max(),
        }
        yield row | {"caught": caught.mean() if share else ""}


def compute_tables(_config: Any, context: Context) -> Findings:
    """Find breakdown points and policies that pass.

    Args:
        context: The finished jobs.

    Returns:
        Tables `policies`, `curves`, `breakdown`, `audits` and `checks`, and the summary.
    """
    tables = context.tables()
    curves, breakdown, audits = curves_of(tables["policies"])
    tables |= {"curves": curves, "breakdown": breakdown, "audits": audits}
    return Findings(tables, _summary(curves, breakdown, audits))


def curves_of(rows: Sequence[Row]) -> tuple[list[Row], list[Row], list[Row]]:
    """Return means by share, breakdown points, and counts of verdicts."""
    curves = []
    breakdown = []
    audits = []
    for label, group in labelled(rows, "world", "method", "attacker", "case"):
        for (share,), at_share in groups(group, "share").items():
            row: Row = {"share": share}
            for name in MEASURES:
                seeds = [mean(of_seed, name) for of_seed in groups(at_share, "seed").values()]
                row |= {name: np.mean(seeds), f"{name}_low": min(seeds), f"{name}_high": max(seeds)}
            passing = np.mean([each["verdict"] == "pass" for each in at_share])
            curves.append(label | row | {"passing": passing})
        breakdown += [label | row for row in breakdowns(group)]
        counts = {verdict: column(group, "verdict").count(verdict) for verdict in ("pass", "fail")}
        wrong = [row for row in group if row["verdict"] == "pass" and row["regret"] > MARGIN]
        collided = [row for row in group if row["verdict"] == "pass" and row["collision"] > HARM]
        row = label | counts | {"inconclusive": len(group) - sum(counts.values())}
        audits.append(row | {"pass_beyond_margin": len(wrong), "pass_and_collide": len(collided)})
    return curves, breakdown, audits


def breakdowns(rows: Sequence[Row]) -> list[Row]:
    """Return the smallest share at which a mean over seeds is beyond its limit; 1 without one.

    Of the regret the limit is the margin, of collisions `HARM` above the clean set's. The interval
    is the bootstrap's over seeds, 95 % (Efron 1979); its ends are shares that were run.
    """
    by_share = groups(rows, "share")
    shares = np.array([share for (share,) in by_share])
    seeds = [list(groups(at, "seed").values()) for at in by_share.values()]
    order = np.concatenate(
        [np.arange(len(seeds[0]))[None], *resample_rows(len(seeds[0]), RESAMPLES, 0)]
    )
    points = []
    for measure in MEASURES:
        means = np.array([[mean(of_seed, measure) for of_seed in at] for at in seeds])
        means = means[:, order].mean(axis=2)
        beyond = means > (MARGIN if measure == "regret" else means[0] + HARM)
        first = np.where(beyond.any(axis=0), shares[beyond.argmax(axis=0)], 1.0)
        low, high = np.quantile(first[1:], (0.025, 0.975), method="inverted_cdf")
        points.append({"measure": measure, "share": first[0], "low": low, "high": high})
    return points


def _summary(curves: list[Row], breakdown: list[Row], audits: list[Row]) -> dict[str, Any]:
    """Return curves and breakdown points by method, attacker and case, and wrong passes.

    Those of the intersection are under its name.
    """
    summary: dict[str, Any] = {ROAD: {}}
    for row in (*curves, *breakdown):
        place = summary if row["world"] == GRID else summary[ROAD]
        for key in ("method", "attacker", "case"):
            place = place.setdefault(row[key], {})
        if "measure" in row:
            names = "share", "low", "high"
            key = f"breakdown_{row['measure']}"
        else:
            names = *MEASURES, "passing"
            key = f"{100 * row['share']:g}"
        place[key] = {name: row[name] for name in names}
    names = ("pass", "fail", "inconclusive", "pass_beyond_margin", "pass_and_collide")
    counted = {
        world: {name: sum(row[name] for row in of_world) for name in names}
        for (world,), of_world in groups(audits, "world").items()
    }
    return summary | {"audits": counted}
