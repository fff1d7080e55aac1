"""`compare methods`: choose each method's settings on development seeds, then train on others.

Every method of a world has the same updates, environment steps, data sets and number of settings to
choose from, and a network of the same hidden layers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from socialiq.types import Row
from socialiq_lab.comparison import EPISODES_EACH, GRIDWORLDS, references
from socialiq_lab.comparison_figures import angle_figure, quantity
from socialiq_lab.intersection.episodes import FIRST_EPISODE
from socialiq_lab.jobs import Job
from socialiq_lab.results import Results, from_csv
from socialiq_lab.study import Context, Findings, Study, View
from socialiq_lab.tables import column, groups, matching
from studies.compare_methods import intersection, peers
from studies.compare_methods.config import Config, trained_angles
from studies.compare_methods.gridworlds import (
    ROWS,
    SPEED,
    GridRuns,
    run_method,
    setting_of,
)
from studies.compare_methods.methods import BY_NAME, PEERS, Method, Setting
from studies.compare_methods.tables import (
    READOUT,
    Chosen,
    choose,
    in_order,
    means,
    overall,
    paired,
    summarise,
    told,
)

DEVELOPMENT, FRESH = "development", "fresh"


def development_jobs(config: Config) -> list[Job]:
    """Return the jobs of every method at each of its settings, and the peers' environments."""
    jobs = [peers.environment_job(library) for library in config.peers]
    for world in config.worlds:
        if world not in GRIDWORLDS:
            jobs.append(intersection.demonstrations())
        for method in config.methods_of(world):
            jobs += _jobs(config, DEVELOPMENT, world, method, config.settings_of(world, method))
    return jobs


def chosen_jobs(config: Config, work: Path) -> list[Job]:
    """Return every method's jobs at the setting that the development jobs' folders choose."""
    return fresh_jobs(config, choose(list(_all_rows(config, work, DEVELOPMENT))))


def fresh_jobs(config: Config, chosen: Chosen) -> list[Job]:
    """Return every method's jobs at its setting, after those that they read."""
    jobs = [peers.environment_job(library) for library in config.peers]
    for world in config.worlds:
        if world not in GRIDWORLDS:
            jobs += [intersection.demonstrations(), intersection.demonstrators(config)]
        for method in config.methods_of(world):
            setting = setting_of(method, chosen[world, method.name])
            jobs += _jobs(config, FRESH, world, method, (setting,))
    return jobs


def _jobs(
    config: Config, phase: str, world: str, method: Method, settings: tuple[Setting, ...]
) -> Iterator[Job]:
    seeds = config.seeds if phase == FRESH else config.development_seeds
    angles = config.angles if phase == FRESH else config.development_angles
    if world not in GRIDWORLDS:
        first = FIRST_EPISODE if phase == FRESH else intersection.FIRST_DEVELOPMENT
        yield from intersection.jobs_of(config, phase, method, angles, settings, seeds, first)
        return
    runs = GridRuns(
        world,
        method.name,
        config.structure,
        config.numbers,
        config.updates,
        angles,
        settings,
        seeds,
        EPISODES_EACH[world],
    )
    library = PEERS.get(method.learner)
    inputs = (peers.environment_name(library),) if library else ()
    count = len(seeds) * len(settings) * len(trained_angles(method, angles))
    cost = count * (8.0 if library else 1.0) + 10.0
    yield Job(_name(phase, world, method), run_method, runs, inputs, cost)


def _name(phase: str, world: str, method: Method) -> str:
    return f"methods/{world}/{phase}/{method.name}"


def _all_rows(
    config: Config, work: Path, phase: str, chosen: Chosen | None = None
) -> Iterator[Row]:
    """Yield the rows of a phase; `chosen` names the settings of the fresh ones."""
    for world in config.worlds:
        for method in config.methods_of(world):
            if world in GRIDWORLDS:
                yield from from_csv(work / _name(phase, world, method) / ROWS)
                continue
            seeds = config.seeds if phase == FRESH else config.development_seeds
            settings = config.settings_of(world, method)
            if chosen is not None:
                settings = (setting_of(method, chosen[world, method.name]),)
            yield from intersection.rows_of(work, phase, method, settings, seeds)


def _speeds(config: Config, work: Path) -> Iterator[Row]:
    """Yield updates per second of each method."""
    for world in config.worlds:
        for method in config.methods_of(world):
            if world in GRIDWORLDS:
                yield from from_csv(work / _name(FRESH, world, method) / SPEED)
                continue
            yield intersection.speeds_of(work, FRESH, method)


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute rows, their means over seeds, and the rows from which settings were chosen."""
    developed = list(_all_rows(config, context.work, DEVELOPMENT))
    chosen = choose(developed)
    fresh = list(_all_rows(config, context.work, FRESH, chosen))
    pooled = means(fresh)
    whole = overall(pooled, list(_speeds(config, context.work)))
    tables = {
        "policies": fresh,
        "pooled": pooled,
        "overall": whole,
        "paired": paired(fresh),
        "references": [
            row
            for world in config.worlds
            if world in GRIDWORLDS
            for row in references(world, config.angles)
        ],
        "demonstrators": [
            row
            for world in config.worlds
            if world not in GRIDWORLDS
            for row in from_csv(context.work / intersection.DEMONSTRATORS / ROWS)
        ],
        "development": means(developed),
    }
    return Findings(tables, summarise(whole))


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
    whole = matching(results.tables["overall"], world=world, readout=READOUT)
    pooled = matching(results.tables["pooled"], world=world, readout=READOUT)
    by_method = groups(pooled, "method")
    return [
        {"method": BY_NAME[row["method"]].label, "mean": row[measured]}
        | {f"{one['target_angle']:g}°": one[measured] for one in by_method[(row["method"],)]}
        | {"steering": row["steering"], "collision": row["collision"], "arrival": row["arrival"]}
        | {"told": told(row), "updates/s": row["updates_per_second"], "on": row["device"]}
        for row in in_order(whole)
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
