"""The intersection under rule-based drivers, and the rewards of each variant (thesis 5.1.3)."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.errors import one_of
from socialiq.evaluation.episodes import episodes_of, outcome_row, reward_row
from socialiq.evaluation.measures import Episodes
from socialiq.foreign import optional
from socialiq.results_folder import Results
from socialiq.types import Row
from socialiq.worlds.highway import render, sheet
from socialiq.worlds.highway.scene_batch import BackEnd
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Intersection
from socialiq_lab.jobs import Job, Part, StageCallback, keeps_rows
from socialiq_lab.registry import declaration
from socialiq_lab.study import Context, Findings, tracked
from socialiq_lab.tables import nested, options_name

BATCH: dict[BackEnd, int] = {"core": 1024, "highway_env": 4}
_DRIVEN = declaration("intersection-world")["driven"]
DRIVERS = _DRIVEN["drivers"]
REWARD_DRIVERS = _DRIVEN["reward_drivers"]
EPISODE_SEED = 3  # seed of the drawn episode


def jobs(config: Any) -> list[Job]:
    """Return a job for each population, and one for each interpretation of the reward.

    Raises:
        UserError: If the back end is unknown or not installed.
    """
    one_of("back_end", config.back_end, tuple(BATCH))
    if config.back_end == "highway_env":
        optional("highway_env", "highway", "this back end")
    fewer = min(config.reading_episodes, config.episodes)
    return [
        Job(f"outcomes/{name}", outcomes, Part(config, name), cost=float(config.episodes))
        for name in _DRIVEN["populations"]
    ] + [
        Job(f"readings/{options_name(change)}", readings, Part(config, change), cost=float(fewer))
        for change in _DRIVEN["readings"]
    ]


@keeps_rows
def outcomes(part: Part, _folder: Path, on_stage: StageCallback) -> dict[str, list[Row]]:
    """Drive every driver in a population."""
    config = part.study
    seeds = range(config.seeds[0], config.seeds[0] + config.episodes)
    how = seeds, config.threads, config.back_end
    rows = [
        {"population": part.of, "driver": driver}
        | outcome_row(drive({"population": part.of}, driver, *how))
        for driver in tracked(DRIVERS, on_stage, part.of, "drivers")
    ]
    return {"outcomes": rows}


@keeps_rows
def readings(part: Part, _folder: Path, on_stage: StageCallback) -> dict[str, list[Row]]:
    """Compute the rewards of every driver by an interpretation, which is changed options."""
    config = part.study
    name = options_name(part.of)
    count = min(config.reading_episodes, config.episodes)
    how = range(config.seeds[0], config.seeds[0] + count), config.threads, config.back_end
    rows = [
        {"reading": name, "driver": driver} | reward_row(drive(part.of, driver, *how))
        for driver in tracked(REWARD_DRIVERS, on_stage, name, "drivers")
    ]
    return {"readings": rows}


def compute_tables(config: Any, context: Context) -> Findings:
    """Return what the jobs have kept, and the summary.

    Args:
        config: Configuration of the study.
        context: The finished jobs.

    Returns:
        Tables `outcomes` and `readings`, and the summary.
    """
    tables = context.tables()
    first = config.seeds[0]
    world = Intersection(Options())
    summary = {
        "outcomes": nested(tables["outcomes"], "population", "driver"),
        "default_reading": nested(tables["readings"], "reading", "driver")["default"],
        "options": dataclasses.asdict(Options()),
        "features": world.n_features,
        "actions": world.n_actions,
        "start": start_row(first, config.reading_episodes, config.threads),
    }
    return Findings(tables, summary)


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
