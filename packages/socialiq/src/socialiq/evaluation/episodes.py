"""Seeded episodes on a road: measures of the intersection, conflict rates, rows of tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float, Float32

from socialiq.evaluation.measures import DECISION, Episodes, Quantity, columns_of, share, summary
from socialiq.evaluation.simulate import Step, play
from socialiq.social.angle import estimate_angle
from socialiq.types import Policy, Row
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.options import POSITION_RANGE, SLOWER
from socialiq.worlds.intersection.policies import LOOK_FROM, STOP_LINE
from socialiq.worlds.road_users import ROAD_USERS
from socialiq.worlds.world import Simulator

KMH = 3.6  # km/h of a m/s
CONFLICT_SECONDS = 3.0  # time within which a crossing vehicle must reach the junction to count
APPROACH_X = 2.0  # m, centre of the ego's approach lane
SIDE_BY_SIDE = 512  # episodes at once; memory doesn't grow with their number


OUTCOMES = ("collision", "arrival", "timeout")
KINDS = ("at_fault", "struck")
"""Kinds of collision."""
REWARDS = ("r_env", "r_env_sd", "r_social", "r_social_sd")
_CLASSICAL = ("classical_own", "classical_own_sd", "classical_others", "classical_others_sd")
_BOOTSTRAP_SEED = 0  # of the angle's interval


def episodes_of(
    batch: Simulator,
    policy: Policy,
    seeds: Sequence[int] | np.ndarray,
    deterministic: bool = True,
    quantities: Mapping[str, Quantity] | None = None,
) -> Episodes:
    """Run one episode for each seed and return its quantities.

    Args:
        batch: Episodes of any world.
        policy: Policy that drives.
        seeds: Seed of each episode.
        deterministic: Whether the policy takes its best action; see `play`.
        quantities: Quantities of a decision, as `DECISION` on any road; by default those of the
            intersection, `AT_INTERSECTION`.

    Raises:
        UserError: If there are no seeds.
    """
    steps = play(batch, policy, seeds, deterministic)
    return columns_of(steps, len(seeds), quantities or AT_INTERSECTION)


def entered(observation: Float32[np.ndarray, "batch feature"]) -> Bool[np.ndarray, " batch"]:
    """Whether the ego's centre has passed its stop line."""
    return _metres(observation[:, 2]) < STOP_LINE


def at_junction(observation: Float32[np.ndarray, "batch feature"]) -> Bool[np.ndarray, " batch"]:
    """Whether the ego is in the junction, or no more than `LOOK_FROM` before its stop line."""
    x = _metres(observation[:, 1])
    y = _metres(observation[:, 2])
    return (np.abs(x) <= STOP_LINE) & (y >= -STOP_LINE) & (y <= STOP_LINE + LOOK_FROM)


def conflict(
    observation: Float32[np.ndarray, "batch feature"], seconds: float
) -> Bool[np.ndarray, " batch"]:
    """Whether a crossing vehicle is in the junction, or will be in it soon.

    The rule-based drivers of `policies.gap` use the same criterion. The ego may be anywhere.

    Args:
        observation: Observations of the intersection.
        seconds: Time within which a vehicle arrives soon, s.
    """
    vehicles = policies.in_metres(observation)
    # A follower doesn't cross, even if the ego has left the shared lane.
    vehicles[:, 0, 1] = APPROACH_X
    return np.any(policies.conflict(vehicles, seconds), axis=1)


def conflict_at_junction(
    observation: Float32[np.ndarray, "batch feature"],
    counted: bool | Bool[np.ndarray, " batch"] = True,
) -> Bool[np.ndarray, " batch"]:
    """Whether the ego is at the junction and has a conflict within `CONFLICT_SECONDS`.

    Args:
        observation: Observations of the intersection.
        counted: Rows that are examined; the result is false elsewhere.
    """
    conflicting = at_junction(observation) & counted
    near = np.flatnonzero(conflicting)
    conflicting[near] = conflict(observation[near], CONFLICT_SECONDS)
    return conflicting


def _metres(position: Float32[np.ndarray, " batch"]) -> Float[np.ndarray, " batch"]:
    return position.astype(np.float64) * POSITION_RANGE


def _presses_on(step: Step) -> Bool[np.ndarray, " row"]:
    """Whether the ego has a conflict and does not slow down."""
    slows = step.action[:, 0] < 0.0 if step.action.ndim == 2 else step.action == SLOWER
    return conflict_at_junction(step.rows, ~slows)


AT_INTERSECTION = DECISION | {
    "entered": Quantity("", lambda step: entered(step.reached), "any"),
    "conflicts": Quantity("decisions", lambda step: conflict_at_junction(step.rows), "count"),
    "pressed": Quantity("decisions", _presses_on, "count"),
}
"""Quantities of a decision at the intersection: whether the ego's centre has passed its stop line;
decisions at the junction (`at_junction`) while a crossing vehicle was in it or within 3 s of it;
those of them in which the ego did not choose slower, or with continuous actions not to brake."""


def conflict_rates(episodes: Episodes, confidence: float = 0.95) -> Row:
    """Return rates of the ego's collisions, at fault and struck, per episode, entry and conflict.

    A policy that never enters the junction has no collisions in it, so its rate per episode is no
    evidence about its driving. An episode or an entry is a trial: its share has a Wilson interval,
    `_low` and `_high`. Conflicts are decisions and not independent, so a rate per conflict has
    none; it divides the collisions of all episodes by the conflicts of all episodes. Collisions of
    an episode without entry don't count per entry.

    Args:
        episodes: Episodes of a policy.
        confidence: Probability of the intervals.

    Returns:
        Counts and rates by name. A rate without trials or conflicts is None.
    """
    row: Row = {
        "episodes": len(episodes.entered),
        "entries": int(episodes.entered.sum()),
        "conflicts": int(episodes.conflicts.sum()),
        "pressed": int(episodes.pressed.sum()),
    }
    for kind in KINDS:
        collided = episodes[kind]
        count = int(collided.sum())
        row[kind] = count
        row |= share(f"{kind}_per_episode", collided, confidence)
        row |= share(f"{kind}_per_entry", collided[episodes.entered], confidence)
        for exposure, column in (("conflict", "conflicts"), ("pressed", "pressed")):
            row[f"{kind}_per_{exposure}"] = count / row[column] if row[column] else None
    return row


def policy_row(policy: str, readout: str, episodes: Episodes, off_road: bool = False) -> Row:
    """Return every metric of thesis 5.4 of a named policy.

    At the intersection it has the collisions by exposure too.

    Args:
        policy: Name of the policy.
        readout: Name of its readout.
        episodes: Its episodes.
        off_road: Whether the rate of leaving the road is included.

    Returns:
        A row of a table; an unknown rate is an empty text.
    """
    outcome = outcome_row(episodes, off_road)
    reward = reward_row(episodes)
    angle = estimate_angle(*episodes.totals, seed=_BOOTSTRAP_SEED)
    row = {"policy": policy, "readout": readout} | outcome
    row |= {name: reward[name] for name in (*REWARDS, *_CLASSICAL) if name in reward}
    row |= {"angle": angle.angle, "angle_low": angle.low, "angle_high": angle.high}
    rates = conflict_rates(episodes) if "entered" in episodes else {}
    row |= {
        name: "" if value is None else value
        for name, value in rates.items()
        if name not in row and name not in ("at_fault", "struck")
    }
    return row | on_foot_row(episodes)


def on_foot_row(episodes: Episodes) -> Row:
    """Return what happened to people by class, with intervals; an empty row where no person walks.

    They are the seconds that they lost and would not have without the ego, and the share of
    episodes in which the ego hit a person; at recorded junctions, where people are replayed, the
    hits alone, and the mean number of others that hit a person.
    """
    row = Row()
    for user in ROAD_USERS:
        if f"signal_{user.name}_hit" in episodes:
            has_delay = f"signal_{user.name}_delay" in episodes and len(episodes.ending) > 1
            delay = (f"{user.name}_delay",) if has_delay else ()
            row |= summary(episodes, (*delay, f"{user.name}_hit"))
    for signal, column in episodes.items():
        name = signal.removeprefix("signal_")
        if signal != name and name.endswith("_hit") and name not in row:
            row[name] = float(column.mean())
    return row


def outcome_row(episodes: Episodes, off_road: bool = False) -> Row:
    """Return rates of the endings with Wilson intervals, contacts and speeds.

    Args:
        episodes: Episodes of a policy.
        off_road: Whether the rate of leaving the road is included.

    Returns:
        A row of a table; speeds are in km/h, `length` in decisions. Those of steps weigh each
        episode by its decisions.
    """
    length = episodes.length
    row: Row = {"episodes": len(length)}
    row |= summary(episodes, (*OUTCOMES, "off_road") if off_road else OUTCOMES)
    return row | {
        "ego_struck": float(episodes.at_fault.mean()),
        "ego_was_struck": float(episodes.struck.mean()),
        "neighbours_collided": float(episodes.neighbours_collided.mean()),
        "length": float(length.mean()),
        "speed_kmh": KMH * float(episodes.speed.mean()),
        "speed_kmh_of_steps": KMH * float((episodes.speed * length).sum() / length.sum()),
        "stopped": float(episodes.stopped.mean()),
        "stopped_of_steps": float((episodes.stopped * length).sum() / length.sum()),
    }


def reward_row(episodes: Episodes) -> Row:
    """Return totals of an episode, and the share of decisions in which each signal is not 0.

    Totals of the classical rewards are left out where a world has none.
    """
    metrics = episodes.metrics()
    steps = episodes.length.sum()
    row: Row = {}
    for name in ("r_env", "r_social"):
        row |= {name: getattr(metrics, name), f"{name}_sd": float(episodes[name].std())}
    row |= {name: getattr(metrics, name) for name in ("angle", *OUTCOMES)}
    for name, column in episodes.items():
        if name.startswith("active_"):
            row[f"{name.removeprefix('active_')}_active"] = float(column.sum() / steps)
    has_classical = any(name.startswith("classical") for name in episodes)
    for name in ("classical_own", "classical_others") if has_classical else ():
        row |= {name: float(episodes[name].mean()), f"{name}_sd": float(episodes[name].std())}
    return row
