"""Films of single episodes, played again by their seeds."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from socialiq.errors import UserError
from socialiq.types import Policy
from socialiq.worlds.intersection.pictures import render, scenes
from socialiq.worlds.intersection.world import Intersection

_PER_SECOND = 5  # frames; every sub-step would take three times as long to draw


def path_of(kind: str, number: int) -> str:
    """Where a film lies in the report's folder.

    Args:
        kind: "median" or "worst".
        number: From 1.
    """
    return f"episodes/{kind}-{number}.gif"


def check_filmed(world: object) -> None:
    """Refuse a world that has no films, before anything is played.

    Raises:
        UserError: If the world is not the intersection.
    """
    if not isinstance(world, Intersection):
        raise UserError("films are drawn of the intersection alone: leave out --films")


def films_of(
    world: Intersection, policy: Policy, chosen: Mapping[str, Sequence[Mapping[str, Any]]]
) -> dict[str, bytes]:
    """Play episodes again, one by one, and draw them.

    Args:
        world: Of the declaration.
        policy: Under audit; it takes its best actions.
        chosen: Of `selected.selected`.

    Returns:
        GIF files by path in the report's folder.
    """
    found = {}
    every = max(1, world.options.simulation_frequency // _PER_SECOND)
    with tempfile.TemporaryDirectory() as place:
        film = Path(place) / "film.gif"
        for kind, rows in chosen.items():
            for number, row in enumerate(rows, 1):
                played = scenes.episode_scenes(world.options, policy, int(row["seed"]))
                shown = [*played[:-1:every], played[-1]]
                render.save(film, shown, _PER_SECOND)
                found[path_of(kind, number)] = film.read_bytes()
    return found
