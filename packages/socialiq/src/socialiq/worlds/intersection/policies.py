"""Rule-based drivers: reference policies that read the observation only.

They implement `types.Policy`, so they can drive the core and the real highway-env, and be audited.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64

from socialiq.errors import one_of
from socialiq.physics import desired_gap
from socialiq.physics import idm as model
from socialiq.worlds.highway import rules
from socialiq.worlds.highway.core.geometry import VEHICLE_LENGTH
from socialiq.worlds.highway.rules import OfEgos, Rule, RulePolicy, Seen
from socialiq.worlds.intersection import options as scenario

STOP_LINE = 11.0  # m south of the centre
STOP_BEFORE = 11.0  # m before the stop line at which the stopper begins to brake
LOOK_FROM = 20.0  # m before the stop line from which gaps are judged
CONFLICT_REACH = 9.0  # m around the centre that a crossing vehicle must have left or not reached
SAME_LANE = 1.0  # m to the side of the ego within which a vehicle is on its lane

IDM_EXPONENT = 4.0
IDM_GAP = 3.0  # s
IDM_CONE = 0.17  # of the way ahead, to either side: 10 degrees
TARGET_SPEEDS = np.array(scenario.Options().target_speeds)  # m/s


def in_metres(observation: Float[np.ndarray, "batch value"]) -> Seen:
    """Return the vehicles of observations in m and m/s, as `highway.rules.in_metres`."""
    return rules.in_metres(observation, scenario.SIGHT)


def stop_line(vehicles: Seen) -> Int64[np.ndarray, " batch"]:
    """Drive to 11 m before the stop line, then brake and stay."""
    return np.where(_to_stop_line(vehicles) > STOP_BEFORE, scenario.FASTER, scenario.SLOWER)


def gap(seconds: float) -> Rule:
    """Return a rule that enters when no crossing vehicle is within some seconds of the junction."""
    return lambda vehicles: np.where(
        _gives_way(vehicles, seconds), scenario.SLOWER, scenario.FASTER
    )


def idm(vehicles: Seen) -> Int64[np.ndarray, " batch"]:
    """Follow the Intelligent Driver Model, as the drivers of the traffic do.

    To give way, the rule adds a standing vehicle with its rear on the stop line, as is usual for
    this model at a red light. It assumes the default target speeds, and that IDLE keeps the target
    speed nearest to the present speed. It chooses the action whose target speed is nearest to the
    speed of the model a second later, but FASTER only if the model accelerates: a step of 4.5 m/s
    that is rounded up leaves no space to stop behind a crashed vehicle.
    """
    speed = np.hypot(vehicles[:, 0, 3], vehicles[:, 0, 4])
    target = _idm_speed(vehicles)
    level = np.abs(speed[:, None] - TARGET_SPEEDS).argmin(axis=1)
    slower, same, faster = (
        TARGET_SPEEDS[(level + change).clip(0, len(TARGET_SPEEDS) - 1)] for change in (-1, 0, 1)
    )
    held = np.where(target < (slower + same) / 2, scenario.SLOWER, scenario.IDLE)
    return np.where(target >= faster, scenario.FASTER, held)


def _idm_speed(vehicles: Seen) -> OfEgos:
    """Return the model's speed after `rules.STEP`, m/s."""
    speed = np.hypot(vehicles[:, 0, 3], vehicles[:, 0, 4])
    acceleration = _idm_acceleration(speed, *_leader(vehicles))
    stopped = _idm_acceleration(speed, _to_stop_line(vehicles) + VEHICLE_LENGTH / 2, speed)
    waits = _gives_way(vehicles, IDM_GAP)
    return speed + rules.STEP * np.where(waits, np.minimum(acceleration, stopped), acceleration)


def accelerating(name: str, size: int, seed: int = 0) -> Rule:
    """Return a rule as continuous actions; it does not steer.

    `idm` takes the model's acceleration, and `random` draws uniformly, its steering too if actions
    have two numbers. All further rules drive towards 9 m/s where they choose FASTER, and towards 0
    where they choose SLOWER. None of them drives backwards.

    Args:
        name: One of `NAMES`.
        size: Length of an action: 1, or 2 with steering.
        seed: Seed of the draws of `random`.
    """
    if name == "random":
        return rules.random_rule(np.random.default_rng(seed), len(scenario.ACTIONS), size)

    def act(vehicles: Seen) -> Float32[np.ndarray, "batch value"]:
        speed = vehicles[:, 0, 3] * vehicles[:, 0, 5] + vehicles[:, 0, 4] * vehicles[:, 0, 6]
        if name == "idm":
            target = np.maximum(_idm_speed(vehicles), 0.0)
        else:
            target = np.choose(
                _RULES[name](vehicles), [np.zeros_like(speed), speed, TARGET_SPEEDS[-1]]
            )
        return rules.towards(vehicles, target, size)

    return act


def policy(name: str, seed: int = 0, options: scenario.Options | None = None) -> RulePolicy:
    """Return a reference policy.

    Args:
        name: One of `NAMES`.
        seed: Seed of the draws of `random`.
        options: Options of the scenario; None: actions are discrete.

    Raises:
        UserError: If the name is unknown.
    """
    one_of("reference policy", name, NAMES)
    if options is not None and options.continuous:
        return RulePolicy(accelerating(name, options.width, seed), scenario.SIGHT)
    every = _RULES | {
        "random": rules.random_rule(np.random.default_rng(seed), len(scenario.ACTIONS), 0)
    }
    return RulePolicy(every[name], scenario.SIGHT)


_RULES: dict[str, Rule] = {
    "go": lambda vehicles: np.full(len(vehicles), scenario.FASTER),
    "idle": lambda vehicles: np.full(len(vehicles), scenario.IDLE),  # keep the target speed
    "wait": lambda vehicles: np.full(len(vehicles), scenario.SLOWER),
    "stop_line": stop_line,
    "gap_2s": gap(2.0),
    "gap_3s": gap(3.0),
    "gap_4s": gap(4.0),
    "idm": idm,
}
NAMES = (*_RULES, "random")


def _to_stop_line(vehicles: Seen) -> OfEgos:
    """Return the metres from the ego to its stop line; negative beyond it."""
    return vehicles[:, 0, 2] - STOP_LINE


def conflict(vehicles: Seen, seconds: float) -> Bool[np.ndarray, "batch other"]:
    """Whether each vehicle is in the junction, or reaches it soon.

    Vehicles behind the ego on its lane don't count.

    Args:
        vehicles: Observed vehicles, (batch, vehicles, 7), in m and m/s; the first is the ego.
        seconds: Time within which a vehicle at its present speed reaches the junction.

    Returns:
        True for each conflicting vehicle, (batch, vehicles - 1).
    """
    x, y, vx, vy = (vehicles[:, 1:, number] for number in range(1, 5))
    there = vehicles[:, 1:, 0] > 0
    away = np.maximum(np.maximum(np.abs(x), np.abs(y)) - CONFLICT_REACH, 0.0)
    speed = np.hypot(vx, vy)
    approaching = x * vx + y * vy < 0
    soon = approaching & (away < seconds * np.maximum(speed, 0.1))
    behind = (np.abs(x - vehicles[:, :1, 1]) < SAME_LANE) & (y > STOP_LINE)
    return there & ~behind & (soon | (away == 0))


def _gives_way(vehicles: Seen, seconds: float) -> Bool[np.ndarray, " batch"]:
    """Whether the ego is on the last metres of its approach and a vehicle conflicts."""
    distance = _to_stop_line(vehicles)
    judging = (distance > 0) & (distance <= LOOK_FROM)
    return judging & conflict(vehicles, seconds).any(axis=1)


def _leader(vehicles: Seen) -> tuple[OfEgos, OfEgos]:
    """Return the distance of the nearest leader, infinite if none, and the closing speed."""
    ego = vehicles[:, :1]
    cos = ego[..., 5]
    sin = ego[..., 6]
    x = vehicles[:, 1:, 1] - ego[..., 1]
    y = vehicles[:, 1:, 2] - ego[..., 2]
    ahead = x * cos + y * sin
    aside = np.abs(y * cos - x * sin)
    with_it = vehicles[:, 1:, 5] * cos + vehicles[:, 1:, 6] * sin > 0
    on_lane = (np.abs(x) < SAME_LANE) & (vehicles[:, 1:, 2] > CONFLICT_REACH)
    in_cone = (aside < IDM_CONE * ahead) & with_it
    leads = np.where(_to_stop_line(vehicles)[:, None] > 0, on_lane, in_cone)
    gaps = np.where((vehicles[:, 1:, 0] > 0) & leads & (ahead > 0), ahead, np.inf)
    nearest = gaps.argmin(axis=1)[:, None]
    along = vehicles[:, :, 3] * cos + vehicles[:, :, 4] * sin
    closing = along[:, :1] - np.take_along_axis(along[:, 1:], nearest, axis=1)
    return np.take_along_axis(gaps, nearest, axis=1)[:, 0], closing[:, 0]


def _idm_acceleration(speed: OfEgos, gap: OfEgos, closing: OfEgos) -> OfEgos:
    """Return the core's acceleration in m/s²; gaps in m between centres, closing in m/s."""
    driver = scenario.DRIVER
    strongest = driver.max_acceleration
    comfort = driver.comfort_deceleration
    steady = driver.jam_distance + speed * driver.time_headway
    ratio = desired_gap(steady, speed, closing, strongest, comfort) / np.maximum(gap, 0.01)
    return model(1.0 - (speed / TARGET_SPEEDS[-1]) ** IDM_EXPONENT, ratio, strongest)
