"""Scenes by name: every file of this folder is one, with a function `scene`."""

from __future__ import annotations

import importlib
import pkgutil

from socialiq.errors import one_of
from socialiq.worlds.highway.scene import Scene

SCENES = tuple(sorted(module.name for module in pkgutil.iter_modules(__path__)))


def scene_of(name: str) -> Scene:
    """Return a scene by name.

    Raises:
        UserError: If the name is unknown.
    """
    one_of("scene", name, SCENES)
    return importlib.import_module(f"{__name__}.{name}").scene()
