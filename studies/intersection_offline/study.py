"""Offline learning in the intersection: demonstrations and their reward pairs, no step in a world.

One offline dial is compared with the demonstrators, clones and IQ-Learn on the same episodes. All
that are trained have the network that reads the vehicles as a set, and the same mixtures. IQ-Learn
is also trained online.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from socialiq import UserError
from socialiq.errors import one_of
from socialiq.evaluation.rollout import MODES
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.iq_learn import config as presets
from socialiq.results_folder import Results
from socialiq.settings import changed
from socialiq.types import Row
from socialiq.worlds.intersection import atlas
from socialiq_lab.intersection import driving
from socialiq_lab.intersection.rows import times, valued
from socialiq_lab.intersection.training import MixtureRuns, run_file, train_runs
from socialiq_lab.jobs import Inputs, Job, ProgressCallback
from socialiq_lab.registry import declaration
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import groups, labelled, matching, mean, paired_row, spread, with_holm

METHODS: dict[str, Any] = declaration("intersection-offline")["method"]
"""Methods beside the dial, with a run for each angle; the last three act in the world."""

OWN = "offline dial"
DEMONSTRATOR = "demonstrator"


def check(config: Any) -> None:
    """Refuse settings without a seed or an angle, unknown methods, and acting under a shift."""
    if not config.seeds or not config.angles:
        raise UserError("name at least one training seed and one angle")
    if not set(config.method_angles) <= set(config.angles):
        raise UserError("every method angle must be among the angles of the dial")
    for method in config.methods:
        one_of("method", method, tuple(METHODS))
    acting = [method for method in config.methods if METHODS[method].get("acts")]
    if acting and (config.shift or config.front_end):
        raise UserError(f"under a shift nothing acts in the world: leave out {acting[0]}")


def program_of(config: Any, seed: int) -> tuple[int, ...]:
    """Return the training seeds of a seed's program.

    Args:
        config: Configuration of the study.
        seed: Training seed.
    """
    first = config.seeds.index(seed) // config.together * config.together
    return config.seeds[first : first + config.together]


def runs_of(config: Any, method: str, seeds: tuple[int, ...]) -> MixtureRuns:
    """Return the runs of the dial or of a method.

    Args:
        config: Configuration of the study.
        method: `OWN`, the dial, or a name from `METHODS`; a "clone of all" has one run for every
            angle.
        seeds: Training seeds of the program.
    """
    declared: dict[str, Any] = METHODS.get(method, {})
    structure = config.structure
    numbers = config.numbers
    angles = config.method_angles
    network = {"hidden": structure.hidden, "view": structure.view, "updates": config.updates}
    if method == OWN:
        angles = ()
    elif "preset" in declared:
        structure, numbers = presets.PRESETS[declared["preset"]]
        structure = structure if declared.get("acts") else presets.offline(structure)
        structure = dataclasses.replace(structure, **network)
        numbers = dataclasses.replace(numbers, learning_rate=config.learning_rate)
    else:
        structure = bc.CloningConfig(batch_size=structure.batch_size, **network)
        numbers = bc.CloningHyperparameters(learning_rate=config.learning_rate)
    return MixtureRuns(
        structure=changed(structure, declared.get("static", {})),
        numbers=numbers,
        seeds=seeds,
        angles=angles[:1] if method == "clone of all" else angles,
        size=config.size,
        nearest=method == "clone of the mode",
    )


def folder_of(config: Any, method: str, seed: int) -> str:
    """Return the folder of the program that trains a seed's runs of a method.

    Args:
        config: Configuration of the study.
        method: `OWN`, the dial, or a name from `METHODS`.
        seed: Training seed.
    """
    name = method.replace("R(α)", "total").replace("χ²", "chi2")
    stage = "dials" if method == OWN else f"learners/{name.replace(',', '').replace(' ', '-')}"
    return f"{stage}/{program_of(config, seed)[0]}"


def jobs(config: Any) -> list[Job]:
    """Return every job, each after its inputs."""
    faults: dict[str, Any] = {"shift": config.shift, "front_end": config.front_end}
    recording = driving.atlas_demonstrations(config.pool_episodes, **faults)
    first = config.first_episode
    episodes = partial(driving.Driving, episodes=config.episodes, first_seed=first, **faults)
    planned = [
        recording,
        Job("demonstrators", save_demonstrators, recording.config),
        driving.evaluation("demonstrators", episodes(), cost=6.0),
    ]
    for seed in config.seeds[:: config.together]:
        for method in (OWN, *config.methods):
            seeds = program_of(config, seed)
            name = folder_of(config, method, seed)
            runs = runs_of(config, method, seeds)
            policies = len(seeds) * (len(runs.angles) or 4)
            cost = policies * runs.structure.updates / 300
            planned.append(Job(name, train_runs, runs, (driving.DEMONSTRATIONS,), cost))
            run = episodes(angles=config.angles if method == OWN else ())
            planned.append(driving.evaluation(name, run, cost=2.0 * policies))
    return planned


def save_demonstrators(
    _config: driving.Recording,
    folder: Path,
    _inputs: Inputs,
    on_progress: ProgressCallback,
) -> None:
    """Write the experts of the atlas, so that other jobs can drive them.

    Args:
        folder: Folder of the job; it gets a file for each mode.
        on_progress: Callback of the finished share, 0 to 1.
    """
    for mode in MODES:
        atlas.load(f"expert_{mode}").save(folder / f"{mode}.safetensors")
    on_progress(1.0)


def compute_tables(config: Any, context: Context) -> Findings:
    """Compute every table from the jobs' folders, and copy the dial of the first seed.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        All tables, verdicts of the tests as summary, and the first seed's dial.
    """
    policies = _policies(config, context.work)
    trained = [job for job in context.jobs if job.stage in ("dials", "learners")]
    pooled: list[Row] = []
    names = ("r_env", "r_social", "arrival", "collision", "timeout")
    for label, rows in labelled(policies, "method", "asked"):
        value = spread(rows, "value")
        pooled.append(
            label
            | {"seeds": len(rows), "value": value.pop("mean")}
            | value
            | {name: mean(rows, name) for name in names}
        )
    tests = compared(config, policies)
    tables = {
        "policies": policies,
        "angles": pooled,
        **tests,
        "times": times(trained, context.work),
    }
    first = config.seeds[0]
    dial = context.work / folder_of(config, OWN, first) / run_file(first)
    return Findings(tables, summarised(tests), {"dial.safetensors": dial.read_bytes()})


def _policies(config: Any, work: Path) -> list[Row]:
    """Return metrics of each policy, and J(α) at its angles; a demonstrator is valued at all."""
    rows: list[Row] = []
    for angle in config.angles:
        for mode in MODES:
            label = {"method": f"{DEMONSTRATOR} {mode}", "seed": "", "asked": angle}
            file = driving.episodes_at(work / "evaluation/demonstrators", mode)
            rows.append(valued(label, file, angle))
        for seed in config.seeds:
            for method in (OWN, *(config.methods if angle in config.method_angles else ())):
                folder = work / "evaluation" / folder_of(config, method, seed)
                trained = config.method_angles[0] if method == "clone of all" else angle
                file = driving.episodes_at(folder, run_file(seed, trained))
                if method == OWN:
                    file = driving.episodes_at(folder, run_file(seed), angle)
                label = {"method": method, "seed": seed, "asked": angle}
                rows.append(valued(label, file, angle))
    return rows


def compared(config: Any, policies: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the tests between methods that the table of policies allows, paired over seeds.

    The dial against the best demonstrator at each angle, which is the same for all seeds, and
    against every method; and each form of IQ-Learn against each weighted clone. p is adjusted by
    Holm over the demonstrators of all angles, over the methods of all angles, and over the forms.

    Args:
        config: Configuration of the study.
        policies: Rows of each policy and angle, with its J(α) as `value`.

    Returns:
        Tables `differences` (the dial) and `forms` (IQ-Learn); empty for a single training seed.
    """
    beside_best: list[Row] = []
    methods: list[Row] = []
    forms: list[Row] = []
    for angle in config.angles if len(config.seeds) > 1 else ():
        rows = matching(policies, asked=angle)
        values = {
            method: [row["value"] for row in group]
            for (method,), group in groups(rows, "method").items()
        }
        demonstrators = {
            name: max(values[name]) for name in values if name.startswith(DEMONSTRATOR)
        }
        best = max(demonstrators, key=lambda name: demonstrators[name])
        label = {"asked": angle, "other": best}
        beside_best.append(paired_row(label, values[OWN], values[best] * len(config.seeds)))
        for method in config.methods if angle in config.method_angles else ():
            label = {"asked": angle, "other": method}
            methods.append(paired_row(label, values[OWN], values[method]))
            if method.startswith("IQ-Learn"):
                label = {"asked": angle, "form": method}
                forms += [
                    paired_row(label | {"other": clone}, values[method], values[clone])
                    for clone in config.methods
                    if clone.startswith("clone weighted")
                ]
    return {"differences": with_holm(beside_best) + with_holm(methods), "forms": with_holm(forms)}


def summarised(tables: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Return what is above, level or below: the dial, and each form of IQ-Learn."""
    forms: dict[str, dict[str, dict[str, str]]] = {}
    for row in tables["forms"]:
        beside = forms.setdefault(row["form"], {}).setdefault(row["other"], {})
        beside[f"{row['asked']:g}"] = verdict(row)
    dial = {
        f"{row['asked']:g}": verdict(row)
        for row in tables["differences"]
        if row["other"].startswith(DEMONSTRATOR)
    }
    return {"against_best_demonstrator": dial, "iq_learn_against_clones": forms}


def verdict(row: Row) -> str:
    """Return "above" (adjusted p below 0.05), "below" (p itself, as losses count) or "level"."""
    if row["mean"] > 0:
        return "above" if row["p_holm"] < 0.05 else "level"
    return "below" if row["p"] < 0.05 else "level"


def above_best(results: Results) -> list[Row]:
    """Return the policies with J(α) above that of the best demonstrator."""
    rows = results.tables["policies"]
    best = {
        angle: max(r["value"] for r in group if r["method"].startswith(DEMONSTRATOR))
        for (angle,), group in groups(rows, "asked").items()
    }
    return [row | {"above": row["value"] - best[row["asked"]]} for row in rows if row["seed"] != ""]
