"""Scenes by name; a further one is a further file."""

from __future__ import annotations

from collections.abc import Callable

from socialiq.errors import one_of
from socialiq.worlds.highway.scene import Scene
from socialiq.worlds.highway.scenes import merge, roundabout

SCENES: dict[str, Callable[[], Scene]] = {"merge": merge.scene, "roundabout": roundabout.scene}


def scene_of(name: str) -> Scene:
    """Return a scene by name.

    Raises:
        UserError: If the name is unknown.
    """
    one_of("scene", name, tuple(SCENES))
    return SCENES[name]()
