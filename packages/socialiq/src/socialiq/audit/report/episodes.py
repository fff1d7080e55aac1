"""Single episodes of a report: three median and three worst ones, their traces and films."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.evidence.replay import Road, Trace, replayer, road_of
from socialiq.audit.evidence.table import kind_of_ending
from socialiq.errors import UserError
from socialiq.types import Policy, RewardPair
from socialiq.worlds.highway import render, sheet
from socialiq.worlds.highway.scenes import SCENES
from socialiq.worlds.world import World

_SELECTED = 3


def selected(evidence: Evidence, angle: float) -> dict[str, list[dict[str, Any]]]:
    """Return the policy's median and worst episodes by R(α).

    Args:
        evidence: Evidence of the audit.
        angle: Declared angle in degrees.

    Returns:
        Rows by "median" and "worst"; equal values in the order of the episodes.
    """
    values = evidence.policy.values(angle)
    order = np.argsort(values, kind="stable")
    count = min(_SELECTED, len(order))
    first = (len(order) - count) // 2
    places = {"median": order[first : first + count], "worst": order[:count]}
    return {
        name: [_row(evidence, int(episode), float(values[episode])) for episode in chosen.tolist()]
        for name, chosen in places.items()
    }


def _row(evidence: Evidence, episode: int, value: float) -> dict[str, Any]:
    env, social = evidence.policy.totals[episode].tolist()
    return {
        "episode": episode,
        # Text, since many readers of JSON keep no more than 53 bits of a number.
        "seed": str(int(evidence.seeds[episode])),
        "r_env": env,
        "r_social": social,
        "value": value,
        "ending": kind_of_ending(evidence.policy, episode),
        "decisions": int(evidence.policy.length[episode]),
    }


Traces = Mapping[str, Sequence[Trace | Mapping[str, Any] | None]]
"""Traces of the chosen episodes, or their JSON, by "median" and "worst"."""


def traces_of(
    world: World,
    policy: Policy,
    chosen: Mapping[str, Sequence[Mapping[str, Any]]],
    deterministic: bool = True,
) -> Traces:
    """Run episodes again, one by one, and return the ways of all vehicles.

    Args:
        world: World of the declaration.
        policy: The policy under audit.
        chosen: Result of `selected`.
        deterministic: Whether it takes its best actions.

    Returns:
        For each episode its trace; None if the policy drives another episode than in the evidence,
        or in an environment.
    """
    again = replayer(world, policy, deterministic)

    def traced(row: Mapping[str, Any]) -> Trace | None:
        if again is None:
            return None
        played = again(int(row["seed"]))
        same = played.repeats(row["decisions"], RewardPair(row["r_env"], row["r_social"]))
        return played.trace if same else None

    return {kind: [traced(row) for row in rows] for kind, rows in chosen.items()}


_PER_SECOND = 5  # frames; every sub-step would take three times as long to draw


def path_of(kind: str, number: int) -> str:
    """Return the path of a film in the report's folder.

    Args:
        kind: "median" or "worst".
        number: Number of the episode, from 1.
    """
    return f"episodes/{kind}-{number}.gif"


def check_filmed(world: World) -> Road:
    """Return the road of a world if films of its episodes can be drawn.

    Raises:
        UserError: If the world is no road of highway-env.
    """
    road = road_of(world)
    if road is None:
        roads = ", ".join(("intersection", *SCENES))
        raise UserError(f"films are drawn of roads alone ({roads}): leave out --films")
    return road


def films_of(
    world: World, policy: Policy, chosen: Mapping[str, Sequence[Mapping[str, Any]]]
) -> dict[str, bytes]:
    """Run episodes again, one by one, and draw them.

    Args:
        world: World of the declaration.
        policy: The policy under audit; it takes its best actions.
        chosen: Result of `selected`.

    Returns:
        GIF files by path in the report's folder.

    Raises:
        UserError: If the world is no road of highway-env.
    """
    films, road = {}, check_filmed(world)
    every = max(1, road.world.options.simulation_frequency // _PER_SECOND)
    batch = road.world.batch(1, traced=True)
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder) / "film.gif"
        for kind, rows in chosen.items():
            for number, row in enumerate(rows, 1):
                seed = road.first_seed(int(row["seed"]))
                played = render.episode_scenes(batch, road.as_asked(policy), seed)
                frames = [*played[:-1:every], played[-1]]
                sheet.save(film, frames, road.world.view, _PER_SECOND)
                films[path_of(kind, number)] = film.read_bytes()
    return films
