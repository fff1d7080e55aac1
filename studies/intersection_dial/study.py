"""The dial in the intersection, compared with agents trained for one angle each.

Dials and agents differ only in their range of angles and number of updates; a dial with a clock and
its ablations in what `ABLATIONS` names. All drive the intersection study's episodes.
"""

import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from socialiq import UserError
from socialiq.errors import one_of
from socialiq.evaluation.front import hypervolume
from socialiq.learners.dial.config import DialConfig, DialHyperparameters
from socialiq.results_folder import load
from socialiq.settings import laid_over
from socialiq.storage import packaged_results
from socialiq.types import Row
from socialiq_lab.intersection import driving, training
from socialiq_lab.intersection import rows as intersection
from socialiq_lab.jobs import Job
from socialiq_lab.registry import declaration
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import column, groups, matching, mean, numeric_means, paired_differences

DIALS = "dial"
AGENTS = "agents"
TIMED = "timed"
CALIBRATED = "calibrated"
SHORT = "short"
ITERATED = "iterated"
PLANNED = "planned"
FORESIGHT = "foresight"

ABLATIONS: dict[str, dict[str, Any]] = declaration("intersection-dial")["ablation"]
"""Dials of `ablation_updates`, and what of the recipe each changes; the first changes nothing."""

FAMILIES = (DIALS, AGENTS, TIMED, CALIBRATED, ITERATED, PLANNED, FORESIGHT, *ABLATIONS)
"""Kinds of policies: dials and agents without a clock, the recipe's dials with it, the same with
settings of their angles, improved by policy iteration, with online planning and with one look at
the true future, which makes no policy, and the ablations."""

_AHEAD: dict[str, driving.Ahead] = {PLANNED: "planned", FORESIGHT: "lookahead"}

_COMPARED = (
    *declaration("intersection-dial")["compared"],
    *((SHORT, ablation) for ablation in ABLATIONS if ablation != SHORT),
)
"""Pairs of families whose differences are tested, by training seed."""


def check(config: Any) -> None:
    """Refuse key angles at which no dial is driven, and families that can't be trained."""
    if not config.seeds:
        raise UserError("name at least one training seed")
    if not set(config.key_angles) <= set(config.turned):
        raise UserError("every key angle must be among the angles at which a dial is driven")
    for family in config.families:
        one_of("family", family, FAMILIES)
    for family in (CALIBRATED, ITERATED, PLANNED, FORESIGHT):
        if family in config.families and TIMED not in config.families:
            raise UserError(f"a {family} dial is made of a {TIMED} one: name both families")


def cells(config: Any) -> Iterator[tuple[int, str, tuple[float, ...]]]:
    """Yield each training seed and family with the angles at which it is driven."""
    for number, seed in enumerate(config.seeds):
        for family in config.families:
            few = family in (AGENTS, PLANNED, FORESIGHT) or family in ABLATIONS
            if number < config.planned_seeds or family not in (PLANNED, FORESIGHT):
                yield seed, family, config.key_angles if few else config.turned


def recipe_of(config: Any, family: str) -> tuple[DialConfig, DialHyperparameters]:
    """Return how the dials of a family are trained; for agents, all settings but the angle.

    Args:
        config: Configuration of the study.
        family: Kind of policy, from `FAMILIES`.
    """
    if family == DIALS:
        return config.structure, config.numbers
    if family == AGENTS:
        agent = {"margin": 0.0, "updates": config.agent_updates}
        return dataclasses.replace(config.structure, **agent), config.numbers
    if family == TIMED:
        return config.recipe, config.recipe_numbers
    changes = {"updates": config.ablation_updates, **ABLATIONS[family]}
    structure, numbers = laid_over([config.recipe, config.recipe_numbers], changes)
    return structure, numbers


def folder_of(family: str, seed: int, angle: float = 0.0) -> str:
    """Return the folder of a dial, or of the agent of an angle.

    Args:
        family: Kind of policy, from `FAMILIES`.
        seed: Training seed.
        angle: Angle of an agent in degrees; of no effect for a dial.
    """
    if family == AGENTS:
        return f"agents/{angle:g}/{seed}"
    return f"dials/{seed}" if family == DIALS else f"{family}/{seed}"


def jobs(config: Any) -> list[Job]:
    """Return every job, each after its inputs: the training of a dial, then its driving."""
    planned = [driving.atlas_demonstrations(config.pool_episodes)]
    for seed, family, angles in sorted(
        cells(config), key=lambda cell: (config.seeds.index(cell[0]), FAMILIES.index(cell[1]))
    ):
        for at in [(angle,) for angle in angles] if family == AGENTS else [angles]:
            name = folder_of(family, seed, at[0])
            timed = folder_of(TIMED, seed)
            ahead = _AHEAD.get(family, "")
            if family == CALIBRATED:
                run = driving.Driving(
                    angles=at,
                    episodes=config.calibration_episodes,
                    first_seed=driving.FIRST_CALIBRATION,
                )
                planned.append(Job(name, driving.calibrate_dial, run, (timed,), 3.0 * len(at)))
            elif family == ITERATED:
                numbers = dataclasses.replace(config.iteration_numbers, seed=seed)
                run = training.DialIterationRun(config.iteration, numbers)
                work = training.train_dial_by_iteration
                cost = config.iteration.updates / 20
                planned.append(Job(name, work, run, (timed,), cost))
            elif not ahead:
                structure, numbers = recipe_of(config, family)
                run = training.DialRun(
                    structure=structure,
                    numbers=dataclasses.replace(numbers, seed=seed),
                    size=config.size,
                    steps_per_update=config.steps_per_update,
                )
                if family == AGENTS:
                    agent = dataclasses.replace(structure, low=at[0], high=at[0])
                    run = dataclasses.replace(run, structure=agent, check_angles=at)
                inputs = (driving.DEMONSTRATIONS,)
                cost = structure.updates / 150
                planned.append(Job(name, training.train_dial, run, inputs, cost))
            run = driving.Driving(angles=at, episodes=config.episodes, ahead=ahead)
            dial = timed if ahead else name
            cost = {"planned": 140.0, "lookahead": 15.0}
            cost = cost.get(ahead, 3.0) * len(at)
            planned.append(Job(f"evaluation/{name}", driving.drive, run, (dial,), cost))
    return planned


def compute_tables(config: Any, context: Context) -> Findings:
    """Compute every table from the jobs' folders, and copy the dials of the first seed.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        All tables, means over seeds as summary, and the dials of the first seed.
    """
    work = context.work
    known_rows = known_policies() if config.episodes == driving.EPISODES else []
    driven = _policies(config, work, known_rows)
    policies = [row for row in driven if row["family"] != FORESIGHT]
    known: list[Row] = []
    for angle in config.key_angles if known_rows else ():
        best = max(known_rows, key=lambda row: intersection.value_at(row, angle))
        known.append({"angle": angle, "value": intersection.value_at(best, angle), **best})
    families = _families(config, policies)
    works = (training.train_dial, training.train_dial_by_iteration)
    trained = [job for job in context.jobs if job.work in works]
    tables = {
        "policies": policies,
        "families": families,
        "differences": _differences(config, families),
        "known": known,
        "foresight": matching(driven, family=FORESIGHT),
        "curves": intersection.curves(trained, work, ("updates", "loss", "total")),
        "times": intersection.times(trained, work),
    }
    files = {
        f"{family}.safetensors": (work / folder_of(family, config.seeds[0]) / driving.DIAL)
        for family in (DIALS, TIMED, CALIBRATED, ITERATED)
        if family in config.families
    }
    contents = {name: path.read_bytes() for name, path in files.items()}
    return Findings(tables, _summary(config, tables), contents)


def _policies(config: Any, work: Path, known_rows: Sequence[Row]) -> list[Row]:
    """Return metrics of each policy, with J(α) and its regrets at the requested angle.

    The regret is against the best policy here, `known_regret` against the best of these and of all
    known ones, `others_regret` against the best of other families and of all known ones; the last
    one may be negative. A dial with foresight is no policy: it is not among the best.
    """
    rows: list[Row] = []
    for seed, family, angles in cells(config):
        for angle in angles:
            folder = work / "evaluation" / folder_of(family, seed, angle)
            label = {"family": family, "seed": seed, "asked": angle, "value": 0.0, "regret": 0.0}
            file = driving.episodes_at(folder, "dial", angle)
            rows.append(intersection.valued(label, file, angle))
    by_family = groups([row for row in rows if row["family"] != FORESIGHT], "family")
    for (angle,), asked in groups(rows, "asked").items():
        best = {
            family: max(intersection.value_at(row, angle) for row in group)
            for (family,), group in by_family.items()
        }
        before = max((intersection.value_at(row, angle) for row in known_rows), default=0.0)
        for row in asked:
            row["regret"] = max(best.values()) - row["value"]
            if known_rows:
                rivals = [best[family] for family in best if family != row["family"]]
                row["known_regret"] = max(row["regret"], before - row["value"])
                row["others_regret"] = max([before, *rivals]) - row["value"]
    return rows


_STUDIES = ("intersection", "intersection-networks", "intersection-ahead", "intersection-dial")
_NO_RIVALS = {FORESIGHT, "varied_drivers", "connected_lanes"}
"""Words in the names of policies that see the true future, or were driven in other scenarios."""


def known_policies() -> list[Row]:
    """Return study, policy, r_env and r_social of every policy on the 2,000 common episodes."""
    policies: list[Row] = []
    for study in _STUDIES:
        for row in load(packaged_results() / study).tables["policies"]:
            of_dial = "policy" not in row
            name = f"{row['family']}/{row['seed']}/{row['asked']:g}" if of_dial else row["policy"]
            if row["episodes"] == driving.EPISODES and not _NO_RIVALS & set(name.split("/")):
                label = {"study": study, "policy": name, "readout": row.get("readout", "greedy")}
                policies.append(label | {key: row[key] for key in ("r_env", "r_social")})
    return policies


def _families(config: Any, policies: Sequence[Row]) -> list[Row]:
    """Return hypervolume, regrets at the key angles and monotony of each family and seed."""
    corner = intersection.points_of(policies).min(axis=0)
    compared: list[Row] = []
    for family, seed in itertools.product(config.families, config.seeds):
        rows = sorted(matching(policies, family=family, seed=seed), key=lambda row: row["asked"])
        if not rows:
            continue
        key = [row for row in rows if row["asked"] in config.key_angles]
        points = intersection.points_of(key)
        compared.append(
            {"family": family, "seed": seed, "hypervolume": hypervolume(points, corner)}
            | {"mean_regret": mean(key, "regret"), "worst_regret": max(column(key, "regret"))}
            | {f"regret_{row['asked']:g}": row["regret"] for row in key}
            | {
                f"mean_{name}": mean(key, name)
                for name in ("known_regret", "others_regret")
                if name in key[0]
            }
            | {"angles": len(rows), **intersection.backward_steps(rows)}
            | {"most_arrivals": max(row["arrival"] for row in rows)}
        )
    return compared


def _differences(config: Any, families: Sequence[Row]) -> list[Row]:
    """Return paired differences of each pair of families, adjusted by Holm within the pair."""
    rows: list[Row] = []
    for first, second in _COMPARED:
        if first in config.families and second in config.families:
            first_rows, second_rows = (matching(families, family=name) for name in (first, second))
            seeds = [row["seed"] for row in first_rows]  # online planning: of the first seeds alone
            second_rows = [row for row in second_rows if row["seed"] in seeds]
            measures = [name for name in first_rows[0] if name == "hypervolume" or "regret" in name]
            differences = paired_differences(first_rows, second_rows, *measures, label="measure")
            rows += [{"first": first, "second": second, **row} for row in differences]
    return rows


def _summary(config: Any, tables: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Return means over seeds of each family, and of each policy by family and angle."""

    def means(rows: list[Row]) -> Row:
        columns = {name: value for name, value in numeric_means(rows).items() if name != "seed"}
        return columns | {"seeds": len({row["seed"] for row in rows})}

    policies: dict[str, Any] = {family: {} for family in config.families}
    for (family, angle), rows in groups(tables["policies"], "family", "asked").items():
        policies[family][f"{angle:g}"] = means(rows)
    differences: dict[str, Any] = {}
    for row in tables["differences"]:
        differences.setdefault(f"{row['first']} - {row['second']}", {})[row["measure"]] = row
    families = groups(tables["families"], "family").items()
    return {
        "families": {family: means(rows) for (family,), rows in families},
        "policies": policies,
        "differences": differences,
    }
