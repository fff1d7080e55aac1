"""A road network for tracks that came without one, from a CommonRoad file in the same frame."""

from __future__ import annotations

from pathlib import Path

from socialiq.errors import UserError
from socialiq.plain_text import one_line
from socialiq.recordings import files
from socialiq.recordings.commonroad_road import RoadDraft
from socialiq.recordings.commonroad_xml import Element, State, read
from socialiq.recordings.road import RoadNetwork
from socialiq.storage import kind_of


class _RoadAlone:
    """Gathers the lanelets of one file and lets everything else pass."""

    def __init__(self, path: Path) -> None:
        self._path, self.draft = path, RoadDraft(path)

    def root(self, name: str, attributes: dict[str, str]) -> None:  # noqa: ARG002
        if name != "commonRoad":
            raise UserError(
                f"{self._path} is not a CommonRoad file: its first element is {one_line(name, 40)}"
            )

    def state(self, state: State) -> None:
        """Tracks are not asked for."""

    def thing(self, thing: Element) -> None:
        self.draft.thing(thing)


def road_of(path: Path) -> RoadNetwork:
    """Read the lanelets of a CommonRoad file, or those of a recording.

    Args:
        path: XML, with or without tracks, or a file of `socialiq data import`.

    Raises:
        UserError: If it can't be read, or holds no lanelet.
    """
    if path.suffix.lower() == ".xml":
        gathered = _RoadAlone(path)
        read(path, gathered)
        found = gathered.draft.network()
    elif path.is_file() and kind_of(path) == files.KIND:
        found = files.load(path).road
    else:
        raise UserError(
            f"{path} is no map: name a CommonRoad file (.xml), or a recording that has lanelets"
        )
    if not found.lanelets:
        raise UserError(f"{path} holds no lanelet: name a map that does")
    return found
