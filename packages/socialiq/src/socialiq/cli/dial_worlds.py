"""Worlds in which `train-dial` trains: a gridworld within JAX, or the core of a road."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

from socialiq.cli.drivers import road_named
from socialiq.cli.run_folder import CHUNK
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.learners.dial.config import (
    INTERSECTION,
    PRESETS,
    Hyperparameters,
    Preset,
    StaticConfig,
)
from socialiq.types import Simulator
from socialiq.worlds import IDS, SCENE_IDS
from socialiq.worlds.highway.scenes import SCENES
from socialiq.worlds.registry import make_grid
from socialiq_lab.gridworld_runs import seen
from socialiq_lab.intersection import fitting
from socialiq_lab.intersection.training import STEPS_PER_UPDATE, dial_collector

ROADS = ("intersection", *SCENES)
"""Worlds on highway-env's roads, with discrete actions."""
_OWN_PRESET = "intersection"


class Setting(NamedTuple):
    """Parts of a world that a training needs.

    Attributes:
        static: Structure for this world.
        data: Sets of demonstrations, with the time if the network sees it.
        sizes: Features of an observation and number of actions.
        simulator: World within JAX; None offline or on a road.
        collector: Collects experience outside JAX; None elsewhere.
        chunk: Updates between two rounds of reports and collection.
    """

    static: StaticConfig
    data: list[Demonstrations]
    sizes: tuple[int, int]
    simulator: Simulator | None
    collector: Any
    chunk: int


def preset_of(name: str | None, world: str) -> tuple[str, Preset]:
    """Return the name and the preset; by default that of the world.

    Raises:
        UserError: If it is unknown, or of another world.
    """
    known = {**PRESETS, _OWN_PRESET: INTERSECTION}
    on_road = world in ROADS
    name = name or (_OWN_PRESET if on_road else "online")
    one_of("preset", name, tuple(known))
    if (name == _OWN_PRESET) != on_road:
        fitting_ = [one for one in known if (one == _OWN_PRESET) == on_road]
        raise UserError(f"preset '{name}' is not for {world}: choose {', '.join(fitting_)}")
    return name, known[name]


def collect_command(world: str) -> str:
    """Return the command that makes the demonstrations for a world."""
    if world in ROADS:
        return f"socialiq collect {(IDS | SCENE_IDS)[world]} --driver FILE --out FILE"
    return "socialiq collect WORLD --clock --out FILE"


def in_gridworld(
    world: str, preset: Preset, structure: StaticConfig, data: Sequence[Demonstrations]
) -> Setting:
    """Return the setting of a gridworld."""
    plain = make_grid(world)
    grid = plain.with_clock() if preset.clock else plain
    times = grid.horizon if structure.redraw_times else 0
    static = dataclasses.replace(structure, one_hot=seen(grid), redraw_times=times)
    sizes = (grid.n_features, grid.n_actions)
    return Setting(static, list(data), sizes, grid if static.online else None, None, CHUNK)


def on_road(
    name: str,
    structure: StaticConfig,
    numbers: Sequence[Hyperparameters],
    data: Sequence[Demonstrations],
) -> Setting:
    """Return the setting of the intersection or another road, with its default options.

    Data of `collect` lack the time, which is the number of the step.
    """
    world = road_named(name)
    clock = structure.redraw_times > 0
    if clock:
        structure = dataclasses.replace(
            structure,
            redraw_times=world.options.decisions,
            timeout_reward=world.options.timeout_weight,
        )
    plain = world.n_features
    sizes = (plain + clock, world.n_actions)
    timed = [one.with_clock() if clock and one.n_features == plain else one for one in data]
    collector = None
    if structure.online:
        collector = dial_collector(
            structure, numbers, world, structure.environments, STEPS_PER_UPDATE
        )
    return Setting(structure, timed, sizes, None, collector, fitting.CHUNK)
