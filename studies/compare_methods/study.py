"""`compare methods`: choose each method's settings on development seeds, then train on others.

Every method of a world has the same updates, environment steps, data sets and number of settings to
choose from, and a network of the same hidden layers.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from socialiq.errors import UserError
from socialiq.evaluation.exact import Ground
from socialiq.evaluation.rollout import MODES
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.settings import check_counts, check_widths
from socialiq.results_folder import Results, as_csv, from_csv
from socialiq.storage import write_atomically
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq_lab import comparison
from socialiq_lab.comparison import EPISODES_EACH, GRIDWORLDS, check_choices
from socialiq_lab.comparison_figures import angle_figure, quantity
from socialiq_lab.comparison_runs import (
    GridRuns,
    Method,
    Setting,
    rows_of,
    runs_of,
    setting_name,
)
from socialiq_lab.intersection.driving import FIRST_EPISODE
from socialiq_lab.jobs import Job, ProgressCallback
from socialiq_lab.study import Context, Findings, Study, View
from socialiq_lab.tables import column, groups, matching, mean, paired_row, with_holm
from studies.compare_methods import intersection, peers
from studies.compare_methods.intersection import ROWS, SPEED
from studies.compare_methods.methods import BY_NAME, PEERS, SETTINGS_EACH, TOLD
from studies.compare_methods.training import LEARNERS

ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)

FASTER = 3
"""Factor on the rates of Table C.1, as in `compare priors`."""

DEVELOPMENT, FRESH = "development", "fresh"
KEYS = ("world", "method", "setting", "target_angle", "readout")

READOUT = "greedy"
"""Action selection by which settings are chosen and methods compared."""

Chosen = Mapping[tuple[str, str], str]
"""Name of the setting by world and method."""


@dataclass(frozen=True)
class Config:
    """One budget and the same seeds for every method of a world."""

    worlds: tuple[str, ...] = GRIDWORLDS
    """Worlds of the comparison; the intersection takes long and is left out if not named."""
    methods: tuple[str, ...] = tuple(BY_NAME)
    """Names of `METHODS`."""
    angles: tuple[float, ...] = ANGLES
    """Target angles in degrees."""
    development_angles: tuple[float, ...] = (15.0, 45.0, 75.0)
    """Angles at which settings are chosen; 0 and 90 are those of demonstrators."""
    development_seeds: tuple[int, ...] = (100,)
    """Training seeds on which settings are chosen, each with its own data set."""
    seeds: tuple[int, ...] = (300, 301, 302, 303, 304)
    """Training seeds of the table, each with its own data set."""
    updates: int = 2_000
    """Gradient steps for each target angle in a gridworld, and as many steps in the world; a
    network that serves several angles has theirs together."""
    learning_rate: float = FASTER * presets.TABLE_C1_NUMBERS.learning_rate
    """Of methods whose grid has none."""
    polyak: float = FASTER * presets.TABLE_C1_NUMBERS.polyak
    """Of methods whose grid has none."""
    episodes: int = 1000
    """Evaluation episodes of each policy in the intersection."""
    intersection_updates: int = 1_000
    """Gradient steps for each target angle in the intersection, and twice as many steps in the
    world. A GPU affords 5,000, with the next two."""
    intersection_hidden: tuple[int, ...] = (64, 64)
    """Hidden layers in the intersection, over a view of the vehicles as a set. The world's own
    learners have (256, 256)."""
    intersection_batch: int = 64
    """Batch in the intersection. The world's own learners have 256."""
    intersection_settings: int = 2
    """Settings that are tried of each method's grid in the intersection, the middle ones; at most
    `SETTINGS_EACH`, which the gridworlds try."""

    def __post_init__(self) -> None:
        """Refuse unknown worlds and methods, empty options, seeds used twice, and bad sizes."""
        check_choices(self, tuple(BY_NAME), self.development_seeds, self.seeds)
        check_counts(self, ("updates", "episodes", "intersection_updates", "intersection_batch"))
        check_widths(self.intersection_hidden)
        if not 1 <= self.intersection_settings <= SETTINGS_EACH:
            raise UserError(
                f"intersection_settings must be from 1 to {SETTINGS_EACH}, "
                f"got {self.intersection_settings}"
            )

    def settings_of(self, world: str, method: Method) -> tuple[Setting, ...]:
        """Return the settings of a method that are tried in a world."""
        count = SETTINGS_EACH if world in GRIDWORLDS else self.intersection_settings
        first = (len(method.settings) - count) // 2
        return method.settings[first : first + count]

    @property
    def peers(self) -> tuple[str, ...]:
        """Environments of other libraries that the methods need in these worlds."""
        learners = [method.learner for _, method in self.rows]
        return tuple(dict.fromkeys(PEERS[name] for name in learners if name in PEERS))

    @property
    def rows(self) -> list[tuple[str, Method]]:
        """Worlds and the methods that run there."""
        return [
            (world, BY_NAME[name])
            for world, name in itertools.product(self.worlds, self.methods)
            if (BY_NAME[name].gridworlds if world in GRIDWORLDS else BY_NAME[name].intersection)
        ]


def updates_of(method: Method, updates: int) -> int:
    """Return the gradient steps of one network, if an angle has `updates` of them.

    Seven angles have as many for every method that trains a network for each, one for each of
    the three modes, or one for all.
    """
    shares = {"angle": len(ANGLES), "mode": len(MODES), "all": 1}
    return updates * len(ANGLES) // shares[method.serves]


# ----------------------------------------------------------------------------------------------
# Jobs
# ----------------------------------------------------------------------------------------------


def development_jobs(config: Config) -> list[Job]:
    """Return the jobs of every method at each of its settings, and the peers' environments."""
    return _phase_jobs(config, DEVELOPMENT, None)


def chosen_jobs(config: Config, work: Path) -> list[Job]:
    """Return every method's jobs at the setting that the development jobs' folders choose."""
    return fresh_jobs(config, choose(list(_all_rows(config, work, DEVELOPMENT))))


def fresh_jobs(config: Config, chosen: Chosen) -> list[Job]:
    """Return every method's jobs at its setting, after those that they read."""
    return _phase_jobs(config, FRESH, chosen)


def _phase_jobs(config: Config, phase: str, chosen: Chosen | None) -> list[Job]:
    jobs = [peers.environment_job(library) for library in config.peers]
    if intersection.WORLD in config.worlds:
        jobs.append(intersection.demonstrations())
        jobs += [intersection.demonstrators(config)] if phase == FRESH else []
    for world, method in config.rows:
        settings = _settings(config, world, method, chosen)
        jobs += _jobs(config, phase, world, method, settings)
    return jobs


def _settings(
    config: Config, world: str, method: Method, chosen: Chosen | None
) -> tuple[Setting, ...]:
    """Return the chosen setting alone, or before a choice every setting that is tried."""
    if chosen is None:
        return config.settings_of(world, method)
    return (method.setting_of(chosen[world, method.name]),)


def _jobs(
    config: Config, phase: str, world: str, method: Method, settings: tuple[Setting, ...]
) -> Iterator[Job]:
    seeds = config.seeds if phase == FRESH else config.development_seeds
    angles = config.angles if phase == FRESH else config.development_angles
    if world not in GRIDWORLDS:
        first = FIRST_EPISODE if phase == FRESH else intersection.FIRST_DEVELOPMENT
        updates = updates_of(method, config.intersection_updates)
        yield from intersection.jobs_of(
            config, phase, method, updates, angles, settings, seeds, first
        )
        return
    rates = {"learning_rate": config.learning_rate, "polyak": config.polyak}
    runs = GridRuns(
        world,
        method.name,
        presets.TABLE_C1,
        dataclasses.replace(presets.TABLE_C1_NUMBERS, **rates),
        updates_of(method, config.updates),
        angles,
        settings,
        seeds,
        EPISODES_EACH[world],
    )
    library = PEERS.get(method.learner)
    inputs = (peers.environment_name(library),) if library else ()
    count = len(seeds) * len(settings) * len(method.served(angles))
    cost = count * (8.0 if library else 1.0) + 10.0
    yield Job(_name(phase, world, method), run_method, runs, inputs, cost)


def _name(phase: str, world: str, method: Method) -> str:
    return f"methods/{world}/{phase}/{method.name}"


def run_method(
    config: GridRuns, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Train every run and write a row for each policy, angle and action selection."""
    ground, method = Ground.of(config.world), BY_NAME[config.method]
    arena = config.arena(ground, on_progress)
    served = method.served(config.angles)
    runs = runs_of(config.settings, served, config.seeds)
    if method.learner in PEERS:
        (environment,) = inputs.values()
        policies = peers.train_tabular(arena, ground, method, runs, served, environment, folder)
    else:
        policies = LEARNERS[method.learner](arena, method, runs)
    rows: list[Row] = []
    for run, policy in zip(runs, policies, strict=True):
        label = {"world": config.world, "method": method.name}
        label |= {"setting": setting_name(run.setting)}
        rows += rows_of(ground, method, label, run.seed, policy, served[run.angle])
    write_atomically(folder / ROWS, as_csv(rounded(rows)))
    speed = arena.speed_row(config.world, method, len(runs))
    write_atomically(folder / SPEED, as_csv([speed]))
    on_progress(1.0)


# ----------------------------------------------------------------------------------------------
# Tables
# ----------------------------------------------------------------------------------------------


def _all_rows(
    config: Config, work: Path, phase: str, chosen: Chosen | None = None
) -> Iterator[Row]:
    """Yield the rows of a phase; `chosen` names the settings of the fresh ones."""
    seeds = config.seeds if phase == FRESH else config.development_seeds
    for world, method in config.rows:
        if world in GRIDWORLDS:
            yield from from_csv(work / _name(phase, world, method) / ROWS)
        else:
            settings = _settings(config, world, method, chosen)
            yield from intersection.rows_of(work, phase, method, settings, seeds)


def _speeds(config: Config, work: Path) -> Iterator[Row]:
    """Yield updates per second of each method."""
    for world, method in config.rows:
        grid_folder = _name(FRESH, world, method)
        folder = grid_folder if world in GRIDWORLDS else intersection.trained(FRESH, method)
        yield from from_csv(work / folder / SPEED)


def choose(rows: Sequence[Row]) -> dict[tuple[str, str], str]:
    """Return, for each world and method, the setting with the greatest mean J(α), greedy."""
    return comparison.choose(matching(rows, readout=READOUT), "setting")


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute rows, their means over seeds, and the rows from which settings were chosen."""
    developed = list(_all_rows(config, context.work, DEVELOPMENT))
    fresh = list(_all_rows(config, context.work, FRESH, choose(developed)))
    pooled = comparison.means(fresh, KEYS)
    by_method = overall(pooled, list(_speeds(config, context.work)))
    gridworlds = [world for world in config.worlds if world in GRIDWORLDS]
    references = [comparison.references(world, config.angles) for world in gridworlds]
    on_road = intersection.WORLD in config.worlds
    tables = {
        "policies": fresh,
        "pooled": pooled,
        "overall": by_method,
        "paired": paired(fresh),
        "references": [row for rows in references for row in rows],
        "demonstrators": from_csv(context.work / intersection.DEMONSTRATORS / ROWS)
        if on_road
        else [],
        "development": comparison.means(developed, KEYS),
    }
    return Findings(tables, summarise(by_method))


def overall(pooled: Sequence[Row], speeds: Sequence[Row]) -> list[Row]:
    """Return a row for each method: regret over all angles, steering, endings, what it is told.

    `steering` is α̂ at the largest target angle less α̂ at the smallest, in degrees; `r_social_gain`
    is that difference of r_social. Collisions and arrivals are means over the angles.

    Args:
        pooled: Rows of `means`.
        speeds: Updates per second of each world and method, and the device.
    """
    keys = ("world", "method", "setting", "readout")
    measured = {(row["world"], row["method"]): row for row in speeds}
    rows = []
    by_method = comparison.overall(pooled, keys)
    for row, group in zip(by_method, groups(pooled, *keys).values(), strict=True):
        ends = sorted(group, key=lambda row: row["target_angle"])
        steering = ends[-1]["angle"] - ends[0]["angle"]
        told = BY_NAME[row["method"]].told
        speed = measured.get((row["world"], row["method"]), {})
        rows.append(
            row
            | {"steering": steering}
            | {"r_social_gain": ends[-1]["r_social"] - ends[0]["r_social"]}
            | {"collision": mean(group, "collision"), "arrival": mean(group, "arrival")}
            | {name: int(name in told) for name in TOLD}
            | {name: speed.get(name, "") for name in ("updates_per_second", "device")}
        )
    return rows


def paired(policies: Sequence[Row]) -> list[Row]:
    """Return paired tests of each method's mean J(α) over angles against the best method's.

    Pairs are training seeds, which share their data sets; Holm's adjustment is over all rows of a
    world. The best method is that of the greatest mean.
    """
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


def summarise(by_method: Sequence[Row]) -> dict[str, Any]:
    """Return mean and worst regret, J(α), steering and setting by world and method."""
    names = ("setting", "value", "regret", "worst_regret", "steering", "collision", "arrival")
    summary: dict[str, Any] = {}
    for row in matching(by_method, readout=READOUT):
        summary.setdefault(row["world"], {})[row["method"]] = {name: row[name] for name in names}
    return summary


def told(row: Row) -> str:
    """Return what a method is told, in one cell."""
    return ", ".join(name for name in TOLD if row[name]) or "nothing"


def in_order(rows: Sequence[Row]) -> list[Row]:
    """Return rows of one world by their regret, or by falling J(α) where it is unknown."""
    has_regret = "" not in column(rows, "regret")
    return sorted(rows, key=lambda row: row["regret"] if has_regret else -row["value"])


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw a figure of greedy policies for each world."""
    labels = {name: method.label for name, method in BY_NAME.items()}
    worlds = dict.fromkeys(column(results.tables["pooled"], "world"))
    return {world: angle_figure(results, world, labels, (READOUT,)) for world in worlds}


def view(results: Results) -> Sequence[View]:
    """Return a table of methods by target angle for each world, the best first."""
    return [
        View(table(results, world), f"{world}, greedy: {quantity(results, world)} by target angle")
        for world in dict.fromkeys(column(results.tables["overall"], "world"))
    ]


def table(results: Results, world: str) -> list[Row]:
    """Return a row for each method, by its mean over the angles."""
    measured = quantity(results, world)
    by_row = matching(results.tables["overall"], world=world, readout=READOUT)
    pooled = matching(results.tables["pooled"], world=world, readout=READOUT)
    by_method = groups(pooled, "method")
    return [
        {"method": BY_NAME[row["method"]].label, "mean": row[measured]}
        | {
            f"{of_angle['target_angle']:g}°": of_angle[measured]
            for of_angle in by_method[(row["method"],)]
        }
        | {"steering": row["steering"], "collision": row["collision"], "arrival": row["arrival"]}
        | {"told": told(row), "updates/s": row["updates_per_second"], "on": row["device"]}
        for row in in_order(by_row)
    ]


STUDY = Study(
    name="compare-methods",
    Config=Config,
    jobs=development_jobs,
    more_jobs=chosen_jobs,
    tables=compute_tables,
    figures=draw_figures,
    view=view,
)
