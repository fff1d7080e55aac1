"""Worlds in files, of this and of other distributions.

Another distribution adds its worlds by an entry point of the group `socialiq.worlds`: its name is a
kind of file (`storage.kind_of`), its object a function from such a file's path to a `World`.
"""

from collections.abc import Iterable
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.storage import kind_of
from socialiq.worlds import SUMO_NET, WORLD_FILE
from socialiq.worlds.world import World

GROUP = "socialiq.worlds"
_OF_RECORDINGS = "socialiq_recordings.world.gym:load_world"
_ENDINGS = (".safetensors", ".xml", ".csv")


def installed(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name, those of a backport of importlib too."""
    entries = entry_points(group=group)
    return {entry.name: EntryPoint(entry.name, entry.value, group) for entry in entries}


@cache
def _loaders() -> dict[str, EntryPoint]:
    """Return what reads a world from a file, by the kind of the file."""
    return {WORLD_FILE: EntryPoint(WORLD_FILE, _OF_RECORDINGS, GROUP)} | installed(GROUP)


def is_world_file(name: str) -> bool:
    """Whether a name is that of a file that holds a world, as `socialiq data world` makes it."""
    return kind_of(Path(name)) in _loaders()


def names_file(name: str) -> bool:
    """Whether a name ends like a file that may hold a world, or is that of one that does."""
    is_ending = name.lower().endswith(_ENDINGS) and not name.endswith(SUMO_NET)
    return is_ending or is_world_file(name)


def loaded(entry: EntryPoint, file: str) -> Any:
    """Return the object of an entry point, which reads a file.

    Args:
        entry: The entry point.
        file: Name of the file, for the message.

    Raises:
        UserError: If the distribution with the reader is not installed.
    """
    try:
        return entry.load()
    except ModuleNotFoundError as error:
        missing = entry.module.partition(".")[0].replace("_", "-")
        raise UserError(f"{file} needs {missing}: pip install {missing}") from error


_NO_WORLD = (
    "a recording can't be driven in: its neighbours do not react, so their losses of speed "
    "are fixed whatever the policy does, and the angle would be biased; name a world that "
    "reacts (intersection, or one that `socialiq data world` makes of it)"
)


def refuse_file(name: str) -> None:
    """Refuse a name of a file that holds no world."""
    if names_file(name) and not is_world_file(name):
        raise UserError(_NO_WORLD)


def refuse_options(keys: Iterable[str]) -> None:
    """Refuse options of the world of a file: it has none that a text could change."""
    for key in keys:
        raise UserError(
            f"the world of a file takes no options, got {one_line(key, 80)}: `socialiq data world` "
            "makes another world"
        )


def load_world(name: str) -> World:
    """Return the world of a file.

    Raises:
        UserError: If the file holds no world, is damaged, or lacks its distribution.
    """
    refuse_file(name)
    return loaded(_loaders()[kind_of(Path(name))], one_line(name))(name)
