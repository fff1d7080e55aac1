"""Data of the page: the exact front of the 7x7 world, and the dial that turns with its curve.

The dial is the shipped one with its study's curve, or a user's own, measured.
"""

import csv
import functools
import math
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

from socialiq.errors import UserError
from socialiq.evaluation.dial import rollout_dial
from socialiq.mdp.front import AttainableSet, attainable_set
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.view import OneHot, View
from socialiq.reading import read_bytes
from socialiq.results_folder import from_csv
from socialiq.social.angle import angle_of, exact_weights, score
from socialiq.storage import open_csv, packaged_results
from socialiq.types import Ending
from socialiq.worlds.crossing7 import ABSENT, CONFLICT, SIZE, make
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.intersection.world import Intersection

ANGLES = range(91)
"""Angles that the dial turns to, in degrees."""


@functools.cache
def crossing() -> dict[str, Any]:
    """Return the exact front of the 7x7 world, JSON-compatible.

    Returns:
        `polygon`: extreme points of all policies' expected sums (r_env, r_social), time-dependent
        and random ones included; `front`: the best ones between 0 and 90 degrees; `corners`: those
        that are best at one of `ANGLES`, with one optimal policy each; `best`: the corner of each
        of `ANGLES`; `radius`: for each angle the furthest point that lies at it
        (`AttainableSet.radius`), or None if there is none; `size` and `conflict` of the world.
    """
    world = make()
    radii = []
    table = tabulate(world).reachable_part()
    attainable = attainable_set(table.mdp, world.horizon)
    best = [attainable.optimum(float(angle)).vertex for angle in ANGLES]
    numbers = list(dict.fromkeys(best))
    for angle in ANGLES:
        try:
            radii.append(round(attainable.radius(float(angle)), 9))
        except UserError:
            radii.append(None)
    return {
        "polygon": attainable.vertices.round(9).tolist(),
        "front": attainable.front().round(9).tolist(),
        "corners": [_corner(attainable, number, table) for number in numbers],
        "best": [numbers.index(vertex) for vertex in best],
        "radius": radii,
        "size": SIZE,
        "conflict": CONFLICT,
    }


def _corner(attainable: AttainableSet, number: int, table: Table) -> dict[str, Any]:
    """Return a corner: its point, where it lies, the angles that it is best at, and its visits."""
    low, high = attainable.supporting_interval(number)
    reward = score(exact_weights((max(low, 0.0) + min(high, 90.0)) / 2.0), table.mdp.rewards)
    best = horizon_optimum(table.mdp, reward, table.world.horizon)
    evaluation = horizon_evaluation(
        table.mdp, best.probabilities(table.mdp.n_actions), table.world.horizon
    )
    visits = evaluation.visits
    states = table.states
    decisions = np.zeros((SIZE, visits.shape[1]))
    vehicles = np.zeros(SIZE)
    np.add.at(decisions, states[:, 0], visits)
    by_state = visits.sum(axis=1)
    for row in (states[:, 2], states[:, 4]):
        np.add.at(vehicles, row[row != ABSENT], by_state[row != ABSENT])
    rows = states[:, [2, 4]]
    nearest = np.where(rows < CONFLICT, rows, ABSENT).max(axis=1)  # ABSENT is -1: the last entry
    before = states[:, 0] == CONFLICT - 1
    approaching = np.zeros((CONFLICT + 1, visits.shape[1]))
    np.add.at(approaching, nearest[before], visits[before])
    return {
        "point": [round(total, 9) + 0.0 for total in evaluation.totals],
        "angle": angle_of(*evaluation.totals),
        "low": max(low, 0.0),
        "high": min(high, 90.0),
        "length": evaluation.length,
        "arrival": float(evaluation.endings[Ending.ARRIVAL]),
        "timeout": float(evaluation.endings[Ending.TIMEOUT]),
        "decisions": decisions.round(6).tolist(),
        "vehicles": vehicles.round(6).tolist(),
        "approaching": approaching.round(6).tolist(),
    }


STUDY = "intersection-dial-clock"
"""Folder of the results with the page's dial: the dials that observe the time."""

FLEET_STUDY = "population"
"""Folder of the results with the dial that was trained among its like."""

CAUSED_STUDY = "caused-effects"
"""Folder of the results with the dial that is rewarded for what it causes."""

FAMILY = "iterated"
SEED = 60
"""Dials improved by policy iteration; the training seed of the one beside the tables."""

SHIFT_STUDY = "compare-shifts"
"""Folder of the results with what the dial does when its actions are late."""

_PRICED = {"caused": "what it causes", "eq_4_2": "what happens near it"}

STORY_SEED = 1
"""Traffic of the story: the smallest seed that a test of its claims accepts."""

EPISODES = 500
"""Episodes at each angle of a user's dial, seeds 1 ff."""

_EVERY = 5  # degrees between the points of its curve
_MOST = 16_000_000  # bytes of its file


class Point(NamedTuple):
    """A point of a trade-off curve, at the angle that the dial was asked for, in degrees.

    Own progress and effect on others are means of episodes with a 95 % interval: mean, low, high.
    """

    asked: float
    env: tuple[float, float, float]
    social: tuple[float, float, float]


@dataclass(frozen=True)
class PageDial:
    """A dial: its file, the whole angles that the page turns to, its curve, its source in words."""

    name: str  # what it was rewarded for
    file: bytes
    low: int
    high: int
    curve: tuple[Point, ...]
    source: str


def shipped_dial() -> PageDial:
    """Return the dial of the committed study; `UserError` without the committed results."""
    folder = packaged_results() / STUDY
    with open_csv(folder / "policies.csv") as text:
        rows = [row for row in csv.DictReader(text) if row["family"] == FAMILY]
    points = []
    for row in rows:
        if int(row["seed"]) == SEED:
            env, social = (
                _interval(float(row[name]), float(row[f"{name}_sd"]), int(row["episodes"]))
                for name in ("r_env", "r_social")
            )
            points.append(Point(float(row["asked"]), env, social))
    source = (
        f"The dial observes the time and was improved by policy iteration: {STUDY}, family "
        f"{FAMILY}, training seed {SEED}. Its curve has 2,000 episodes at each angle. The study "
        "intersection-dial makes both again, with the options in the documentation."
    )
    file = (folder / f"{FAMILY}.safetensors").read_bytes()
    return PageDial("what happens near it", file, 0, 90, tuple(sorted(points)), source)


def caused_dial() -> PageDial:
    """Return the dial of the committed study of effects, with the means of its five trainings.

    Raises:
        UserError: If the package was installed without the committed results.
    """
    folder = packaged_results() / CAUSED_STUDY
    with open_csv(folder / "effects.csv") as text:
        rows = [row for row in csv.DictReader(text) if row["dial"] == "caused"]
    points = [
        Point(float(row["angle"]), *(
            (float(row[name]), float(row[f"{name}_low"]), float(row[f"{name}_high"]))
            for name in ("r_env", "r_eq_4_2")
        ))
        for row in rows
    ]  # fmt: skip
    source = (
        "The dial of what it causes is the first of five trainings of the study "
        f"{CAUSED_STUDY}. Its curve is the mean of the five, on 4,000 episodes at each angle."
    )
    file = (folder / "dial.safetensors").read_bytes()
    return PageDial("what it causes", file, 0, 90, tuple(sorted(points)), source)


def fleet_dial() -> PageDial:
    """Return the dial of the study of populations, which the page turns in fleets alone: no curve.

    Raises:
        UserError: If the package was installed without the committed results.
    """
    source = (
        f"The dial among its like is the one of training seed 501 of the study {FLEET_STUDY}: the "
        "dial of what it causes, improved in fleets of eight."
    )
    file = (packaged_results() / FLEET_STUDY / "dial.safetensors").read_bytes()
    return PageDial("what it causes, among its like", file, 0, 90, (), source)


def story(shipped: bool) -> dict[str, Any]:
    """Return what the page's story needs in addition to the dials, JSON-compatible.

    Returns:
        `main` and `other`: the dial that it shows and the one next to it, or None; `seed`; `price`:
        for each dial of the study of effects the metres that others lose, with their interval, and
        the share of the progress at its first angle that the ego keeps.

    Raises:
        UserError: If the package was installed without the committed results.
    """
    if not shipped:
        return {"main": 0, "other": None, "seed": STORY_SEED, "price": []}
    with open_csv(packaged_results() / CAUSED_STUDY / "effects.csv") as text:
        rows = list(csv.DictReader(text))
    price = []
    for place, (dial, name) in enumerate(_PRICED.items()):
        chosen = [row for row in rows if row["dial"] == dial]
        points = [
            {
                "angle": float(row["angle"]),
                "delay": [float(row[f"delay{end}"]) for end in ("", "_low", "_high")],
                "kept": float(row["r_env"]) / float(chosen[0]["r_env"]),
            }
            for row in chosen
        ]
        price.append({"name": name, "place": 1 - place, "points": points})
    return {"main": 1, "other": 0, "seed": STORY_SEED, "price": price}


def late_shares() -> list[float]:
    """Return the shares of collisions of the shipped dial at 45 degrees by its latency.

    Returns:
        On time, one decision late, and one decision late with a front end.

    Raises:
        UserError: If the package was installed without the committed results.
    """
    rows = from_csv(packaged_results() / SHIFT_STUDY / "compared.csv")
    on_time, late = (
        next(row for row in rows if (row["shift"], row["angle"]) == (shift, 45.0))
        for shift in ("none", "late")
    )
    return [
        on_time["dial_collision"],
        *(late[name] for name in ("dial_collision", "dial_front_collision")),
    ]


def _interval(mean: float, deviation: float, episodes: int) -> tuple[float, float, float]:
    """Return a mean with its 95 % interval, by the normal distribution."""
    half = NormalDist().inv_cdf(0.975) * deviation / math.sqrt(episodes)
    return mean, mean - half, mean + half


def own_dial(path: Path) -> PageDial:
    """Return a user's dial that fits the intersection, with a curve that is measured here.

    Raises:
        UserError: If it can't be read, is no dial, has a view that the page lacks, or no whole
            angle from 0 to 90 degrees.
    """
    dial = DialPolicy.load(path)
    if isinstance(dial.turned.view, OneHot):
        raise UserError(
            f"{path} reads features one-hot, as in a gridworld: train it at the intersection"
        )
    if isinstance(dial.turned.view, View) and dial.turned.view.choice.ahead:
        raise UserError(f"{path} has the view set_ahead, which the page lacks: train it with set")
    low = math.ceil(max(dial.low, 0.0))
    high = math.floor(min(dial.high, 90.0))
    if low > high:
        raise UserError(
            f"{path} has the angles {dial.low:g} to {dial.high:g} degrees, and the page turns from "
            "0 to 90: train it in that range"
        )
    source = (
        f"The dial is {path.name}, SHA-256 {dial.turned.sha256}. Its curve was measured when this "
        f"page was written: {EPISODES} episodes at each angle, seeds 1 to {EPISODES}."
    )
    file = read_bytes(path, _MOST)
    curve = measured(dial, low, high)
    return PageDial(path.stem, file, low, high, curve, source)


def measured(dial: DialPolicy, low: int, high: int, episodes: int = EPISODES) -> tuple[Point, ...]:
    """Return a dial's trade-off curve, measured by greedy episodes of the intersection.

    Args:
        dial: The dial.
        low: First angle, whole degrees.
        high: Last angle, whole degrees.
        episodes: Number of episodes at each angle, with the seeds 1, 2, 3, ...; at least 2.

    Returns:
        A point for the first angle, the multiples of five between, and the last one, by rising
        angle.
    """
    inner = range(-(-low // _EVERY) * _EVERY, high + 1, _EVERY)
    angles = [float(angle) for angle in sorted({low, *inner, high})]
    batch = Intersection().batch(min(episodes, 500))
    driven = rollout_dial(dial, batch, angles, np.arange(1, episodes + 1))
    points = []
    for angle, totals in zip(angles, driven.totals, strict=True):
        means = totals.mean(axis=0).tolist()
        deviations = totals.std(axis=0, ddof=1).tolist()
        pairs = zip(means, deviations, strict=True)
        env, social = (_interval(mean, deviation, episodes) for mean, deviation in pairs)
        points.append(Point(angle, env, social))
    return tuple(points)
