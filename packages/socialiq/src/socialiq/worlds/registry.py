"""Worlds by name, with options from keyword arguments; `worlds.grammar` parses the names."""

from typing import Any

from socialiq.errors import UserError, one_of
from socialiq.worlds import catalogue, grammar
from socialiq.worlds.catalogue import GRIDS, INTERSECTION
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.world import World


def open_world(name: str | World, **options: Any) -> World:
    """Return any world, as `grammar.build`: a gridworld, a road, or one from a file.

    Args:
        name: The world: `NAME or FILE [, key=value ...]`; or a world that this function made.
        options: Options by key, laid over those of the name.

    Raises:
        UserError: If the world, an option or a value is unknown, or a file holds no world, is
            damaged, or lacks its distribution.
    """
    return grammar.build(grammar.text_of(name), options)


def make(name: str, **options: Any) -> GridWorld | RoadWorld:
    """Build a gridworld or a road, as `open_world`.

    Raises:
        UserError: If the world, an option or an option's value is unknown.
    """
    written = grammar.parse(name, options)
    one_of("world", written.name, catalogue.NAMES)
    world = grammar.build_written(written)
    assert isinstance(world, GridWorld | RoadWorld)
    return world


def make_grid(name: str, **options: Any) -> GridWorld:
    """Build a gridworld, a world whose states can be enumerated; refuse others as `make` does."""
    written = grammar.parse(name, options)
    if written.name in catalogue.NAMES and written.name not in GRIDS:
        raise UserError(
            f"the states of {written.name} can't be listed, so nothing about it is exact: "
            f"choose one of {', '.join(GRIDS)}"
        )
    one_of("world", written.name, tuple(GRIDS))
    world = grammar.build_written(written)
    assert isinstance(world, GridWorld)
    return world


def make_fleet(name: str = INTERSECTION, agents: int = 2, **options: Any) -> RoadWorld:
    """Build a road on which several vehicles of an episode are controlled.

    Args:
        name: Name of a road.
        agents: Number of controlled vehicles.
        **options: Options of the road, and fields of `highway.options.AgentOptions`; those of
            `intersection.options.MULTI_AGENT` make highway-env's multi-agent environments.

    Raises:
        UserError: If the road, an option or a value is unknown, or there are too many agents.
    """
    written = grammar.parse(name, options)
    one_of("road", written.name, catalogue.ROADS)
    written = written._replace(options={"agents": agents} | written.options)
    world = grammar.build_written(written)
    assert isinstance(world, RoadWorld)
    return world
