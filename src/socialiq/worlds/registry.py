"""Registry of worlds by name."""

from __future__ import annotations

from typing import Any

from socialiq.errors import UserError, one_of
from socialiq.worlds import crossing5, crossing7, intersection
from socialiq.worlds.choices import chosen
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.intersection.world import Intersection

WORLDS = {"crossing5": crossing5, "crossing7": crossing7, "intersection": intersection}
GRIDWORLDS = ("crossing5", "crossing7")


def make(name: str, **options: Any) -> GridWorld | Intersection:
    """Build a world by name, with its options as keyword arguments.

    Args:
        name: One of `WORLDS`.
        options: Fields of that world's `Options`.

    Raises:
        UserError: If the world, an option or an option's value is unknown.
    """
    one_of("world", name, tuple(WORLDS))
    module = WORLDS[name]
    return module.make(chosen(name, module.Options, options))


def make_grid(name: str, **options: Any) -> GridWorld:
    """Build a gridworld: a world whose states can be enumerated.

    Raises:
        UserError: As `make`, and if the world is not a gridworld.
    """
    if name in WORLDS and name not in GRIDWORLDS:
        raise UserError(
            f"the states of {name} can't be listed, so nothing about it is exact: "
            f"choose one of {', '.join(GRIDWORLDS)}"
        )
    one_of("world", name, GRIDWORLDS)
    world = make(name, **options)
    assert isinstance(world, GridWorld)
    return world
