"""People on foot and on bicycles: one table of their classes, and the records of the cores.

A class is a row of `ROAD_USERS`. The options of a world, its signals and weights, the table that
the core reads, the code in observations, the measures of effects, and words and sizes in reports
and pictures follow from its row.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

ON_FOOT, RIDES = range(2)
"""Motions: across an arm on its crosswalk, or along the bicycle lanes of an arm and its exit."""

ARRIVALS = {
    "rate": "arrivals at each arm per s",
    "speed": "m/s, mean",
    "speed_sd": "m/s, standard deviation",
    "gap": "s until the next vehicle arrives, mean of those accepted at first",
    "gap_sd": "s, standard deviation",
    "least_gap": "s accepted at least",
    "impatience": "s less of the gap for each second of waiting",
    "rows": "rows of the observation behind those of the classes before",
}
"""Columns of a class that options set, with their meaning."""

WEIGHTS = {
    "delay": "of a second that a {} waits because of the ego",
    "encounter": "of a decision's closest encounter with a {}",
    "hit": "in r_social, of a {} that the ego hits",
    "braking": "of 1 m/s that a {} loses by braking for the ego",
    "collision": "in r_env, of a {} that the ego hits, beside collision_weight",
    "class": "by which the weights of a {} in r_social are multiplied",
}
"""Weights that a class may have, with their meaning: of its signals in a decision; in r_env, of the
signal `hit` again; and of the class, 1 without it."""


class InSumo(NamedTuple):
    """Class of SUMO that stands for a class of people; people on foot are persons of SUMO."""

    name: str = ""  # in options, signals and names of road users; "" if there is none
    lanes: str = ""  # SUMO's class of vehicles (vClass), whose lanes it uses
    rate: float = 0.0  # default departures per s
    number: int = 0  # of its random stream, and its order: 0 is of vehicles, 3 of the ego
    length: float = 0.0  # m


class RoadUser(NamedTuple):
    """Class of people who walk or ride."""

    name: str
    plural: str
    key: str  # of its rate in the name of a world
    motion: int  # ON_FOOT or RIDES
    length: float  # m
    width: float  # m
    arrivals: Mapping[
        str, tuple[str, float | int]
    ]  # option and its default, by column of `ARRIVALS`
    weights: Mapping[str, float]  # default of the weight of each of `WEIGHTS` that it has
    most_delay: float  # default bound of an audit, s that people of the class wait in an episode
    most_hit: float  # default bound of an audit, share of episodes in which one is hit
    waiting: str = ""  # name of its delay in audits, if that differs from the signal's
    sumo: InSumo = InSumo()
    recorded: str = ""  # name of its class in recordings, if there is one

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of its signals."""
        further = ("collision", "class")
        return tuple(f"{self.name}_{what}" for what in self.weights if what not in further)

    @property
    def delay(self) -> str:
        """Name of the quantity of an audit that is its delay."""
        return self.waiting or f"{self.name}_delay"

    @property
    def rate(self) -> str:
        """Option of its rate of arrival."""
        return self.arrivals["rate"][0]

    @property
    def limits(self) -> dict[str, float]:
        """Default bounds of an audit by name, as `max_waiting`."""
        return {f"max_{self.delay}": self.most_delay, f"max_{self.name}_hit": self.most_hit}


ROAD_USERS = (
    RoadUser(
        name="pedestrian",
        plural="pedestrians",
        key="people",
        motion=ON_FOOT,
        length=0.6,
        width=0.6,
        arrivals={
            "rate": ("pedestrian_rate", 0.1),
            "speed": ("walking_speed", 1.4),
            "speed_sd": ("walking_speed_sd", 0.25),
            "gap": ("accepted_gap", 4.5),
            "gap_sd": ("accepted_gap_sd", 0.7),
            "impatience": ("impatience", 0.15),
            "least_gap": ("least_gap", 2.0),
            "rows": ("observed_pedestrians", 6),
        },
        weights={"delay": -0.2, "encounter": -1.0, "hit": -20.0, "collision": -25.0},
        most_delay=3.0,
        most_hit=0.02,
        waiting="waiting",
        sumo=InSumo("pedestrian", lanes="pedestrian", rate=0.2, number=2, length=0.215),
        recorded="pedestrian",
    ),
    RoadUser(
        name="cyclist",
        plural="cyclists",
        key="cyclists",
        motion=RIDES,
        length=1.8,
        width=0.75,
        arrivals={
            "rate": ("cyclist_rate", 0.0),
            "speed": ("cycling_speed", 4.6),
            "speed_sd": ("cycling_speed_sd", 1.1),
            "gap": ("cyclist_gap", 4.0),
            "gap_sd": ("cyclist_gap_sd", 0.7),
            "least_gap": ("cyclist_least_gap", 2.0),
            "impatience": ("cyclist_impatience", 0.15),
            "rows": ("observed_cyclists", 4),
        },
        weights={
            "delay": -0.2, "encounter": -1.0, "hit": -20.0, "braking": -0.1, "collision": -25.0,
        },
        most_delay=1.5,
        most_hit=0.02,
        sumo=InSumo("bicycle", lanes="bicycle", rate=0.1, number=1, length=1.6),
        recorded="bicycle",
    ),
)  # fmt: skip
"""The classes, in the order of observations and tables. People of the first one may always arrive;
a world has the others if their rate is above 0."""

MOST_CLASSES = 4
"""Rows of the core's table of classes."""

FIRST_CODE = 2.0
"""Number in the place of a vehicle's presence in an observation, of the first class; that of each
further class is one more."""

CLASS = np.dtype(
    [
        ("motion", np.int64),
        ("length", np.float64),  # m
        ("width", np.float64),  # m
        ("persons", np.int64),  # records of people
        *((column, np.int64 if column == "rows" else np.float64) for column in ARRIVALS),
    ],
    align=True,
)
"""Record of a class that the core reads."""

ABSENT, WAITING, MOVING, GONE = range(4)
"""States of a person: before its arrival, before its line, on its way behind it, at the end."""

PERSON = np.dtype(
    [
        ("x", np.float64),  # centre, m; x to the east, y to the south
        ("y", np.float64),
        ("heading", np.float64),  # rad, clockwise as drawn, from east
        ("along_x", np.float64),  # cosine and sine of the heading
        ("along_y", np.float64),
        ("speed", np.float64),  # m/s
        ("free_speed", np.float64),  # m/s where nothing holds the person
        ("length", np.float64),  # m
        ("width", np.float64),  # m
        ("arrival", np.float64),  # s since the reset
        ("accepted_gap", np.float64),  # s, before it has waited
        ("waited", np.float64),  # s lost by waiting since the reset
        # s lost by waiting in a decision that it would not have lost without one of the agents
        ("delay", np.float64),
        ("identity", np.int32),  # unique in its episode, vehicles included
        ("kind", np.int8),  # row of `ROAD_USERS`
        ("motion", np.int8),  # ON_FOOT or RIDES
        ("way", np.int16),  # row of the road's `crossings.ways`
        ("state", np.int8),
        ("hit", np.bool_),  # by an agent
        ("hit_by", np.int8),  # number of this agent
    ],
    align=True,
)
"""Record of a person."""

INFLUENCE = np.dtype(
    [
        # s lost by waiting that the person would not have lost without this agent alone
        ("delay", np.float64),
        ("encounter", np.float64),  # closest one, 0 to 1
        ("lost_speed", np.float64),  # m/s lost by braking for the agent
    ],
    align=True,
)
"""Record of what an agent does to a person in a decision."""
