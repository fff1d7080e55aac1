"""The intersection with continuous actions: the main table, and dials of both kinds of actions.

The ego drives straight on and chooses its acceleration. Learners have a mixture of the experts;
dials of discrete actions, of the same steps and updates, drive the same episodes.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.evaluation import road_training as road
from socialiq.evaluation import rollout
from socialiq.evaluation.episodes import policy_row
from socialiq.evaluation.front import hypervolume
from socialiq.evaluation.rollout import MODES
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.acting import actors_together
from socialiq.learners.collect import VectorCollector
from socialiq.learners.continuous import config as actors
from socialiq.learners.continuous.train import train
from socialiq.learners.dial import config as dial
from socialiq.learners.dial import train as dial_training
from socialiq.settings import changed
from socialiq.types import Row
from socialiq.worlds.gym import learning_env
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection
from socialiq_lab.intersection import driving
from socialiq_lab.intersection import rows as intersection
from socialiq_lab.intersection.thesis_values import METRICS
from socialiq_lab.intersection.training import fit
from socialiq_lab.jobs import Inputs, Job, ProgressCallback
from socialiq_lab.registry import declaration
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import (
    groups,
    labelled,
    matching,
    mean,
    numeric_means,
    paired_differences,
    with_holm,
)

EXPERTS = "experts/sac"
CONTINUOUS = "dials/continuous"
HIGH_ANGLES = "dials/high-angles"
DISCRETE = "dials/discrete"
PROGRAMS: dict[str, Any] = declaration("intersection-continuous")["program"]
POLICIES = {
    name: (program["name"], program["angles"])
    for name, program in PROGRAMS.items()
    if "name" in program
}
"""Jobs of experts and of what learns from a mixture: the beginning of a policy's name in the
tables, and whether there is a run for every angle."""
KINDS = tuple(name for name in PROGRAMS if name not in POLICIES)
"""Jobs that train dials."""


@dataclass(frozen=True)
class Runs:
    """Runs of one program; discrete actions for dials of `DialConfig`, else continuous ones."""

    structure: Any
    numbers: tuple[Any, ...]
    options: Options
    environments: int
    size: int  # transitions of each expert in a mixture, for what learns from demonstrations


def run_file(angle: float, seed: int) -> str:
    """Return the file of a run's policy.

    Args:
        angle: Angle of the run in degrees, 0 for a run without one.
        seed: Training seed.
    """
    return f"{angle:g}_{seed}.safetensors"


def jobs(config: Any) -> list[Job]:
    """Return every job, each after its inputs."""
    recording = driving.Recording(episodes=config.pool_episodes, options=config.options)
    planned: list[Job] = []
    for name, program in PROGRAMS.items():
        structure = changed(getattr(config, program["structure"]), program.get("static", {}))
        base = getattr(config, program["numbers"])
        options = config.discrete_options if name == DISCRETE else config.options
        if name in KINDS:
            numbers = [dataclasses.replace(base, seed=seed) for seed in config.seeds]
        else:
            seeds = (config.expert_seed,) if name == EXPERTS else config.learner_seeds
            numbers = [
                dataclasses.replace(base, angle=angle, seed=seed)
                for angle in (rollout.MODES.values() if POLICIES[name][1] else (0.0,))
                for seed in seeds
            ]
        runs = Runs(structure, tuple(numbers), options, config.environments, config.size)
        alone = name == EXPERTS or name in KINDS
        cost, inputs = (100.0, ()) if alone else (10.0, (driving.DEMONSTRATIONS,))
        planned.append(Job(name, train_runs, runs, inputs, cost * len(numbers)))
        if name == EXPERTS:
            planned.append(
                Job(driving.DEMONSTRATIONS, driving.record_experts, recording, (EXPERTS,), 10.0)
            )
        run = driving.Driving(
            angles=config.angles if name in KINDS else (),
            episodes=config.episodes,
            first_seed=config.first_episode,
            options=options,
        )
        planned.append(driving.evaluation(name, run, cost=20.0))
    return planned


def train_runs(config: Runs, folder: Path, inputs: Inputs, on_progress: ProgressCallback) -> None:
    """Write the policy of each run; each training seed of learners has its own mixture.

    Args:
        config: Runs of one program.
        folder: Folder of the job, to which the policies are written (`run_file`).
        inputs: Folder of the recorded demonstrations; empty for experts and dials.
        on_progress: Callback of the finished share, 0 to 1.
    """
    structure = config.structure
    seeds = list(dict.fromkeys(run.seed for run in config.numbers))
    data = [
        driving.mixture_of(recordings, config.size, seed)
        for recordings in inputs.values()
        for seed in seeds
    ]
    numbers = [
        dataclasses.replace(run, dataset=seeds.index(run.seed)) if data else run
        for run in config.numbers
    ]
    world = Intersection(config.options)
    if isinstance(structure, dial.DialConfig):
        count = config.environments
        steps = actors.STEPS_PER_UPDATE
        collect = road.dial_collector(structure, numbers, world, count, steps)
        learn = partial(dial_training.train, sizes=road.sizes_of(config.options, True))
        program = partial(learn, structure, numbers, data, before_chunk=collect)
    elif isinstance(structure, bc.CloningConfig):
        program = partial(bc.GaussianCloning.train_on, structure, numbers, data)
    elif isinstance(structure, actors.TD3BCConfig):
        program = partial(train, structure, numbers, data)
    else:
        clock = structure.times > 0
        env = learning_env(world, len(numbers) * config.environments, clock)
        rounds = -(-road.CHUNK * structure.env_steps_per_update // config.environments)
        collect = VectorCollector(env, rounds, numbers, actors_together(structure, numbers))
        sizes = world.n_features + clock, config.options.width
        program = partial(train, structure, numbers, data, sizes=sizes, before_chunk=collect)
    files = [run_file(getattr(run, "angle", 0.0), run.seed) for run in numbers]
    fit(program, folder, on_progress, files)


_PERCENT = ("collision", "arrival", "timeout", "stopped")
_PAIRS = (CONTINUOUS, DISCRETE), (HIGH_ANGLES, DISCRETE), (HIGH_ANGLES, CONTINUOUS)


def compute_tables(config: Any, context: Context) -> Findings:
    """Compute every table from the jobs' folders, and copy the experts and the first dial.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        All tables, means of dials and of the main table as summary, and the policies' files.
    """
    work = context.work
    policies = _policies(config, work)
    dials = list[Row]()
    cells: Any = itertools.product(KINDS, config.seeds, config.angles)
    for kind, seed, angle in cells:
        file = driving.episodes_at(work / "evaluation" / kind, run_file(0.0, seed), angle)
        row = policy_row(kind, "greedy", driving.load_episodes(file))
        label = {
            "kind": kind,
            "seed": seed,
            "asked": angle,
            "value": intersection.value_at(row, angle),
            "regret": 0.0,
        }
        dials.append(label | row)
    for row in dials:
        best = max(intersection.value_at(other, row["asked"]) for other in dials + policies)
        row["regret"] = best - row["value"]
    families = _families(dials)
    tables = {
        "main": main_table(policies, dials),
        "policies": policies,
        "mixture": _of_mixture(policies),
        "dials": dials,
        "families": families,
        "differences": _differences(families),
        "times": intersection.times(context.jobs, work),
    }
    name = "intersection-continuous"
    experts = {
        f"expert_{mode}": (EXPERTS, run_file(angle, config.expert_seed))
        for mode, angle in MODES.items()
    }
    rows = {f"expert_{mode}": matching(policies, name=f"expert {mode}")[0] for mode in MODES}
    files = intersection.atlas_files(name, name, experts, work, rows)
    files["dial.safetensors"] = (work / CONTINUOUS / run_file(0.0, config.seeds[0])).read_bytes()
    means = {
        _short(kind): {name: mean for name, mean in numeric_means(rows).items() if name != "seed"}
        for (kind,), rows in groups(families, "kind").items()
    }
    return Findings(tables, {"families": means}, files)


def _policies(config: Any, work: Path) -> list[Row]:
    """Return metrics of each expert and policy of a mixture, with J at its own angle, or 0."""
    rows: list[Row] = []
    for job, (name, of_angles) in POLICIES.items():
        seeds = (config.expert_seed,) if job == EXPERTS else config.learner_seeds
        for mode, angle in MODES.items() if of_angles else (("", 0.0),):
            for seed in seeds:
                file = run_file(angle, seed)
                episodes = driving.load_episodes(
                    driving.episodes_at(work / "evaluation" / job, file)
                )
                row = policy_row(f"{job}/{file}", "greedy", episodes)
                label = {"name": f"{name} {mode}".strip(), "seed": seed}
                rows.append(label | {"value": intersection.value_at(row, angle)} | row)
    return rows


def _of_mixture(policies: Sequence[Row]) -> list[Row]:
    """Return J of each policy of a mixture at the angles of the modes, its own angle or not."""
    return [
        {"method": name or "IQ-Learn", "asked": angle, "seed": row["seed"]}
        | {"value": intersection.value_at(row, angle)}
        for job, (name, of_angles) in POLICIES.items()
        if job != EXPERTS
        for mode, angle in MODES.items()
        for row in matching(policies, name=f"{name} {mode}".strip() if of_angles else name)
    ]


def main_table(policies: Sequence[Row], dials: Sequence[Row]) -> list[Row]:
    """Return each metric of Tables 6.1 and 6.2 over seeds; dials are included at the modes' angles.

    Args:
        policies: Rows of experts and of policies of a mixture.
        dials: Rows of the dials at every angle.

    Returns:
        A row for each metric and policy with mean, deviation and range; shares are in percent.
    """
    by_name = {name: rows for (name,), rows in groups(policies, "name").items()}
    modes = {angle: mode for mode, angle in MODES.items()}
    for (kind, angle), rows in groups(dials, "kind", "asked").items():
        if angle in modes:
            by_name[f"{_short(kind)} dial {modes[angle]}"] = rows
    result: list[Row] = []
    for metric in METRICS:
        factor = 100 if metric in _PERCENT else 1
        for name, rows in by_name.items():
            values = [factor * row[metric] for row in rows]
            sd = float(np.std(values, ddof=1)) if len(values) > 1 else ""
            result.append(
                {"policy": name, "metric": metric, "mean": float(np.mean(values)), "sd": sd}
                | {"low": min(values), "high": max(values), "seeds": len(values)}
            )
    return result


def _families(dials: Sequence[Row]) -> list[Row]:
    """Return J and regret at each angle, means of both, and monotony, of each dial of a kind."""
    corner = intersection.points_of(dials).min(axis=0)
    return [
        label
        | {f"value_{row['asked']:g}": row["value"] for row in rows}
        | {f"mean_{name}": mean(rows, name) for name in ("value", "regret")}
        | {"hypervolume": hypervolume(intersection.points_of(rows), corner)}
        | intersection.backward_steps(rows)
        for label, rows in labelled(dials, "kind", "seed")
    ]


def _differences(families: Sequence[Row]) -> list[Row]:
    """Return the differences of each pair of kinds, paired by training seed, corrected together."""
    measures = [name for name in families[0] if name.startswith("value_")]
    measures += ["mean_value", "hypervolume"]
    compared = []
    for pair in _PAIRS:
        first_rows, second_rows = (matching(families, kind=kind) for kind in pair)
        label = {"kinds": " less ".join(_short(kind) for kind in pair)}
        rows = paired_differences(first_rows, second_rows, *measures, label="measure")
        compared += [label | row for row in rows]
    return with_holm(compared)


def _short(kind: str) -> str:
    return kind.removeprefix("dials/")
