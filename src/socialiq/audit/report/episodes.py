"""Single episodes in a report: the table of all, three median and three worst ones, their films."""

from __future__ import annotations

import csv
import io
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.audit.evidence.outcomes import Evidence, Outcomes
from socialiq.errors import UserError
from socialiq.social.angle import exact_weights, score
from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.intersection.pictures import render, scenes
from socialiq.worlds.intersection.state import Contact
from socialiq.worlds.intersection.world import Intersection

SHOWN = 3


def selected(evidence: Evidence, angle: float) -> dict[str, list[dict[str, Any]]]:
    """The policy's median and worst episodes by what the declared weights say of them.

    Args:
        evidence: Of the audit.
        angle: Declared, degrees.

    Returns:
        Rows by "median" and "worst"; equal values in the order of the episodes.
    """
    values = value_of(evidence.policy, angle)
    order = np.argsort(values, kind="stable")
    count = min(SHOWN, len(order))
    first = (len(order) - count) // 2
    places = {"median": order[first : first + count], "worst": order[:count]}
    return {
        name: [_row(evidence, int(place), float(values[place])) for place in chosen.tolist()]
        for name, chosen in places.items()
    }


_COLLISIONS = {
    Contact.NONE: "collision",  # the environment does not tell who struck whom
    Contact.EGO_STRUCK: "drove into another",
    Contact.EGO_WAS_STRUCK: "struck by another",
}


def value_of(driver: Outcomes, angle: float) -> np.ndarray:
    """R(α) of each of a driver's episodes."""
    return np.asarray(score(exact_weights(angle), RewardPair(*driver.totals.T)))


def kind_of_ending(driver: Outcomes, place: int) -> str:
    """Ending of an episode, in one word or two."""
    ending = Ending(int(driver.ending[place]))
    if ending is not Ending.COLLISION:
        return ending.name.lower()
    return _COLLISIONS[Contact(int(driver.contact[place]))]


def _row(evidence: Evidence, place: int, value: float) -> dict[str, Any]:
    env, social = evidence.policy.totals[place].tolist()
    return {
        "episode": place,
        # Text, since many readers of JSON keep no more than 53 bits of a number.
        "seed": str(int(evidence.seeds[place])),
        "r_env": env,
        "r_social": social,
        "value": value,
        "ending": kind_of_ending(evidence.policy, place),
        "decisions": int(evidence.policy.length[place]),
    }


def evidence_csv(evidence: Evidence) -> str:
    """CSV with the seed, the strata, and what the policy and each reference earned.

    Numbers are written so that they read back exactly.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_head(evidence))
    drivers = [one.totals.tolist() for one in (evidence.policy, *evidence.references)]
    strata = [labels.tolist() for labels in evidence.strata.values()]
    seeds, lengths = evidence.seeds.tolist(), evidence.policy.length.tolist()
    for place in range(evidence.episodes):
        writer.writerow(
            [
                place,
                seeds[place],
                *(labels[place] for labels in strata),
                kind_of_ending(evidence.policy, place),
                lengths[place],
                *(number for totals in drivers for number in totals[place]),
            ]
        )
    return text.getvalue()


def _head(evidence: Evidence) -> list[str]:
    names = [evidence.policy.name, *(_no_formula(one.name) for one in evidence.references)]
    earned = [f"{name}.{side}" for name in names for side in ("r_env", "r_social")]
    return ["episode", "seed", *evidence.strata, "ending", "decisions", *earned]


def _no_formula(name: str) -> str:
    """A name that no spreadsheet takes for a formula."""
    return f"'{name}" if name[:1] in "=+-@\t\r" else name


_PER_SECOND = 5  # frames; every sub-step would take three times as long to draw


def path_of(kind: str, number: int) -> str:
    """Path of a film in the report's folder.

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
