"""Rule-based drivers of roads: reference policies that read the observation only.

They implement `types.Policy`. Those of the intersection, which know its arms, are in
`intersection.policies`; here are those of the scenes of highway-env.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64

from socialiq.errors import one_of
from socialiq.physics import desired_gap
from socialiq.physics import idm as model
from socialiq.types import Memoryless
from socialiq.worlds.highway import options as roads
from socialiq.worlds.highway.options import ACCELERATION_RANGE, FEATURES, RoadOptions
from socialiq.worlds.highway.scenes import Scene

Seen = Float[np.ndarray, "batch vehicle feature"]
Chosen = Int64[np.ndarray, " batch"] | Float32[np.ndarray, "batch value"]
Rule = Callable[[Seen], Chosen]
OfEgos = Float[np.ndarray, " batch"]

LOOK_FROM = 20.0  # m before the circle or the crossing from which gaps are judged
STOP_BEFORE = 3.0  # m before it at which the stopper wants to stand
INSIDE = 2.0  # m within the stop lines at which a vehicle is on the crossing
RING = 4.0  # m, width of the circle's lanes beyond its inner radius, and as much outside
LANE = 2.0  # m to the side of the ego within which a vehicle is on its lane
BEYOND = 15.0  # m along a circle of later traffic beyond the ego's arm where it may meet vehicles
CONE = 0.5  # of the way ahead, to either side, and least cosine of the angle to a leader
GAP = 3.0  # s, of the follower
STEP = 1.0  # s in which an ego with continuous actions gets to the speed it aims at
GAPS = {"gap_2s": 2.0, "gap_3s": 3.0, "gap_4s": 4.0}


def in_metres(observation: Float[np.ndarray, "batch value"], sight: np.ndarray) -> Seen:
    """Return the vehicles of observations, one row of features each, in m and m/s.

    Rows of people on foot, whose presence is their class, count as empty. Places and velocities
    of others are absolute, also where they are observed relative to the ego.

    Args:
        observation: Observations.
        sight: Their scales, a SIGHT record in an array of one.
    """
    shape = len(observation), observation.shape[1] // len(FEATURES), len(FEATURES)
    vehicles = observation.reshape(shape).astype(np.float64)
    for number, name in enumerate(("x", "y", "vx", "vy"), 1):
        vehicles[..., number] *= float(sight[name][0])
    vehicles[..., 0] *= vehicles[..., 0] <= 1.0
    if sight["relative"][0]:
        vehicles[:, 1:, 1:5] += vehicles[:, :1, 1:5]
    return vehicles


class RulePolicy(Memoryless):
    """Policy defined by a rule.

    The rule is a function from observed vehicles, (batch, vehicles, 7), in m and m/s, to actions:
    numbers, or vectors in [-1, 1].
    """

    reads_rows = True  # whatever the world's schema of observations is

    def __init__(self, rule: Rule, sight: np.ndarray) -> None:
        self._rule = rule
        self._sight = sight

    def choose(self, observation: np.ndarray, _deterministic: bool, /) -> np.ndarray:
        """Choose actions for one observation or a batch of them.

        Args:
            observation: Observation, (feature,) or (batch, feature); a time at the end is not used.

        Returns:
            One action, or one for each observation of the batch.
        """
        rows = np.atleast_2d(np.asarray(observation, np.float64))
        whole = rows.shape[1] - rows.shape[1] % len(FEATURES)  # without the time
        actions = self._rule(in_metres(rows[:, :whole], self._sight))
        return actions if np.ndim(observation) > 1 else np.asarray(actions[0])


def towards(
    vehicles: Seen, speed: OfEgos | float, width: int
) -> Float32[np.ndarray, "batch value"]:
    """Return continuous actions that lead to a speed within `STEP`, without steering.

    Args:
        vehicles: Observed vehicles, in m and m/s.
        speed: Speed of each ego, m/s.
        width: Length of an action: 1, or 2 with steering.
    """
    now = vehicles[:, 0, 3] * vehicles[:, 0, 5] + vehicles[:, 0, 4] * vehicles[:, 0, 6]
    chosen = np.zeros((len(vehicles), width), np.float32)
    chosen[:, 0] = ((speed - now) / STEP / ACCELERATION_RANGE[1]).clip(-1.0, 1.0)
    return chosen


def random_rule(rng: np.random.Generator, count: int, width: int) -> Rule:
    """Return a rule that draws actions.

    Args:
        rng: Generator of the draws.
        count: Number of discrete actions.
        width: Length of a continuous action; 0: actions are discrete.
    """
    if not width:
        return lambda vehicles: rng.integers(count, size=len(vehicles))
    return lambda vehicles: rng.uniform(-1.0, 1.0, (len(vehicles), width)).astype(np.float32)


def names_of(scene: Scene) -> tuple[str, ...]:
    """Return the names of a scene's rules; those that give way need a place to give way at."""
    yields = ("stop_line", *GAPS) if scene.circle or scene.edge else ()
    return ("go", "idle", "wait", *yields, "idm", "random")


def policy(name: str, scene: Scene, options: RoadOptions, seed: int = 0) -> RulePolicy:
    """Return a rule-based driver of a scene.

    With continuous actions it drives towards the fastest target speed where it chooses `faster`,
    and towards 0 where it chooses `slower`; it does not steer.

    Args:
        name: One of `names_of`.
        scene: The scene.
        options: Its options, whose target speeds the follower knows.
        seed: Seed of the random driver.
    """
    one_of(f"driver of {scene.name}", name, names_of(scene))
    rng = np.random.default_rng(seed)
    speeds = np.array(options.target_speeds)

    def stop_line(vehicles: Seen) -> Int64[np.ndarray, " batch"]:
        left = _to_entry(vehicles, scene) - STOP_BEFORE
        return np.where((left > 0) & (left > _speed(vehicles)), 1, -1)

    def follow(vehicles: Seen) -> Int64[np.ndarray, " batch"]:
        waits = _gives_way(vehicles, scene, GAP)
        return np.where(waits, -1, _followed(vehicles, scene, speeds))

    steps: dict[str, Callable[[Seen], Int64[np.ndarray, " batch"]]] = {
        "go": lambda vehicles: np.full(len(vehicles), 1),
        "idle": lambda vehicles: np.full(len(vehicles), 0),
        "wait": lambda vehicles: np.full(len(vehicles), -1),
        "stop_line": stop_line,
        "idm": follow,
    }
    for gap, seconds in GAPS.items():
        steps[gap] = partial(_wait_for_gap, scene=scene, seconds=seconds)
    actions = [scene.actions.index(word) for word in ("slower", "idle", "faster")]

    def act(vehicles: Seen) -> Chosen:
        step = steps[name](vehicles)
        if not options.continuous:
            return np.choose(step + 1, actions)
        aims: Any = [0.0, _speed(vehicles), speeds[-1]]
        target = np.choose(step + 1, aims)
        if name == "idm":
            followed, _ = _followed_speed(vehicles, scene, speeds)
            waits = _gives_way(vehicles, scene, GAP)
            target = np.where(waits, 0.0, np.maximum(followed, 0.0))
        return towards(vehicles, target, options.width)

    rule = random_rule(rng, len(scene.actions), options.width) if name == "random" else act
    return RulePolicy(rule, scene.road.sight)


def _wait_for_gap(vehicles: Seen, scene: Scene, seconds: float) -> Int64[np.ndarray, " batch"]:
    """Return the step of target speed, -1 to give way, else 1."""
    return np.where(_gives_way(vehicles, scene, seconds), -1, 1)


def _speed(vehicles: Seen) -> OfEgos:
    return np.hypot(vehicles[:, 0, 3], vehicles[:, 0, 4])


def _to_entry(vehicles: Seen, scene: Scene) -> OfEgos:
    """Return the metres from the ego to the circle's outer edge or the stop line; negative within.

    On the way out of a road with later traffic the result is negative too.
    """
    edge = scene.edge or scene.circle + 2 * RING
    away = np.hypot(vehicles[:, 0, 1], vehicles[:, 0, 2]) - edge
    inwards = (vehicles[:, 0, 1:3] * vehicles[:, 0, 5:7]).sum(axis=1) < 0
    return np.where(inwards | (len(scene.road.arrivals) == 0), away, -np.inf)


def _gives_way(vehicles: Seen, scene: Scene, seconds: float) -> Bool[np.ndarray, " batch"]:
    """Whether the ego is before a circle or a crossing that another vehicle is about to use."""
    if not (scene.circle or scene.edge):
        return np.zeros(len(vehicles), bool)
    before = _to_entry(vehicles, scene)
    comes = (_on_circle if scene.circle else _on_crossing)(vehicles, scene, seconds)
    there = vehicles[:, 1:, 0] > 0
    return (before > 0) & (before <= LOOK_FROM) & (there & comes).any(axis=1)


def _on_circle(vehicles: Seen, scene: Scene, seconds: float) -> Bool[np.ndarray, "batch other"]:
    """Whether each vehicle on the circle passes the ego's entry within some seconds.

    Vehicles drive round the circle from south to east, so one that comes has a larger angle,
    clockwise as drawn, than the ego; in left-hand traffic a smaller one.
    """
    x, y, vx, vy = (vehicles[:, 1:, number] for number in range(1, 5))
    radius = np.hypot(x, y)
    entry = np.arctan2(vehicles[:, 0, 2], vehicles[:, 0, 1])[:, None]
    side = scene.road.sight["side_x"] * scene.road.sight["side_y"]
    beyond = BEYOND * (len(scene.road.arrivals) > 0)
    turned = side * (np.arctan2(y, x) - entry) + beyond / scene.circle
    behind = np.mod(turned, 2 * np.pi) * radius - beyond  # m along the circle
    soon = behind < np.maximum(np.hypot(vx, vy), 1.0) * seconds
    return (radius < scene.circle + 2 * RING) & soon


def _on_crossing(vehicles: Seen, scene: Scene, seconds: float) -> Bool[np.ndarray, "batch other"]:
    """Whether each vehicle is on the crossing, or reaches it within some seconds.

    Vehicles on the ego's approach don't count.
    """
    x, y, vx, vy = (vehicles[:, 1:, number] for number in range(1, 5))
    away = np.maximum(np.hypot(x, y) - (scene.edge - INSIDE), 0.0)
    approaching = x * vx + y * vy < 0
    soon = approaching & (away < seconds * np.maximum(np.hypot(vx, vy), 0.1))
    beside_ego = (np.abs(x - vehicles[:, :1, 1]) < LANE) & (y > scene.edge)
    return ~beside_ego & (soon | (away == 0))


def _followed(vehicles: Seen, scene: Scene, speeds: np.ndarray) -> Int64[np.ndarray, " batch"]:
    """Return the step of target speed, -1 to 1, of the Intelligent Driver Model.

    The leader is the nearest vehicle ahead on the lane. The step leads to the target speed nearest
    to the speed of the model a second later. It goes faster only if the model reaches the next one.
    """
    target, is_free = _followed_speed(vehicles, scene, speeds)
    level = np.abs(_speed(vehicles)[:, None] - speeds).argmin(axis=1)
    slower, same, faster = (
        speeds[(level + change).clip(0, len(speeds) - 1)] for change in (-1, 0, 1)
    )
    held = np.where(target < (slower + same) / 2, -1, 0)
    return np.where((target >= faster) | is_free, 1, held)


def _followed_speed(
    vehicles: Seen, scene: Scene, speeds: np.ndarray
) -> tuple[OfEgos, Bool[np.ndarray, " batch"]]:
    """Return the model's speed a second later, m/s, and whether it accelerates without a leader."""
    cos = vehicles[:, :1, 5]
    sin = vehicles[:, :1, 6]
    x = vehicles[:, 1:, 1] - vehicles[:, :1, 1]
    y = vehicles[:, 1:, 2] - vehicles[:, :1, 2]
    ahead = x * cos + y * sin
    aside = np.abs(y * cos - x * sin)
    leads = (vehicles[:, 1:, 0] > 0) & (ahead > 0)
    if len(scene.road.arrivals):  # its ways across are bent
        across = (_to_entry(vehicles, scene) <= 0)[:, None]
        with_it = vehicles[:, 1:, 5] * cos + vehicles[:, 1:, 6] * sin > CONE
        leads &= with_it & (aside < np.where(across, np.maximum(CONE * ahead, LANE), LANE))
    else:
        leads &= aside < LANE
    gaps = np.where(leads, ahead, np.inf)
    nearest = gaps.argmin(axis=1)[:, None]
    gap = np.maximum(np.take_along_axis(gaps, nearest, axis=1)[:, 0], 0.01)
    speed = _speed(vehicles)
    along = vehicles[:, 1:, 3] * cos + vehicles[:, 1:, 4] * sin
    closing = speed - np.take_along_axis(along, nearest, axis=1)[:, 0]
    driver = roads.DRIVER
    strongest = driver.max_acceleration
    steady = driver.jam_distance + speed * driver.time_headway
    wanted = desired_gap(steady, speed, closing, strongest, driver.comfort_deceleration)
    free = 1.0 - (speed / speeds[-1]) ** roads.EXPONENT
    target = speed + model(free, wanted / gap, strongest)
    return target, (free > 0) & np.isinf(gap)
