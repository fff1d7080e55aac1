"""Roads: options, the record of them that the core reads, and the arrays of their episodes.

A state is two arrays, of episodes and of vehicles, so copying them saves it, and copying them back
restores it to the last bit, random stream included.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args, get_type_hints

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.types import Ending
from socialiq.worlds.highway import populations
from socialiq.worlds.highway.populations import Driver
from socialiq.worlds.road_users import CLASS, INFLUENCE, MOST_CLASSES, PERSON

Zone = Literal["last_20_m", "last_8_m", "beyond_8_m", "travelled_8_m"]
Counted = Literal["all", "cross", "approaching"]
Disruption = Literal["dead_zone", "literal"]
Crash = Literal["override", "add"]
Ends = Literal["each", "joint"]
Frame = Literal["own", "world"]
Schema = Literal["rows", "route"]
ContinuousActions = Literal["continuous", "continuous_steering"]

MOST_SPEEDS = 8
MOST_AGENTS = 16
ROWS = 16
"""Rows of vehicles that the schema `route` reads at least."""


@dataclass(frozen=True)
class ClockOptions:
    """Time of an episode."""

    simulation_frequency: int = 10  # sub-steps of the physics per second
    policy_frequency: int = 1  # decisions per second; divides the simulation frequency
    duration: float = 20.0  # seconds after which an episode times out

    @property
    def frames(self) -> int:
        """Sub-steps of a decision."""
        return self.simulation_frequency // self.policy_frequency

    @property
    def decisions(self) -> int:
        """Number of decisions after which an episode times out."""
        return math.ceil(self.duration * self.policy_frequency)


@dataclass(frozen=True)
class EgoOptions:
    """Choices and sight of the ego."""

    # speeds in m/s, equally spaced, that the ego's speed control steps through
    target_speeds: tuple[float, ...] = (0.0, 4.5, 9.0)
    observed_vehicles: int = 10  # rows of the observation, the ego's included

    @property
    def vehicle_rows(self) -> int:
        """Rows of vehicles that are shown, the ego's included."""
        return self.observed_vehicles

    @property
    def shows_behind(self) -> bool:
        """Whether vehicles more than 10 m behind the ego are shown."""
        return False

    @property
    def along_route(self) -> bool:
        """Whether the observation has the schema `route`: not without `ObservationOptions`."""
        return False

    @property
    def observed_rows(self) -> int:
        """Rows that are shown, of vehicles and of others."""
        return self.vehicle_rows

    @property
    def narrow_rows(self) -> tuple[int, ...]:
        """Rows that a policy may observe alone, which doesn't know the classes behind these."""
        return (self.vehicle_rows,)

    @property
    def max_speed(self) -> float:
        """Fastest target speed v_max, m/s."""
        return float(self.target_speeds[-1])


@dataclass(frozen=True)
class RewardOptions:
    """Options of the reward pair (thesis 4.1)."""

    progress_unit: float = 28.0  # metres of advance that count as 1
    # influence zone of the ego. "beyond_8_m" takes the thesis' 8 m as lane coordinate,
    # "travelled_8_m" as distance since the start; the others measure from the junction
    zone: Zone = "last_20_m"
    # which neighbours within the conflict distance count: all, those that come from another arm and
    # haven't left the junction, or of these only those on an approach
    counted: Counted = "all"
    # Eq 4.2's loss of speed with a dead zone, as in the text, or as printed, which charges every
    # neighbour at least the threshold
    disruption: Disruption = "dead_zone"
    crash: Crash = "override"  # whether the ego's collision replaces r_social or is added to it
    conflict_distance: float = 20.0  # metres within which a neighbour counts
    progress_weight: float = 2.0  # w_p
    speed_weight: float = 0.5  # w_v
    collision_weight: float = -2.0  # w_c
    arrival_weight: float = 1.0  # w_a
    step_weight: float = -0.15  # w_s
    timeout_weight: float = -0.5  # w_t
    yielding_weight: float = 0.2  # w_y
    disruption_weight: float = -1.0  # w_d
    neighbour_collision_weight: float = -5.0  # weight in r_social of the ego's collision
    speed_threshold: float = 1.0  # v_thresh of Eq 4.2, m/s
    speed_cap: float = 5.0  # v_cap of Eq 4.2, m/s


@dataclass(frozen=True)
class TrafficOptions:
    """Drivers of the traffic, one of the first bases of a road's options."""

    # whether drivers search for leaders beyond the end of their lane, as in intersection-v2
    connected_lanes: bool = False
    population: populations.Name = "highway_env"  # distribution of the drivers' parameters
    canonical: bool = False  # break exact ties by the order of vehicles and lanes, not by rounding


@dataclass(frozen=True)
class RoadOptions(RewardOptions, EgoOptions, ClockOptions):
    """Options of a road: time, ego and rewards.

    Dataclasses collect fields from the last base to the first; a road with more options places
    these between.

    Raises:
        UserError: If a value is not supported.
    """

    def __post_init__(self) -> None:
        kinds = get_type_hints(type(self))
        for name, kind in kinds.items():
            if get_args(kind) and isinstance(getattr(self, name), str):
                one_of(name, getattr(self, name), get_args(kind))
        counts = {"simulation_frequency": 1, "policy_frequency": 1, "observed_vehicles": 2}
        counts["agents"] = 1
        for name, least in counts.items():
            value = getattr(self, name)
            if not (isinstance(value, int) and value >= least):
                raise UserError(f"{name} must be a whole number of at least {least}, got {value}")
        if self.agents > MOST_AGENTS:
            raise UserError(f"agents must be at most {MOST_AGENTS}, got {self.agents}")
        if self.simulation_frequency % self.policy_frequency:
            raise UserError(
                f"simulation_frequency {self.simulation_frequency} is not a multiple of "
                f"policy_frequency {self.policy_frequency}: choose one that is"
            )
        if not (self.duration > 0 and math.isfinite(self.duration)):
            raise UserError(f"duration must be a positive number of seconds, got {self.duration}")
        speeds = np.array(self.target_speeds, np.float64)
        rising = bool((np.diff(speeds) > 0).all() and np.isfinite(speeds).all())
        if not (2 <= len(speeds) <= MOST_SPEEDS and rising and speeds[-1] > 0):
            raise UserError(
                f"target_speeds must be 2 to {MOST_SPEEDS} rising speeds, the last above 0, "
                f"got {self.target_speeds}"
            )
        if not np.allclose(np.diff(speeds), speeds[1] - speeds[0]):
            raise UserError(f"target_speeds must be equally spaced, got {self.target_speeds}")
        for name, kind in kinds.items():
            if kind is float and not math.isfinite(getattr(self, name)):
                raise UserError(f"{name} must be a finite number, got {getattr(self, name)}")
        for name in ("progress_unit", "conflict_distance", "speed_cap"):
            if not getattr(self, name) > 0:
                raise UserError(f"{name} must be positive, got {getattr(self, name)}")

    @property
    def width(self) -> int:
        """Number of values of a continuous action; 0 if actions are discrete."""
        return 0

    @property
    def agents(self) -> int:
        """Number of vehicles that are controlled: the ego alone, except with `AgentOptions`."""
        return 1

    @property
    def left_hand(self) -> bool:
        """Whether traffic keeps to the left: not without `SideOptions`."""
        return False

    @property
    def places(self) -> int:
        """Largest number of crosswalks, and of bicycle lanes, of the road."""
        return 4

    @property
    def persons(self) -> int:
        """Largest number of people of an episode."""
        return 0

    @property
    def capacity(self) -> int:
        """Largest number of vehicles of an episode beyond the entries of the road's table."""
        return 0

    @property
    def of_traffic(self) -> dict[str, Any]:
        """Fields of the SETTINGS record of vehicles that arrive, by name."""
        return {}

    @property
    def usual_driver(self) -> Driver:
        """highway-env's driver of this road."""
        return DRIVER

    @property
    def continuous(self) -> bool:
        """Whether the ego's actions are continuous."""
        return self.width > 0


@dataclass(frozen=True)
class AgentOptions:
    """Several controlled vehicles, the first bases of a road's options."""

    agents: int = 2  # vehicles that are controlled
    # "each": an agent that arrives leaves, wrecks are towed after the decision, and the episode
    # lasts until every agent has ended. "joint", as in highway-env: agents drive on after they
    # arrive, and the episode ends when one crashes or all have arrived
    ends: Ends = "each"
    # where arms meet, "own": each agent sees the road turned as if it came from the south, and its
    # destination is counted from its own arm. "world", as in highway-env: no view is turned, and
    # the destination is one arm for all, counted from the south
    frame: Frame = "own"


@dataclass(frozen=True)
class SideOptions:
    """Side of the traffic, one of the first bases of a road's options."""

    # whether traffic keeps to the left: the road is mirrored in the line along which the ego enters
    left_hand: bool = False


@dataclass(frozen=True)
class ObservationOptions:
    """Observation of the ego, one of the first bases of a road's options."""

    # schema of the observation: highway-env's rows, or the vector along the ego's route that is the
    # same for every road (`highway.observation`)
    observation: Schema = "rows"
    # whether vehicles more than 10 m behind the ego are shown, as with highway-env's option of this
    # name; along the route they always are
    see_behind: bool = False

    if TYPE_CHECKING:  # of the road's options

        @property
        def observed_vehicles(self) -> int: ...  # noqa: D102

    @property
    def along_route(self) -> bool:
        """Whether the observation has the schema `route`."""
        return self.observation == "route"

    @property
    def shows_behind(self) -> bool:
        """Whether vehicles more than 10 m behind the ego are shown."""
        return self.see_behind or self.along_route

    @property
    def vehicle_rows(self) -> int:
        """Rows of vehicles that are shown, the ego's included."""
        return max(self.observed_vehicles, ROWS) if self.along_route else self.observed_vehicles


@dataclass(frozen=True)
class ControlOptions:
    """highway-env's continuous actions, one of the first bases of a road's options.

    An agent is not steered along its lane: with acceleration alone it drives straight on.
    """

    # "continuous": acceleration alone. "continuous_steering": acceleration, then the angle of the
    # front wheels
    actions: ContinuousActions = "continuous"
    # whether an episode ends when the ego is off the road after a decision, as with highway-env's
    # option of this name. It then costs r_env what a collision costs
    offroad_terminal: bool = False

    @property
    def width(self) -> int:
        """Number of values of a continuous action."""
        return 2 if self.actions == "continuous_steering" else 1


@dataclass(frozen=True)
class SceneFleetOptions(AgentOptions, RoadOptions):  # pyright: ignore[reportIncompatibleVariableOverride]
    """Options of a scene of highway-env whose first entries are controlled.

    Raises:
        UserError: As `RoadOptions`, and if there are too many agents.
    """


ENV_SIGNALS = ("progress", "speed", "step", "collision", "arrival", "timeout")
SOCIAL_SIGNALS = ("yielding", "disruption", "neighbour_collision")
SIGNALS = ENV_SIGNALS + SOCIAL_SIGNALS
"""All signals; a signal's weight is the option of that name."""

SETTINGS = np.dtype(
    [
        ("dt", np.float64),  # s of a sub-step
        ("decision", np.float64),  # s between decisions
        ("duration", np.float64),
        ("frames", np.int64),  # sub-steps of a decision
        ("warm_up", np.int64),  # sub-steps before the ego enters
        ("rule_period", np.int64),  # sub-steps between applications of the road rules
        ("tie", np.float64),
        ("initial_vehicle_count", np.int64),
        ("spawn_probability", np.float64),
        ("destination", np.int64),  # arm; 0 draws one
        ("n_speeds", np.int64),
        ("target_speeds", np.float64, (MOST_SPEEDS,)),
        ("connected_lanes", np.bool_),
        ("population", np.float64, (5, 4)),
        ("progress_unit", np.float64),
        ("zone", np.int64),  # place in the option's list of names
        ("counted", np.int64),
        ("disruption", np.int64),
        ("crash", np.int64),
        ("conflict_distance", np.float64),
        ("max_speed", np.float64),
        ("speed_threshold", np.float64),
        ("speed_cap", np.float64),
        ("weights", np.float64, (len(SIGNALS),)),
        ("continuous", np.bool_),  # the ego's record holds its commands
        ("offroad_terminal", np.bool_),
        ("agents", np.int64),
        ("each", np.bool_),  # whether agents end one by one, and leave
        ("own_frame", np.bool_),  # whether an agent's view and destination are of its approach
        ("vehicle_rows", np.int64),  # rows of vehicles that are shown
        ("shows_behind", np.bool_),  # whether vehicles more than 10 m behind are shown
        ("classes", CLASS, (MOST_CLASSES,)),  # of people
    ],
    align=True,
)
"""Record of one set of options; from `warm_up` on some fields are of the intersection alone."""


DRIVER = Driver(
    speed_limit=20.0,
    time_headway=1.5,
    jam_distance=10.0,
    max_acceleration=3.0,
    comfort_deceleration=5.0,
)
"""highway-env's driver of its roads except the intersection; limits of speed differ."""

EXPONENT = 4.0

TIE = 1e-9
"""Largest difference that counts as equal in canonical mode, m."""


def settings_of(options: RoadOptions, speed_limit: float | None = None) -> np.ndarray:
    """Return the SETTINGS record of a road's options.

    Args:
        options: The options.
        speed_limit: Of the lane by which the ego enters, m/s; None: of the usual driver.

    Returns:
        An array of one record.
    """
    record = np.zeros(1, SETTINGS)
    for name in SETTINGS.names or ():
        if hasattr(options, name) and name not in (*_CODED, *_NAMED):
            record[name] = getattr(options, name)
    for name, kind in _NAMED.items():
        record[name] = get_args(kind).index(getattr(options, name))
    # highway-env divides in this order, and its rounding decides how many sub-steps fit.
    record["dt"] = 1 / options.simulation_frequency
    record["decision"] = 1 / options.policy_frequency
    record["n_speeds"] = len(options.target_speeds)
    record["target_speeds"][0, : len(options.target_speeds)] = options.target_speeds
    record["weights"] = [getattr(options, f"{name}_weight") for name in SIGNALS]
    driver = options.usual_driver
    if speed_limit is not None:
        driver = driver._replace(speed_limit=speed_limit)
    traffic = options if isinstance(options, TrafficOptions) else TrafficOptions()
    record["population"] = populations.MULTIPLES[traffic.population].of(driver)
    record["tie"] = TIE if traffic.canonical else 0.0
    if isinstance(options, AgentOptions):
        record["each"] = options.ends == "each"
    for name, value in options.of_traffic.items():
        record[name] = value
    return record


_CODED = ("target_speeds", "population", "destination")
_NAMED = {"zone": Zone, "counted": Counted, "disruption": Disruption, "crash": Crash}

_UNITS = (
    "policy_frequency",  # rewards come with each decision
    "duration",
    "target_speeds",  # the fastest is what speeds are relative to
    "progress_unit",
    *_NAMED,
    "conflict_distance",
    "speed_threshold",
    "speed_cap",
)


def is_over(ending: np.ndarray, joint: bool) -> np.ndarray:
    """Return whether each episode has ended.

    Args:
        ending: Values of `Ending`, (episode, agent).
        joint: Whether an agent's collision ends the episode for all; see `AgentOptions`.

    Returns:
        True where every agent has ended, or one has collided if `joint`; bool (episode,).
    """
    over = (ending != int(Ending.NONE)).all(axis=1)
    return over if not joint else over | (ending == int(Ending.COLLISION)).any(axis=1)


def reward_definition(options: RoadOptions) -> dict[str, Any]:
    """Return the weights and units that define the reward pair of a road, as JSON."""
    sides = {"env": ENV_SIGNALS, "social": SOCIAL_SIGNALS}
    weights = {
        side: {name: getattr(options, f"{name}_weight") for name in signals}
        for side, signals in sides.items()
    }
    return weights | {"units": {name: getattr(options, name) for name in _UNITS}}


MAX_SPEED = 40.0  # m/s of any vehicle, either way
ACCELERATION_RANGE = (-5.0, 5.0)  # m/s², of continuous actions -1 and 1
STEERING_RANGE = (-math.pi / 4, math.pi / 4)  # rad, of continuous actions -1 and 1

FEATURES = ("presence", "x", "y", "vx", "vy", "cos_h", "sin_h")
"""Numbers of one row of the observation."""


VEHICLE = np.dtype(
    [
        ("x", np.float64),  # centre, m; x to the east, y to the south
        ("y", np.float64),
        ("heading", np.float64),  # rad, clockwise as drawn, from east
        ("along_x", np.float64),  # cosine and sine of the heading: its unit vector
        ("along_y", np.float64),
        ("speed", np.float64),  # m/s, negative in reverse
        ("steering", np.float64),  # held command: front wheel angle, rad
        ("acceleration", np.float64),  # held command, m/s²
        ("target_speed", np.float64),  # m/s; 0 while yielding
        ("desired_speed", np.float64),  # m/s; infinity: only the road's limit binds
        ("time_headway", np.float64),  # s
        ("jam_distance", np.float64),  # m
        ("max_acceleration", np.float64),  # m/s²
        ("comfort_deceleration", np.float64),  # m/s², positive
        ("exponent", np.float64),  # of the free-road term
        ("timer", np.float64),  # s since the driver last thought of changing lanes
        ("push_x", np.float64),  # m, by a collision, in the next sub-step
        ("push_y", np.float64),
        ("identity", np.int32),  # unique in its episode
        ("lane", np.int16),  # closest lane
        ("target_lane", np.int16),  # lane it steers along
        ("origin", np.int16),  # arm or road by which it entered
        ("route", np.int16),  # road at which its way began, -1 without a way
        ("destination", np.int16),
        ("leg", np.int16),  # completed roads of its way
        ("changes", np.bool_),  # whether its driver changes lanes
        ("yielding", np.bool_),
        ("obstacle", np.bool_),
        ("agent", np.int8),  # number of the agent that controls it; -1: a driver
        ("crashed", np.bool_),
        ("pushed", np.bool_),  # a push is pending
    ],
    align=True,
)
"""Record of a vehicle, or of an obstacle, which stands and drives nowhere. The vehicles of an
episode are one row in highway-env's list order; obstacles follow."""


class Contact(enum.IntEnum):
    """Vehicle that struck another one, by whose motion closed the gap: the ego or its partner."""

    NONE = 0
    EGO_STRUCK = 1
    EGO_WAS_STRUCK = 2


EPISODE = np.dtype(
    [
        ("state_high", np.uint64),  # PCG64: 128 bits of state and of increment
        ("state_low", np.uint64),
        ("increment_high", np.uint64),
        ("increment_low", np.uint64),
        ("half_word", np.uint64),  # the 32 bits that a bounded draw left over
        ("has_half_word", np.bool_),
        ("time", np.float64),  # s since the reset
        ("sub_steps", np.int64),  # of the road, warm-up included; schedules the rules
        ("vehicles", np.int64),  # slots in use
        ("next_identity", np.int32),
        # of each agent, of which an ego is the first
        ("controlled", np.int64, (MOST_AGENTS,)),  # slot of its vehicle; -1: it has left
        ("start", np.float64, (MOST_AGENTS,)),  # route coordinate at which it began, m
        ("touched", np.int32, (MOST_AGENTS,)),  # identity of the vehicle it touched, -1 if none
        ("contact", np.int8, (MOST_AGENTS,)),  # its last Contact: which vehicle struck
        ("ended", np.int8, (MOST_AGENTS,)),  # value of `Ending`, from its end on
    ],
    align=True,
)
"""Episode record."""


RESET, DECIDE, DECIDE_AND_RESET, ANNOTATE, SKIP = range(5)
"""Commands for an episode. ANNOTATE computes a decision's results from given snapshots."""


class Buffers(NamedTuple):
    """Arrays that an engine reads and writes, each with one row for an episode.

    Of several agents, observations and results have a row for each agent of an episode in turn.
    """

    episodes: np.ndarray  # EPISODE records, shape (batch,)
    vehicles: np.ndarray  # current records of vehicles, (batch, capacity)
    people: np.ndarray  # current PERSON records, (batch, person)
    # INFLUENCE records of each agent and person in the last decision, (batch, agent, person)
    influences: np.ndarray
    before: np.ndarray  # vehicles at the last decision, (batch, capacity)
    after: np.ndarray  # vehicles after the sub-steps of that decision, (batch, capacity)
    # number of vehicles in `before` and `after`, and the agents' slots, (batch, 1 + agents)
    present: np.ndarray
    reached: np.ndarray  # observation of the state that the decision led to, float32
    observation: np.ndarray  # observation of the current state, which differs after a reset
    signals: np.ndarray  # in the order of `SIGNALS`, unweighted
    rewards: np.ndarray  # r_env and r_social, (batch, 2)
    classical: np.ndarray  # the ego's own reward and its neighbours' mean (thesis A.1), (batch, 2)
    speed: np.ndarray  # the ego's, m/s
    ending: np.ndarray  # values of `Ending`, int8
    contact: np.ndarray  # values of `Contact`, int8: which vehicle struck, if the ego collided
    neighbours_collided: np.ndarray  # number of other vehicles that collided with each other
    braking: np.ndarray  # whether a vehicle's braking was charged to the ego, (batch, capacity)
    trace: np.ndarray  # vehicles after each sub-step, (batch, frames, capacity); empty: untraced
    people_trace: np.ndarray  # people after each sub-step, (batch, frames, person)

    @staticmethod
    def of(
        options: RoadOptions, kind: np.dtype, most: int, size: int, traced: bool = False
    ) -> Buffers:
        """Return empty buffers.

        Args:
            options: Options of the road.
            kind: Record of a vehicle.
            most: Largest number of vehicles of an episode.
            size: Number of episodes.
            traced: Whether there is space for every sub-step.

        Raises:
            UserError: If the size is not positive.
        """
        if size < 1:
            raise UserError(f"size must be at least 1, got {size}")
        rows = (size * options.agents,)
        capacity = size, most
        observed = (*rows, options.observed_rows, len(FEATURES))
        frames = (size if traced else 0, options.frames)
        return Buffers(
            episodes=np.zeros(size, EPISODE),
            vehicles=np.zeros(capacity, kind),
            people=np.zeros((size, options.persons), PERSON),
            influences=np.zeros((size, options.agents, options.persons), INFLUENCE),
            before=np.zeros(capacity, kind),
            after=np.zeros(capacity, kind),
            present=np.zeros((size, 1 + options.agents), np.int64),
            reached=np.zeros(observed, np.float32),
            observation=np.zeros(observed, np.float32),
            signals=np.zeros((*rows, len(SIGNALS))),
            rewards=np.zeros((*rows, 2)),
            classical=np.zeros((*rows, 2)),
            speed=np.zeros(rows),
            ending=np.zeros(rows, np.int8),
            contact=np.zeros(rows, np.int8),
            neighbours_collided=np.zeros(rows, np.int64),
            braking=np.zeros((*rows, most), np.bool_),
            trace=np.zeros((*frames, most), kind),
            people_trace=np.zeros((*frames, options.persons), PERSON),
        )
