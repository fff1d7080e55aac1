"""The intersection under rule-based drivers, and the rewards of each variant (thesis 5.1.3)."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.errors import one_of
from socialiq.evaluation.episodes import episodes_of, outcome_row, reward_row
from socialiq.evaluation.measures import Episodes
from socialiq.results_folder import Results
from socialiq.types import Row
from socialiq.worlds.highway import render, sheet
from socialiq.worlds.highway.scene_batch import BackEnd
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Intersection
from socialiq_lab.registry import declaration
from socialiq_lab.study import Context, Findings, tracked
from socialiq_lab.tables import nested, options_name

BATCH: dict[BackEnd, int] = {"core": 1024, "highway_env": 4}
_DRIVEN = declaration("intersection-world")["driven"]
DRIVERS = _DRIVEN["drivers"]
REWARD_DRIVERS = _DRIVEN["reward_drivers"]
EPISODE_SEED = 3  # seed of the drawn episode


def compute_tables(config: Any, context: Context) -> Findings:
    """Drive all drivers, and compute outcomes and rewards.

    Args:
        config: Configuration of the study.
        context: Progress callback; the study has no jobs.

    Returns:
        Tables `outcomes` and `readings`, and the summary.

    Raises:
        UserError: If the back end is unknown.
    """
    one_of("back_end", config.back_end, tuple(BATCH))
    first = config.seeds[0]
    how = config.threads, config.back_end

    def driven(stage: str, cells: Any, episodes: int) -> Iterator[tuple[str, str, Episodes]]:
        """Drive each cell of a table, which is a name, its options and a driver."""
        seeds = range(first, first + episodes)
        for name, options, driver in tracked(list(cells), context.on_stage, stage, "drivers"):
            yield name, driver, drive(options, driver, seeds, *how)

    names = _DRIVEN["populations"]
    changes = _DRIVEN["readings"]
    populations = ((name, {"population": name}, d) for name in names for d in DRIVERS)
    variants = ((options_name(change), change, d) for change in changes for d in REWARD_DRIVERS)
    fewer = min(config.reading_episodes, config.episodes)
    outcomes = [
        {"population": name, "driver": driver} | outcome_row(episodes)
        for name, driver, episodes in driven("outcomes", populations, config.episodes)
    ]
    readings = [
        {"reading": name, "driver": driver} | reward_row(episodes)
        for name, driver, episodes in driven("readings", variants, fewer)
    ]
    world = Intersection(Options())
    summary = {
        "outcomes": nested(outcomes, "population", "driver"),
        "default_reading": nested(readings, "reading", "driver")["default"],
        "options": dataclasses.asdict(Options()),
        "features": world.n_features,
        "actions": world.n_actions,
        "start": start_row(first, config.reading_episodes, config.threads),
    }
    return Findings({"outcomes": outcomes, "readings": readings}, summary)


def drive(
    options: Mapping[str, Any],
    driver: str,
    seeds: Sequence[int],
    threads: int = 1,
    back_end: BackEnd = "core",
) -> Episodes:
    """Run one episode of a reference driver for each seed, shared by threads.

    Args:
        options: Changed options of the intersection by name.
        driver: Name of the reference driver.
        seeds: Seed of each episode; the first one also seeds the driver.
        threads: Number of threads.
        back_end: Simulator of the episodes.
    """
    size = min(BATCH[back_end], len(seeds))
    batch = Intersection(Options(**options)).batch(size, threads, back_end=back_end)
    return episodes_of(batch, policy(driver, seeds[0]), seeds)


def start_row(first: int, count: int, threads: int = 1) -> Row:
    """Return the number of vehicles at the start, the ego included, and the ego's progress.

    Args:
        first: Seed of the first episode.
        count: Number of episodes.
        threads: Number of threads.

    Returns:
        Mean, least and largest number of vehicles, the share of episodes with five, and the ego's
        metres.
    """
    batch = Intersection(Options()).batch(count, threads)
    batch.reset(np.arange(first, first + count))
    present = batch.buffers.episodes["vehicles"]
    began = batch.buffers.episodes["start"][:, 0]
    return {
        "episodes": count,
        "vehicles_mean": float(present.mean()),
        "vehicles_least": int(present.min()),
        "vehicles_most": int(present.max()),
        "share_with_five": float((present == 5).mean()),
        "ego_metres_least": float(began.min()),
        "ego_metres_mean": float(began.mean()),
    }


def pictures(_results: Results) -> dict[str, Figure]:
    """Draw the intersection (thesis Fig 5.3) and an episode."""
    world = Intersection(Options())
    scenes = render.episode_scenes(world.batch(1, traced=True), policy("gap_3s"), EPISODE_SEED)
    decisions = scenes[:: world.options.frames]
    return {
        "fig_5_3": sheet.picture(scenes[4 * world.options.frames], world.view),
        "gap_3s_episode": render.filmstrip(decisions[:10], world.view),
    }
