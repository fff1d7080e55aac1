"""`compare methods`: choose each method's settings on development seeds, then train on others.

Every method of a world has the same updates, environment steps, data sets and number of settings to
choose from, and a network of the same hidden layers.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from socialiq.evaluation import rollout
from socialiq.evaluation.exact import Ground
from socialiq.learners.settings import check_widths
from socialiq.results_folder import Results, from_csv
from socialiq.types import Row
from socialiq_lab import comparison, comparison_jobs, comparison_tables
from socialiq_lab.comparison import DEVELOPMENT, FRESH, GRIDWORLDS, Method
from socialiq_lab.comparison_jobs import ROWS, SPEED, GridRuns, job_rows
from socialiq_lab.comparison_runs import Arena, Run, trained
from socialiq_lab.jobs import Inputs, Job, ProgressCallback, write_rows
from socialiq_lab.study import Context, Findings, View
from socialiq_lab.tables import column, groups, matching, mean, paired_row, with_holm
from studies.compare_methods import intersection, learners
from studies.compare_methods.intersection import METHODS

TOLD = ("labels", "ranks", "rewards", "environment")
"""Inputs beside observations and actions; STUDY.toml explains them."""

ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
KEYS = ("world", "method", "setting", "target_angle", "readout")
READOUT = "greedy"  # action selection by which settings are chosen and methods compared


def updates_of(method: Method, updates: int) -> int:
    """Return the gradient steps of one network: all networks of a method have as many together.

    Args:
        method: Method of the comparison.
        updates: Gradient steps of a network that serves one angle.
    """
    shares = {"angle": len(ANGLES), "mode": len(rollout.MODES), "all": 1}
    return updates * len(ANGLES) // shares[method.serves]


def jobs(config: Any) -> list[Job]:
    """Return the jobs of every method at each of its settings, and the peers' environments."""
    check_widths(config.intersection_hidden)
    return phase_jobs(config, DEVELOPMENT, None)


def more_jobs(config: Any, work: Path) -> list[Job]:
    """Return every method's jobs at the setting that the development jobs' folders choose.

    Args:
        config: Configuration of the study.
        work: Folder of the jobs.
    """
    return phase_jobs(config, FRESH, choose(job_rows(jobs(config), work, DEVELOPMENT)))


def phase_jobs(config: Any, phase: str, chosen: Mapping[tuple[str, str], str] | None) -> list[Job]:
    """Return every method's jobs, at all settings or the chosen ones, each after its inputs.

    Args:
        config: Configuration of the study.
        phase: `DEVELOPMENT` or `FRESH`.
        chosen: Name of the chosen setting by world and method; None for all settings.
    """
    cells = comparison.cells_of(config, METHODS)
    libraries = dict.fromkeys(method.peer for _, method in cells if method.peer)
    planned = [learners.environment_job(library) for library in libraries]
    if intersection.WORLD in config.worlds:
        planned += intersection.shared_jobs(config, phase)
    for world, method in cells:
        settings = method.settings
        if chosen is not None:
            settings = (method.setting_of(chosen[world, method.name]),)
        if world not in GRIDWORLDS:
            updates = updates_of(method, config.intersection_updates)
            planned += intersection.jobs_of(config, phase, method, updates, settings)
            continue
        updates = updates_of(method, config.updates)
        runs = GridRuns.of(config, phase, world, method, settings, updates)
        name = f"methods/{world}/{phase}/{method.name}"
        inputs = (learners.environment_job(method.peer).name,) if method.peer else ()
        seconds = 8.0 if method.peer else 1.0
        planned.append(comparison_jobs.grid_job(name, run_method, runs, method, seconds, *inputs))
    return planned


def run_method(
    config: GridRuns, folder: Path, inputs: Inputs, on_progress: ProgressCallback
) -> None:
    """Train every run and write a row for each policy, angle and action selection.

    Args:
        config: Runs of one method in a gridworld.
        folder: Folder of the job, to which rows and speed are written.
        inputs: Folder of the peer's environment, if the method has one.
        on_progress: Callback of the finished share, 0 to 1.
    """
    method = METHODS[config.method]

    def train(ground: Ground, arena: Arena, runs: Sequence[Run]) -> list[Any]:
        if not method.peer:
            return trained(learners.LEARNERS[method.learner], arena, method, runs)
        (environment,) = inputs.values()
        served = method.served(config.angles)
        return learners.train_tabular(arena, ground, method, runs, served, environment, folder)

    def columns(_arena: Arena, run: Run) -> tuple[Row, Row]:
        return {"setting": comparison.setting_name(run.setting)}, {}

    rows = comparison_jobs.evaluated(config, method, train, columns, folder, on_progress)
    write_rows(folder / ROWS, rows)
    on_progress(1.0)


def choose(rows: Sequence[Row]) -> dict[tuple[str, str], str]:
    """Return, for each world and method, the setting with the greatest mean J(α), greedy."""
    return comparison_tables.choose(matching(rows, readout=READOUT), "setting")


def compute_tables(config: Any, context: Context) -> Findings:
    """Compute rows, their means over seeds, and the rows from which settings were chosen.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        All tables.
    """
    planned = context.jobs
    work = context.work
    fresh = job_rows(planned, work, FRESH)
    developed = job_rows(planned, work, DEVELOPMENT)
    tables = comparison_tables.tables_of(config, fresh, developed, KEYS)
    tables["overall"] = overall(tables["pooled"], job_rows(planned, work, FRESH, SPEED))
    tables["paired"] = paired(fresh)
    if intersection.WORLD in config.worlds:
        tables["demonstrators"] = from_csv(work / intersection.DEMONSTRATORS / ROWS)
    return Findings(tables, {})


def overall(pooled: Sequence[Row], speeds: Sequence[Row]) -> list[Row]:
    """Return a row for each method and readout: regret over all angles, steering and inputs.

    `steering` is α̂ at the largest target angle less α̂ at the smallest, in degrees;
    `r_social_gain` is that difference of r_social.

    Args:
        pooled: Means over seeds of each method, angle and readout.
        speeds: Updates per second of each method.
    """
    keys = ("world", "method", "setting", "readout")
    measured = {(row["world"], row["method"]): row for row in speeds}
    rows = []
    by_method = comparison_tables.overall(pooled, keys)
    for row, group in zip(by_method, groups(pooled, *keys).values(), strict=True):
        ends = sorted(group, key=lambda row: row["target_angle"])
        told = METHODS[row["method"]].told
        speed = measured.get((row["world"], row["method"]), {})
        rows.append(
            row
            | {"steering": ends[-1]["angle"] - ends[0]["angle"]}
            | {"r_social_gain": ends[-1]["r_social"] - ends[0]["r_social"]}
            | {"collision": mean(group, "collision"), "arrival": mean(group, "arrival")}
            | {name: int(name in told) for name in TOLD}
            | {name: speed.get(name, "") for name in ("updates_per_second", "device")}
        )
    return rows


def paired(policies: Sequence[Row]) -> list[Row]:
    """Test each mean J(α) over angles against the greatest: paired by seed, Holm in a world."""
    rows: list[Row] = []
    for (world,), group in groups(matching(policies, readout=READOUT), "world").items():
        scores = {
            method: [mean(of_seed, "value") for of_seed in groups(of_method, "seed").values()]
            for (method,), of_method in groups(group, "method").items()
        }
        best = max(scores, key=lambda name: sum(scores[name]))
        if len(scores[best]) < 2:
            continue
        tests = [
            paired_row({"world": world, "best": best, "method": name}, scores[best], method_scores)
            for name, method_scores in scores.items()
            if name != best
        ]
        rows += with_holm(tests)
    return rows


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw a figure of greedy policies for each world."""
    labels = {name: method.label for name, method in METHODS.items()}
    return {
        world: comparison_tables.angle_figure(results, world, labels, (READOUT,))
        for world in dict.fromkeys(column(results.tables["pooled"], "world"))
    }


def view(results: Results) -> Sequence[View]:
    """Return a table of methods by target angle for each world, the best by the mean first."""
    views = []
    greedy = matching(results.tables["overall"], readout=READOUT)
    for (world,), by_row in groups(greedy, "world").items():
        measured = comparison_tables.quantity(results, world)
        sign = 1.0 if measured == "regret" else -1.0
        pooled = matching(results.tables["pooled"], world=world, readout=READOUT)
        by_method = groups(pooled, "method")
        rows = []
        for row in sorted(by_row, key=lambda row: sign * row[measured]):
            of_method = by_method[row["method"],]
            at_angles = {f"{at['target_angle']:g}°": at[measured] for at in of_method}
            told = ", ".join(name for name in TOLD if row[name]) or "nothing"
            rows.append(
                {"method": METHODS[row["method"]].label, "mean": row[measured]}
                | at_angles
                | {name: row[name] for name in ("steering", "collision", "arrival")}
                | {"told": told, "updates/s": row["updates_per_second"], "on": row["device"]}
            )
        views.append(View(rows, f"{world}, greedy: {measured} by target angle"))
    return views
