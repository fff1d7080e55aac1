"""People on foot and on bicycles on a road: options, signals and the reward's part."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, make_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from socialiq.errors import UserError
from socialiq.social.angle import check_class_angle, class_weights
from socialiq.types import ByClass, RewardPair
from socialiq.worlds.highway.crossings import Crossings
from socialiq.worlds.highway.options import Buffers
from socialiq.worlds.road_users import (
    ARRIVALS,
    CLASS,
    INFLUENCE,
    MOST_CLASSES,
    ON_FOOT,
    RIDES,
    ROAD_USERS,
    WEIGHTS,
    RoadUser,
)

CROSSWALK = "-crosswalk"
"""Part of the name of a world with people on foot."""

LONGEST = 1.5  # durations of an episode for which arrivals are drawn: the usual end of effects


def _options() -> Iterator[tuple[str, type, Any]]:
    """Yield name, type and default of each option of the classes, with its meaning."""

    def option(default: float | int, meaning: str) -> Any:
        return field(default=default, metadata={"meaning": meaning})

    for user in ROAD_USERS:
        for column, (name, default) in user.arrivals.items():
            yield name, type(default), option(default, ARRIVALS[column])
    meaning = "angle b of the class weights (cos b, sin b) in r_social, degrees"
    yield "class_angle", float, option(45.0, meaning)
    for user in ROAD_USERS:
        for what, default in user.weights.items():
            name = f"{user.name}_{what}_weight"
            yield name, float, option(default, WEIGHTS[what].format(user.name))


_ClassOptions: Any = make_dataclass("_ClassOptions", _options(), frozen=True)


@dataclass(frozen=True)
class PeopleOptions(_ClassOptions):
    """Options of a road with people, the first base of the road's options.

    Those of each class of people are in the table `road_users.ROAD_USERS`.

    Raises:
        UserError: If a value is not supported.
    """

    if TYPE_CHECKING:  # of the road's options
        duration: float

        @property
        def places(self) -> int: ...  # noqa: D102

        @property
        def vehicle_rows(self) -> int: ...  # noqa: D102

    def __post_init__(self) -> None:
        super().__post_init__()
        check_class_angle(self.class_angle)
        for user in ROAD_USERS:
            for column, (name, _) in user.arrivals.items():
                value = getattr(self, name)
                if column == "rate" and not 0 <= value <= 1:
                    raise UserError(f"{name} must be 0 to 1 a second, got {value}")
                if column == "rows" and not (isinstance(value, int) and value >= 0):
                    raise UserError(f"{name} must be a whole number of at least 0, got {value}")
                if column in ("speed", "gap", "least_gap") and not value > 0:
                    raise UserError(f"{name} must be positive, got {value}")
                if column in ("speed_sd", "gap_sd", "impatience") and not value >= 0:
                    raise UserError(f"{name} must be at least 0, got {value}")

    @property
    def road_users(self) -> tuple[RoadUser, ...]:
        """Classes of people that there are; the first always is."""
        first, *others = ROAD_USERS
        return (first, *(user for user in others if self.arrivals(user)))

    @property
    def rides(self) -> bool:
        """Whether people ride along the arms."""
        return any(user.motion == RIDES for user in self.road_users)

    @property
    def narrow_rows(self) -> tuple[int, ...]:
        """Rows of vehicles and of the first classes; at last those of vehicles alone."""
        rows = [self.vehicle_rows]
        for user in self.road_users:
            rows.append(rows[-1] + getattr(self, user.arrivals["rows"][0]))
        return tuple(rows[: max(2, len(rows) - 1)][::-1])

    @property
    def observed_rows(self) -> int:
        """Rows of the observation: vehicles, then people of each class."""
        people = sum(getattr(self, user.arrivals["rows"][0]) for user in self.road_users)
        return self.vehicle_rows + people

    def arrivals(self, user: RoadUser) -> int:
        """Return the number of people of a class that can arrive.

        It is the expected number and four standard deviations.
        """
        expected = self.places * getattr(self, user.rate) * LONGEST * self.duration
        return math.ceil(expected + 4 * math.sqrt(expected))

    @property
    def persons(self) -> int:
        """Number of people that can arrive."""
        return sum(self.arrivals(user) for user in ROAD_USERS)

    @property
    def classes(self) -> np.ndarray:
        """The core's table, CLASS records of the classes that there are."""
        table = np.zeros(MOST_CLASSES, CLASS)
        for number, user in enumerate(ROAD_USERS):
            if user not in self.road_users:
                continue
            row = table[number]
            for name in ("motion", "length", "width"):
                row[name] = getattr(user, name)
            row["persons"] = self.arrivals(user)
            for column, (name, _) in user.arrivals.items():
                row[column] = getattr(self, name)
        return table

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals of the classes that there are."""
        return tuple(name for user in self.road_users for name in user.signals)

    @property
    def social_weights(self) -> dict[str, float]:
        """Weight in r_vulnerable of each signal, that of its class included."""
        weights = dict[str, float]()
        for user in self.road_users:
            of_class = getattr(self, f"{user.name}_class_weight", 1.0)
            for name in user.signals:
                weights[name] = of_class * getattr(self, f"{name}_weight")
        return weights

    def unseen(self, rows: int) -> tuple[str, ...]:
        """Return the plurals of the classes that a policy of so many rows does not see."""
        first = self.vehicle_rows
        unseen = list[str]()
        for user in self.road_users:
            if rows <= first:
                unseen.append(user.plural)
            first += getattr(self, user.arrivals["rows"][0])
        return tuple(unseen)

    @property
    def definition(self) -> dict[str, Any]:
        """Weights by class of the reward, as JSON, which are added to those of any road."""
        collisions = [f"{user.name}_collision" for user in self.road_users]
        of_ego = {name: getattr(self, f"{name}_weight") for name in collisions}
        classes = class_weights(self.class_angle)._asdict()
        return {"vulnerable": self.social_weights, "of_ego": of_ego, "classes": classes}


def check_ways(name: str, crossings: Crossings, options: PeopleOptions) -> None:
    """Refuse people who have no way over a road.

    Args:
        name: Name of the road.
        crossings: Ways of people over it.
        options: Options of the road.

    Raises:
        UserError: If people of a class can arrive, and the road lacks crosswalks or bicycle lanes.
    """
    places = {ON_FOOT: crossings.crosswalks}
    places[RIDES] = len(crossings.ways) - 2 * crossings.crosswalks
    lacking = {
        ON_FOOT: "no crosswalk leads over it: give `road_of` its ways",
        RIDES: "it has no bicycle lanes, which lead straight on from one arm to the opposite one",
    }
    for user in options.road_users:
        if options.arrivals(user) and not places[user.motion]:
            raise UserError(f"{name} has no {user.key}: {lacking[user.motion]}")


def signals_of(options: PeopleOptions, buffers: Buffers, agent: int) -> dict[str, np.ndarray]:
    """Return the signals of an agent in the last decision.

    Args:
        options: Options of the scenario, whose `signals` are returned.
        buffers: Arrays of the batch, with PERSON records.
        agent: Number of the agent, 0 for an ego.

    Returns:
        Each signal by its name, unweighted, (batch,): the seconds that people lose by waiting and
        would not without the agent, the closest encounter with it, 0 to 1, and whether it hits a
        person; of those who ride the speed too that they lose by braking for it, m/s.
    """
    signals = dict[str, Any]()
    begin = 0
    for user in options.road_users:
        end = begin + options.arrivals(user)
        people = buffers.people[:, begin:end]
        influences = buffers.influences[:, agent, begin:end]
        values = {
            "delay": influences["delay"].sum(axis=1),
            "encounter": influences["encounter"].max(axis=1, initial=0.0),
            "hit": (people["hit_by"] == agent).any(axis=1).astype(np.float64),
            "braking": influences["lost_speed"].sum(axis=1),
        }
        signals |= {f"{user.name}_{what}": value for what, value in values.items()}
        begin = end
    return {name: signals[name] for name in options.signals}


def begin_decision(buffers: Buffers, rows: np.ndarray) -> None:
    """Set to 0 what the core adds up in a decision.

    Args:
        buffers: Arrays of the batch.
        rows: Rows in which a decision begins, by numbers or as a mask.
    """
    buffers.people["delay"][rows] = 0.0
    buffers.influences[rows] = np.zeros((), INFLUENCE)


def by_class(
    options: PeopleOptions, rewards: RewardPair, signals: dict[str, np.ndarray], parts: bool
) -> RewardPair:
    """Return the reward pair with the part of people.

    Args:
        options: Options of the scenario, with the weights.
        rewards: Pair without people.
        signals: Signals of people, as `signals_of` returns them.
        parts: Whether r_social stays in parts by class; else it is their sum, weighed by the class
            angle.
    """
    env = rewards.env
    for user in options.road_users:
        env = env + getattr(options, f"{user.name}_collision_weight") * signals[f"{user.name}_hit"]
    vulnerable = sum(weight * signals[name] for name, weight in options.social_weights.items())
    if parts:
        return RewardPair(env, ByClass(rewards.social, vulnerable))
    weights = class_weights(options.class_angle)
    return RewardPair(env, weights.vehicle * rewards.social + weights.vulnerable * vulnerable)
