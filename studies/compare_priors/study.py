"""`compare priors`: choose each method's λ on development seeds, then train on other seeds.

Every method of a world has the same updates, environment steps, network, rates and data sets.
"""

import operator
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from socialiq import score, weights
from socialiq.evaluation.exact import Ground
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.dial import config as dial
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.iq_learn import losses
from socialiq.results_folder import Results
from socialiq.social.angle import angle_difference
from socialiq.types import Row
from socialiq_lab import comparison, comparison_runs, comparison_tables
from socialiq_lab.comparison import DEVELOPMENT, FRESH, GRIDWORLDS, Method
from socialiq_lab.comparison_jobs import ROWS, GridRuns, evaluated, grid_job, job_rows
from socialiq_lab.comparison_runs import Arena, Learner, Run
from socialiq_lab.jobs import Inputs, Job, ProgressCallback, write_rows
from socialiq_lab.registry import declaration
from socialiq_lab.study import Context, Findings, View
from socialiq_lab.tables import column, groups, labelled, nested, with_holm

METHODS = comparison.declared_methods(declaration("compare-priors"))
"""The comparison's rows by name."""

THESIS_STRENGTHS = {"crossing5": presets.POC_STRENGTH, "crossing7": presets.GRID_STRENGTH}
"""λ of each world's own study, also in the column of methods without one."""

KEYS = ("world", "method", "strength", "target_angle", "readout")
DIAL_RATES = ("temperature", "learning_rate", "discount", "polyak")
"""Hyperparameters that a dial has in common with the other rows."""


LEARNERS: Mapping[str, Learner] = {
    **comparison_runs.LEARNERS,
    "dial": comparison_runs.dialled(
        dial.DialConfig(), dial.DialHyperparameters(final_rate=1.0), *DIAL_RATES
    ),
}
"""By the `learner` of a method in STUDY.toml."""

SCALES: Mapping[str, tuple[str, ...]] = {
    "iq_learn": ("strength", "reweight_temperature"),
    "dial": ("strength",),
    "cql": ("strength",),
    "rl": (),
    "clone": ("reweight_temperature",),
}
"""Settings of each learner that are λ, or 1/λ."""


def train(arena: Arena, method: Method, runs: Sequence[Run]) -> list[Any]:
    """Train a method; its learner gets a run's λ under the names of the learner's settings.

    Args:
        arena: Common inputs of all methods.
        method: Method of the comparison.
        runs: Training runs, whose setting is `strength`, λ.

    Returns:
        A policy for each run.
    """
    own_runs = []
    for run in runs:
        ((_, strength),) = run.setting
        values = {"strength": strength, "reweight_temperature": 1 / strength}
        setting = tuple((name, values[name]) for name in SCALES[method.learner])
        own_runs.append(run._replace(setting=setting))
    return comparison_runs.trained(LEARNERS[method.learner], arena, method, own_runs)


def jobs(config: Any) -> list[Job]:
    """Return the jobs of every method with a λ, at each λ."""
    return [
        _job(config, DEVELOPMENT, world, method, config.strengths)
        for world, method in comparison.cells_of(config, METHODS, GRIDWORLDS)
        if method.settings
    ]


def more_jobs(config: Any, work: Path) -> list[Job]:
    """Return every method's jobs at the λ that the development jobs' folders choose.

    Args:
        config: Configuration of the study.
        work: Folder of the jobs.
    """
    developed = job_rows(jobs(config), work, DEVELOPMENT)
    chosen = comparison_tables.choose(developed, "strength")
    planned = []
    for world, method in comparison.cells_of(config, METHODS, GRIDWORLDS):
        strength = chosen.get((world, method.name), THESIS_STRENGTHS[world])
        planned.append(_job(config, FRESH, world, method, (strength,)))
    return planned


def _job(config: Any, phase: str, world: str, method: Method, strengths: tuple[float, ...]) -> Job:
    settings = comparison.product(strength=strengths)
    runs = GridRuns.of(config, phase, world, method, settings, config.updates, chunk=500)
    return grid_job(f"priors/{world}/{phase}/{method.name}", run_method, runs, method)


def run_method(
    config: GridRuns, folder: Path, _inputs: Inputs, on_progress: ProgressCallback
) -> None:
    """Train every run and write a row for each policy, angle and action selection.

    Args:
        config: Runs of one method in a gridworld.
        folder: Folder of the job, to which the rows are written.
        on_progress: Callback of the finished share, 0 to 1.
    """
    method = METHODS[config.method]

    def columns(arena: Arena, run: Run) -> tuple[Row, Row]:
        return dict(run.setting), {"effective_share": effective_share(arena, method, run)}

    def trained(_ground: Ground, arena: Arena, runs: Sequence[Run]) -> list[Any]:
        return train(arena, method, runs)

    rows = evaluated(config, method, trained, columns, folder, on_progress)
    is_one_policy = method.serves == "all" and method.learner != "dial"
    order = ("seed", "readout") if is_one_policy else ("target_angle",)
    rows.sort(key=operator.itemgetter(*order))
    write_rows(folder / ROWS, rows)
    on_progress(1.0)


def effective_share(arena: Arena, method: Method, run: Run) -> float:
    """Return the effective share of transitions under a method's weights (B.2).

    Args:
        arena: Common inputs of all methods, with the data sets.
        method: Method of the comparison.
        run: Training run; its angle, data set and λ are read.

    Returns:
        Share from 0 to 1: 0 without data, 1 without weights.
    """
    data = arena.datasets[run.dataset]
    temperature = 1 / dict(run.setting)["strength"]
    match method.name:
        case "rl":
            return 0.0
        case "clone_of_mode":
            of_mode = comparison.of_modes(data, (comparison.nearest_mode(run.angle),))
            return of_mode.n_transitions / data.n_transitions
        case "clone_weighted":
            numbers = bc.CloningHyperparameters(angle=run.angle, reweight_temperature=temperature)
            return bc.effective_size(data, numbers) / data.n_transitions
        case "reweighting":
            returns = data.returns("running", arena.structure.social_discount)
            scores = jnp.asarray(score(weights(run.angle), returns))
            rows = losses.demonstration_weights(scores, jnp.ones(len(scores), bool), temperature)
            return float(losses.effective_sample_size(rows)) / data.n_transitions
    return 1.0


def compute_tables(config: Any, context: Context) -> Findings:
    """Compute rows, their means over seeds, and the rows from which λ was chosen.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        All tables, and pooled metrics and counts of alignment as summary.
    """
    developed, fresh = (job_rows(context.jobs, context.work, p) for p in (DEVELOPMENT, FRESH))
    tables = comparison_tables.tables_of(config, fresh, developed, KEYS, ("effective_share",))
    tables["alignment"] = alignment(fresh)
    tables["chosen"] = [
        {"world": world, "method": method, "strength": float(strength)}
        for (world, method), strength in comparison_tables.choose(developed, "strength").items()
    ]
    names = ("value", "regret", "regret_low", "regret_high", "angle", "arrival")
    keys = ("world", "method", "readout", "target_angle")
    summary = nested(tables["pooled"], *keys, keep=names)
    for row in tables["pooled"]:
        summary[row["world"]][row["method"]]["strength"] = row["strength"]
    return Findings(tables, summary | {"alignment": alignment_counts(tables["alignment"])})


def alignment(policies: Sequence[Row]) -> list[Row]:
    """Return Spearman's ρ of |α̂ - α| and regret over policies, two-sided, Holm over all rows."""
    from scipy.stats import spearmanr

    keys = ("world", "readout", "target_angle")
    rows: list[Row] = []
    for label, group in labelled(policies, *keys):
        error = np.array(
            [abs(angle_difference(row["angle"], row["target_angle"])) for row in group]
        )
        regret = np.array(column(group, "regret"))
        if len(group) < 3 or np.ptp(error) == 0 or np.ptp(regret) == 0:
            continue  # ranks need a difference
        test: Any = spearmanr(error, regret)
        entry = {
            "policies": len(group),
            "spearman": float(test.statistic),
            "p": float(test.pvalue),
            "error_at_least_regret": float(error[regret.argmin()]),
            "regret_at_least_error": float(regret[error.argmin()]),
            "least_regret": float(regret.min()),
        }
        rows.append(label | entry)
    return with_holm(rows)


def alignment_counts(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the numbers of groups with a positive, a negative and no significant correlation."""
    sure = [row for row in rows if row["p_holm"] < 0.05]
    ties = [row["regret_at_least_error"] <= row["least_regret"] + 1e-9 for row in rows]
    return {
        "groups": len(rows),
        "alike": sum(row["spearman"] > 0 for row in sure),
        "against": sum(row["spearman"] < 0 for row in sure),
        "neither": len(rows) - len(sure),
        "least_error_has_least_regret": sum(ties),
    }


def _scale(row: Row) -> float | str:
    """Return λ, or 1/τ_w, of a method that has one, else a dash."""
    method = METHODS[row["method"]]
    return row["strength"] if method.settings or method.name == "thesis" else "-"


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw a figure for each world, with greedy and soft action selection."""
    figures = {}
    for (world,), rows in groups(results.tables["pooled"], "world").items():
        labels = {}
        for (name,), of_method in groups(rows, "method").items():
            sign = "1/τ_w" if name in ("reweighting", "clone_weighted") else "λ"
            scale = _scale(of_method[0])
            suffix = "" if scale == "-" else f" ({sign} = {scale:g})"
            labels[name] = METHODS[name].label + suffix
        figures[world] = comparison_tables.angle_figure(results, world, labels)
    return figures


def view(results: Results) -> Sequence[View]:
    """Return a table of methods by target angle for each world and action selection."""
    views = []
    for (world, readout), rows in groups(results.tables["pooled"], "world", "readout").items():
        table = [
            {"method": METHODS[method].label, "λ": _scale(group[0])}
            | {f"{row['target_angle']:g}°": row["regret"] for row in group}
            for (method,), group in groups(rows, "method").items()
        ]
        title = f"{world}, {readout}: regret at the target angle, mean over seeds"
        views.append(View(table, title))
    return views
