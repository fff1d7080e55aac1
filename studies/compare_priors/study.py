"""`compare priors`: choose each method's λ on development seeds, then train on other seeds.

Every method of a world has the same updates, environment steps, network, rates and data sets.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from socialiq.evaluation.exact import Ground
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.cql import ConservativeQ
from socialiq.learners.dial import config as dial
from socialiq.learners.dial.train import train as train_dial
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.iq_learn import losses
from socialiq.results_folder import Results, as_csv, from_csv
from socialiq.social.angle import angle_difference, score, weights
from socialiq.storage import write_atomically
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq_lab import comparison
from socialiq_lab.comparison import EPISODES_EACH, GRIDWORLDS, nearest_mode, of_modes
from socialiq_lab.comparison_figures import angle_figure
from socialiq_lab.comparison_runs import (
    Arena,
    GridRuns,
    Learner,
    Method,
    Run,
    in_programs,
    iq_learn,
    offline,
    product,
    reinforcement,
    rows_of,
    runs_of,
)
from socialiq_lab.jobs import Job, ProgressCallback
from socialiq_lab.study import Context, Findings, Study, View
from socialiq_lab.tables import column, groups, with_holm

THESIS_STRENGTHS = {"crossing5": presets.POC_STRENGTH, "crossing7": presets.GRID_STRENGTH}
"""λ of each world's own study, also in the column of methods without one."""

FASTER = 3
"""Factor on the learning rates of 6.2, with a third of its updates: the table costs a third."""

DEVELOPMENT, FRESH, ROWS = "development", "fresh", "rows.csv"
KEYS = ("world", "method", "strength", "target_angle", "readout")

# ----------------------------------------------------------------------------------------------
# Methods
# ----------------------------------------------------------------------------------------------

SCALES = product(strength=(1.0, 3.0, 10.0))
"""λ (or 1/τ_w) that can be chosen."""

METHODS = (
    Method("none", "IQ-Learn, no prior", "none", (), serves="all"),
    Method("thesis", "running returns, the thesis' λ", "running", ()),
    Method("running", "running returns", "running", SCALES),
    Method("to_go", "returns-to-go", "to_go", SCALES),
    Method("trajectory", "whole-episode returns", "trajectory", SCALES),
    Method("instantaneous", "instantaneous rewards", "instantaneous", SCALES),
    Method("advantage", "advantages", "advantage", SCALES),
    Method("shifted_chi2", "shifted χ², instantaneous", "shifted_chi2", SCALES),
    # In term 1 the shift has no gradient, whatever λ and angle (tests/identities).
    Method("bellman_shift", "Bellman shift, term 1", "bellman_shift", (), serves="all"),
    Method("bellman_shift_1_3", "Bellman shift, terms 1 and 3", "bellman_shift_1_3", SCALES),
    Method("reweighting", "reweighting", "reweighting", SCALES),
    Method("dial", "the dial, one network", "dial", SCALES, serves="all"),
    Method("clone", "BC, pooled", "clone", (), serves="all"),
    Method("clone_of_mode", "BC of the nearest mode", "clone_of_mode", ()),
    Method("clone_weighted", "BC weighted by R(α)", "clone_weighted", SCALES),
    Method("cql", "CQL on λ R(α)", "cql", SCALES),
    # The temperature of deep Q-learning has no meaning.
    Method("rl", "RL on R(α), no demonstrations", "rl", (), soft=False),
)
"""Rows of the comparison; those without settings have no λ."""

BY_NAME = {method.name: method for method in METHODS}


def scaled(learner: Learner, *names: str) -> Learner:
    """Return a learner that is given a run's λ under the names of its own settings."""

    def train(arena: Arena, method: Method, runs: Sequence[Run]) -> list[Any]:
        placed = []
        for run in runs:
            strength = dict(run.setting)["strength"]
            values = {"strength": strength, "reweight_temperature": 1 / strength}
            placed.append(run._replace(setting=tuple((name, values[name]) for name in names)))
        return learner(arena, method, placed)

    return train


def prior(name: str, target_kind: str = "instantaneous", **fixed: Any) -> Learner:
    """Return IQ-Learn with the social score at a place, and a target of the score."""
    learner = iq_learn(prior=name, target_kind=target_kind, **fixed)
    return scaled(learner, "strength", "reweight_temperature")


def dial_settings(
    base: iq.IQLearnConfig, rates: iq.IQLearnHyperparameters, updates: int, run: Run
) -> tuple[dial.DialConfig, dial.DialHyperparameters]:
    """Return the settings of a dial at the budget of the other rows."""
    names = ("hidden", "activation", "view", "endings", "replay_capacity")
    static = dial.DialConfig(
        **{name: getattr(base, name) for name in names},
        updates=updates,
        expert_batch=base.batch_size,
        replay_batch=base.batch_size,
        environments=base.env_steps_per_update,
    )
    names = ("temperature", "learning_rate", "discount", "polyak")
    numbers: dict[str, Any] = {name: getattr(rates, name) for name in names}
    numbers |= dict(run.setting)
    numbers |= {"final_rate": 1.0, "seed": run.seed, "dataset": run.dataset}
    return static, dial.DialHyperparameters(**numbers)


def train_dials(arena: Arena, _method: Method, runs: Sequence[Run]) -> list[Any]:
    """Train a network for all angles of a seed and λ, at the other rows' budget of an angle."""
    budget = arena.structure, arena.numbers, arena.updates
    return in_programs(
        [dial_settings(*budget, run) for run in runs],
        lambda static, numbers: train_dial(
            static,
            numbers,
            arena.datasets,
            arena.world,
            callbacks=arena.callbacks(),
            chunk=arena.chunk,
        ),
    )


LEARNERS: Mapping[str, Learner] = {
    "none": prior("none"),
    **{name: prior("reward", name) for name in ("running", "to_go", "trajectory")},
    **{name: prior("reward", name) for name in ("instantaneous", "advantage")},
    "shifted_chi2": prior("shifted_chi2"),
    "bellman_shift": prior("bellman_shift", "running"),
    "bellman_shift_1_3": prior("bellman_shift", "running", shift_term_3=True),
    "reweighting": prior("reweighting", "running"),
    "dial": train_dials,
    "clone": scaled(offline(bc.BehaviourCloning), "reweight_temperature"),
    "clone_of_mode": scaled(offline(bc.BehaviourCloning, True), "reweight_temperature"),
    "clone_weighted": scaled(offline(bc.BehaviourCloning, weighted=True), "reweight_temperature"),
    "cql": scaled(offline(ConservativeQ), "strength"),
    "rl": scaled(reinforcement),
}
"""By the name in `Method.learner`."""

# ----------------------------------------------------------------------------------------------
# Configuration and jobs
# ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Config:
    """One budget and the same seeds for every method of a world."""

    worlds: tuple[str, ...] = GRIDWORLDS
    """Worlds of the comparison."""
    methods: tuple[str, ...] = tuple(BY_NAME)
    """Names of `METHODS`."""
    angles: tuple[float, ...] = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
    """Target angles in degrees."""
    development_angles: tuple[float, ...] = (0.0, 45.0, 90.0)
    """Angles at which λ is chosen."""
    strengths: tuple[float, ...] = (1.0, 3.0, 10.0)
    """λ that can be chosen, or 1/τ_w, ascending."""
    development_seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    """Training seeds on which λ is chosen, each with its own data set."""
    seeds: tuple[int, ...] = (10, 11, 12, 13, 14)
    """Training seeds of the table, each with its own data set."""
    updates: int = presets.GRID.updates // FASTER
    """Gradient steps, and as many steps in the world."""
    learning_rate: float = FASTER * presets.TABLE_C1_NUMBERS.learning_rate
    polyak: float = FASTER * presets.TABLE_C1_NUMBERS.polyak

    def __post_init__(self) -> None:
        """Refuse unknown worlds and methods, empty options, and seeds used twice."""
        names = tuple(BY_NAME)
        comparison.check_choices(self, names, self.development_seeds, self.seeds, GRIDWORLDS)

    @property
    def rows(self) -> list[Method]:
        """Methods in the order of the table."""
        return [BY_NAME[name] for name in self.methods]


def development_jobs(config: Config) -> list[Job]:
    """Return the jobs of every method with a λ, at each λ."""
    return [
        _job(config, DEVELOPMENT, world, method, config.strengths)
        for world in config.worlds
        for method in config.rows
        if method.settings
    ]


def chosen_jobs(config: Config, work: Path) -> list[Job]:
    """Return every method's jobs at the λ that the development jobs' folders choose."""
    chosen = comparison.choose(list(_rows(config, DEVELOPMENT, work)), "strength")
    return [
        _job(config, FRESH, world, method, (strength_of(world, method, chosen),))
        for world in config.worlds
        for method in config.rows
    ]


def strength_of(world: str, method: Method, chosen: Mapping[tuple[str, str], float]) -> float:
    """Return the λ of a method's fresh runs."""
    return chosen[world, method.name] if method.settings else THESIS_STRENGTHS[world]


def _job(
    config: Config, phase: str, world: str, method: Method, strengths: tuple[float, ...]
) -> Job:
    fresh = phase == FRESH
    angles = config.angles if fresh else config.development_angles
    rates = {"learning_rate": config.learning_rate, "polyak": config.polyak}
    run = GridRuns(
        world,
        method.name,
        dataclasses.replace(presets.TABLE_C1, updates=config.updates),
        dataclasses.replace(presets.TABLE_C1_NUMBERS, **rates),
        config.updates,
        angles,
        product(strength=strengths),
        config.seeds if fresh else config.development_seeds,
        EPISODES_EACH[world],
        chunk=500,
    )
    count = len(run.seeds) * len(strengths) * len(method.served(angles))
    return Job(_name(phase, world, method), run_method, run, cost=count + 10.0)


def _name(phase: str, world: str, method: Method) -> str:
    return f"priors/{world}/{phase}/{method.name}"


def run_method(
    config: GridRuns, folder: Path, _inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Train every run and write a row for each policy, angle and action selection."""
    ground, method = Ground.of(config.world), BY_NAME[config.method]
    arena = config.arena(ground, on_progress)
    served = method.served(config.angles)
    runs = sorted(runs_of(config.settings, served, config.seeds), key=lambda run: run.angle)
    rows: list[Row] = []
    for run, policy in zip(runs, LEARNERS[method.learner](arena, method, runs), strict=True):
        label = {"world": config.world, "method": method.name} | dict(run.setting)
        policy_rows = rows_of(ground, method, label, run.seed, policy, served[run.angle])
        if not hasattr(policy, "at"):  # one policy, whatever the angle
            policy_rows.sort(key=lambda row: method.readouts.index(row["readout"]))
        share = effective_share(arena, method, run)
        rows += [row | {"effective_share": share} for row in policy_rows]
    if method.learner == "dial":
        rows.sort(key=lambda row: row["target_angle"])
    write_atomically(folder / ROWS, as_csv(rounded(rows)))
    on_progress(1.0)


def effective_share(arena: Arena, method: Method, run: Run) -> float:
    """Return the effective share of transitions under a method's weights (B.2); 0 without data."""
    data, temperature = arena.datasets[run.dataset], 1 / dict(run.setting)["strength"]
    match method.learner:
        case "rl":
            return 0.0
        case "clone_of_mode":
            return of_modes(data, (nearest_mode(run.angle),)).n_transitions / data.n_transitions
        case "clone_weighted":
            numbers = bc.CloningHyperparameters(angle=run.angle, reweight_temperature=temperature)
            return bc.effective_size(data, numbers) / data.n_transitions
        case "reweighting":
            returns = data.returns("running", arena.structure.social_discount)
            scores = jnp.asarray(score(weights(run.angle), returns))
            rows = losses.demonstration_weights(scores, jnp.ones(len(scores), bool), temperature)
            return float(losses.effective_sample_size(rows)) / data.n_transitions
    return 1.0


# ----------------------------------------------------------------------------------------------
# Tables, figures, views
# ----------------------------------------------------------------------------------------------


def _rows(config: Config, phase: str, work: Path) -> Iterator[Row]:
    """Yield the rows of a phase."""
    for world, method in itertools.product(config.worlds, config.rows):
        if phase == FRESH or method.settings:
            yield from from_csv(work / _name(phase, world, method) / ROWS)


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute rows, their means over seeds, and the rows from which λ was chosen."""
    developed = list(_rows(config, DEVELOPMENT, context.work))
    fresh = list(_rows(config, FRESH, context.work))
    pooled, aligned = means(fresh), alignment(fresh)
    references = [comparison.references(world, config.angles) for world in config.worlds]
    tables = {
        "policies": fresh,
        "pooled": pooled,
        "overall": comparison.overall(pooled, ("world", "method", "strength", "readout")),
        "alignment": aligned,
        "references": [row for rows in references for row in rows],
        "development": means(developed),
        "chosen": [
            {"world": world, "method": method, "strength": float(strength)}
            for (world, method), strength in comparison.choose(developed, "strength").items()
        ],
    }
    summary = summarise(pooled) | {"alignment": alignment_counts(aligned)}
    return Findings(tables, summary)


def means(rows: Sequence[Row]) -> list[Row]:
    """Return means over seeds (`comparison.means`)."""
    return comparison.means(rows, KEYS, ("effective_share",))


def summarise(pooled: Sequence[Row]) -> dict[str, Any]:
    """Return λ, α̂, arrival and value by world, method, action selection and target angle."""
    summary: dict[str, Any] = {}
    for row in pooled:
        method = summary.setdefault(row["world"], {}).setdefault(row["method"], {})
        method["strength"] = row["strength"]
        entry = method.setdefault(row["readout"], {})
        names = ("value", "regret", "regret_low", "regret_high", "angle", "arrival")
        entry[f"{row['target_angle']:g}"] = {name: row[name] for name in names}
    return summary


def alignment(policies: Sequence[Row]) -> list[Row]:
    """Return the rank correlation of |α̂ - α| and regret by world, action selection and angle.

    Each policy of each method and seed is a point. The p-value of Spearman's ρ is two-sided,
    adjusted by Holm over all rows. Each row also has the angle error of the policy of least
    regret, and the regret of the policy of least angle error.
    """
    from scipy.stats import spearmanr

    keys = ("world", "readout", "target_angle")
    rows: list[Row] = []
    for values, group in groups(policies, *keys).items():
        errors = [abs(angle_difference(row["angle"], row["target_angle"])) for row in group]
        error, regret = np.array(errors), np.array(column(group, "regret"))
        if len(group) < 3 or np.ptp(error) == 0 or np.ptp(regret) == 0:
            continue  # ranks need a difference
        test: Any = spearmanr(error, regret)
        rows.append(
            dict(zip(keys, values, strict=True))
            | {"policies": len(group), "spearman": float(test.statistic)}
            | {"p": float(test.pvalue)}
            | {"error_at_least_regret": float(error[regret.argmin()])}
            | {"regret_at_least_error": float(regret[error.argmin()])}
            | {"least_regret": float(regret.min())}
        )
    return with_holm(rows)


def alignment_counts(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the numbers of groups with a positive, a negative and no significant correlation."""
    sure = [row for row in rows if row["p_holm"] < 0.05]
    return {
        "groups": len(rows),
        "alike": sum(row["spearman"] > 0 for row in sure),
        "against": sum(row["spearman"] < 0 for row in sure),
        "neither": len(rows) - len(sure),
        "least_error_has_least_regret": sum(
            row["regret_at_least_error"] <= row["least_regret"] + 1e-9 for row in rows
        ),
    }


def _scale(row: Row) -> float | str:
    """Return λ, or 1/τ_w, of a method that has one, else a dash."""
    method = BY_NAME[row["method"]]
    return row["strength"] if method.settings or method.name == "thesis" else "-"


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw a figure for each world: greedy beside soft."""
    figures = {}
    for (world,), rows in groups(results.tables["pooled"], "world").items():
        labels = {}
        for (name,), of_method in groups(rows, "method").items():
            sign = "1/τ_w" if name in ("reweighting", "clone_weighted") else "λ"
            scale = _scale(of_method[0])
            suffix = "" if scale == "-" else f" ({sign} = {scale:g})"
            labels[name] = BY_NAME[name].label + suffix
        figures[world] = angle_figure(results, world, labels)
    return figures


def view(results: Results) -> Sequence[View]:
    """Return a table of methods by target angle for each world and action selection."""
    views = []
    for (world, readout), rows in groups(results.tables["pooled"], "world", "readout").items():
        table = [
            {"method": BY_NAME[method].label, "λ": _scale(group[0])}
            | {f"{row['target_angle']:g}°": row["regret"] for row in group}
            for (method,), group in groups(rows, "method").items()
        ]
        title = f"{world}, {readout}: regret at the target angle, mean over seeds"
        views.append(View(table, title))
    return views


STUDY = Study(
    name="compare-priors",
    Config=Config,
    jobs=development_jobs,
    more_jobs=chosen_jobs,
    tables=compute_tables,
    figures=draw_figures,
    view=view,
)
