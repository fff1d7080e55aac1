"""Seeded episodes on a road: sums, metrics of the thesis, conflict rates, rows of tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64

from socialiq.evaluation.exact import Metrics
from socialiq.evaluation.simulate import Step, play
from socialiq.social.angle import estimate_angle
from socialiq.statistics.intervals import normal_mean, wilson
from socialiq.types import Ending, Policy, RewardPair, Row
from socialiq.worlds.highway.options import SIGNALS, Contact
from socialiq.worlds.highway.world import RoadBatch
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.crosswalk import SIGNALS as PEOPLE
from socialiq.worlds.intersection.options import POSITION_RANGE, SLOWER
from socialiq.worlds.intersection.policies import LOOK_FROM, STOP_LINE
from socialiq.worlds.intersection.world import Batch

STOPPED_BELOW = 0.5  # m/s
KMH = 3.6  # km/h of a m/s
CONFLICT_SECONDS = 3.0  # time within which a crossing vehicle must reach the junction to count
APPROACH_X = 2.0  # m, centre of the ego's approach lane
SIDE_BY_SIDE = 512  # episodes at once; memory doesn't grow with their number


OUTCOMES = {"collision": Ending.COLLISION, "arrival": Ending.ARRIVAL, "timeout": Ending.TIMEOUT}
KINDS = {"at_fault": Contact.EGO_STRUCK, "struck": Contact.EGO_WAS_STRUCK}
"""Kinds of collision: the gap was closed by the ego's motion, or by the other's."""
REWARDS = ("r_env", "r_env_sd", "r_social", "r_social_sd")
_CLASSICAL = ("classical_own", "classical_own_sd", "classical_others", "classical_others_sd")
_COUNTED = ("length", "neighbours_collided", "active", "conflicts", "pressed")
_BOOTSTRAP_SEED = 0  # of the angle's interval


class Episodes(NamedTuple):
    """Results of episodes, one row for each.

    Attributes:
        totals: Sums of r_env and r_social.
        classical: Sums of the ego's own reward and of its neighbours' mean (thesis A.1).
        ending: Values of `Ending`.
        contact: Values of `Contact`.
        length: Decisions.
        speed: Mean speed over the decisions, m/s.
        stopped: Share of the decisions that ended slower than 0.5 m/s.
        neighbours_collided: Number of other vehicles that collided with each other.
        signals: Sum of every signal, unweighted, (episodes, signals).
        active: Decisions in which a signal was not 0, (episodes, signals).
        signal_names: Names of the signals.
        entered: Whether the ego's centre passed its stop line.
        conflicts: Decisions at the junction (`conflicts.at_junction`) while a crossing vehicle
            was in it or within 3 s of it.
        pressed: Number of these decisions in which the ego did not choose slower, or with
            continuous actions not to brake.
        off_road: Whether the ego was off the road after a decision.
    """

    totals: RewardPair
    classical: RewardPair
    ending: Int64[np.ndarray, " episode"]
    contact: Int64[np.ndarray, " episode"]
    length: Int64[np.ndarray, " episode"]
    speed: Float[np.ndarray, " episode"]
    stopped: Float[np.ndarray, " episode"]
    neighbours_collided: Int64[np.ndarray, " episode"]
    signals: Float[np.ndarray, "episode signal"]
    active: Int64[np.ndarray, "episode signal"]
    signal_names: tuple[str, ...]
    entered: Bool[np.ndarray, " episode"]
    conflicts: Int64[np.ndarray, " episode"]
    pressed: Int64[np.ndarray, " episode"]
    off_road: Bool[np.ndarray, " episode"]

    def metrics(self) -> Metrics:
        """Return the metrics of thesis 5.4 (`metrics_of`)."""
        return metrics_of(self)


class RoadEpisodes(NamedTuple):
    """Results of episodes of any road, one row for each; attributes as of `Episodes`."""

    totals: RewardPair
    ending: Int64[np.ndarray, " episode"]
    length: Int64[np.ndarray, " episode"]
    speed: Float[np.ndarray, " episode"]
    stopped: Float[np.ndarray, " episode"]
    off_road: Bool[np.ndarray, " episode"]


def metrics_of(episodes: Episodes | RoadEpisodes) -> Metrics:
    """Return the metrics of thesis 5.4; speed and share stopped are means over episodes."""
    counts = np.bincount(episodes.ending, minlength=len(Ending))
    return Metrics.of(
        totals=RewardPair(episodes.totals.env.mean(), episodes.totals.social.mean()),
        endings=counts / len(episodes.ending),
        mean_speed=float(episodes.speed.mean()),
        stopped=float(episodes.stopped.mean()),
        length=float(episodes.length.mean()),
    )


def road_episodes(
    batch: RoadBatch,
    policy: Policy,
    seeds: Sequence[int] | np.ndarray,
    deterministic: bool = True,
) -> RoadEpisodes:
    """Run one episode of any road for each seed and return its sums; arguments as of `play`.

    Raises:
        UserError: If there are no seeds.
    """
    sums, last = _sums(play(batch, policy, seeds, deterministic), len(seeds), _driven)
    return RoadEpisodes(
        totals=RewardPair(sums["env"], sums["social"]),
        ending=last["ending"],
        length=sums["length"].astype(np.int64),
        speed=sums["speed"] / sums["length"],
        stopped=sums["stopped"] / sums["length"],
        off_road=sums["off_road"] > 0,
    )


def episodes_of(
    batch: Batch, policy: Policy, seeds: Sequence[int] | np.ndarray, deterministic: bool = True
) -> Episodes:
    """Run one episode of the intersection for each seed and return its sums, as `road_episodes`."""
    steps = play(batch, policy, seeds, deterministic)
    return summed(steps, len(seeds), batch.signal_names)


def summed(steps: Iterator[Step], count: int, names: tuple[str, ...] = SIGNALS) -> Episodes:
    """Return the sums of so many episodes of the intersection from their decisions.

    The names are of the signals of their world.
    """

    def quantities(played: Step) -> dict[str, np.ndarray]:
        decisions, rows = played.made, np.flatnonzero(played.running)
        signals = np.stack([decisions.signals[name][rows] for name in names], axis=1)
        conflicts = conflict_at_junction(played.observation[rows])
        action = played.action[rows]  # 0 slows the ego down, or a negative acceleration
        slows = action[:, 0] < 0.0 if action.ndim == 2 else action == SLOWER
        return _driven(played) | {
            "own": decisions.classical.env[rows],
            "others": decisions.classical.social[rows],
            "neighbours_collided": decisions.neighbours_collided[rows],
            "signals": signals,
            "active": signals != 0,
            "beyond": entered(decisions.observation[rows]),
            "conflicts": conflicts,
            "pressed": conflicts & ~slows,
        }

    sums, last = _sums(steps, count, quantities)
    counted = {name: sums[name].astype(np.int64) for name in _COUNTED}
    return Episodes(
        totals=RewardPair(sums["env"], sums["social"]),
        classical=RewardPair(sums["own"], sums["others"]),
        speed=sums["speed"] / sums["length"],
        stopped=sums["stopped"] / sums["length"],
        signals=sums["signals"],
        signal_names=names,
        entered=sums["beyond"] > 0,
        off_road=sums["off_road"] > 0,
        **last,
        **counted,
    )


def _sums(
    steps: Iterator[Step], count: int, quantities: Callable[[Step], dict[str, np.ndarray]]
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the sums of quantities over each episode, and its last ending and contact."""
    sums: dict[str, np.ndarray] = {}
    last = {name: np.zeros(count, np.int64) for name in ("ending", "contact")}
    for played in steps:
        which = played.episode[played.running]
        for name, column in quantities(played).items():
            if name not in sums:
                sums[name] = np.zeros((count, *column.shape[1:]))
            sums[name][which] += column
        for name, column in last.items():
            column[which] = getattr(played.made, name)[played.running]
    return sums, last


def _driven(played: Step) -> dict[str, np.ndarray]:
    """Quantities of any road that are summed over an episode, of the rows that decided."""
    decisions, rows = played.made, np.flatnonzero(played.running)
    return {
        "env": decisions.rewards.env[rows],
        "social": decisions.rewards.social[rows],
        "length": np.ones(len(rows)),
        "speed": decisions.speed[rows],
        "stopped": decisions.speed[rows] < STOPPED_BELOW,
        "off_road": decisions.off_road[rows],
    }


def entered(observation: Float32[np.ndarray, "batch feature"]) -> Bool[np.ndarray, " batch"]:
    """Whether the ego's centre has passed its stop line."""
    return _metres(observation[:, 2]) < STOP_LINE


def at_junction(observation: Float32[np.ndarray, "batch feature"]) -> Bool[np.ndarray, " batch"]:
    """Whether the ego is in the junction, or no more than `LOOK_FROM` before its stop line."""
    x, y = _metres(observation[:, 1]), _metres(observation[:, 2])
    return (np.abs(x) <= STOP_LINE) & (y >= -STOP_LINE) & (y <= STOP_LINE + LOOK_FROM)


def conflict(
    observation: Float32[np.ndarray, "batch feature"], seconds: float
) -> Bool[np.ndarray, " batch"]:
    """Whether a crossing vehicle is in the junction, or will be there in so many seconds.

    The rule-based drivers of `policies.gap` use the same criterion. The ego may be anywhere.
    """
    vehicles = policies.in_metres(observation)
    # A follower doesn't cross, even if the ego has left the shared lane.
    vehicles[:, 0, 1] = APPROACH_X
    return np.any(policies.conflict(vehicles, seconds), axis=1)


def conflict_at_junction(
    observation: Float32[np.ndarray, "batch feature"],
) -> Bool[np.ndarray, " batch"]:
    """Whether the ego is at the junction and has a conflict within `CONFLICT_SECONDS` there."""
    conflicting = at_junction(observation)
    near = np.flatnonzero(conflicting)
    conflicting[near] = conflict(observation[near], CONFLICT_SECONDS)
    return conflicting


def _metres(position: Float32[np.ndarray, " batch"]) -> Float[np.ndarray, " batch"]:
    return position.astype(np.float64) * POSITION_RANGE


def conflict_rates(episodes: Episodes, confidence: float = 0.95) -> dict[str, float | int | None]:
    """Return rates of the ego's collisions, at fault and struck, per episode, entry and conflict.

    A policy that never enters the junction has no collisions there, so its rate per episode is no
    evidence about its driving. An episode or an entry is a trial: its share has a Wilson interval,
    `_low` and `_high`. Conflicts are decisions and not independent, so a rate per conflict has
    none; it divides the collisions of all episodes by the conflicts of all episodes. Collisions of
    an episode without entry don't count per entry. A rate over nothing is None.
    """
    entered = episodes.entered
    rates: dict[str, float | int | None] = {
        "episodes": len(entered),
        "entries": int(entered.sum()),
        "conflicts": int(episodes.conflicts.sum()),
        "pressed": int(episodes.pressed.sum()),
    }
    for kind, contact in KINDS.items():
        collided = episodes.contact == contact
        count, inside = int(collided.sum()), int((collided & entered).sum())
        rates[kind] = count
        rates |= _share(f"{kind}_per_episode", count, len(entered), confidence)
        rates |= _share(f"{kind}_per_entry", inside, int(entered.sum()), confidence)
        for exposure, met in (("conflict", episodes.conflicts), ("pressed", episodes.pressed)):
            rates[f"{kind}_per_{exposure}"] = count / int(met.sum()) if met.any() else None
    return rates


def _share(name: str, count: int, trials: int, confidence: float) -> dict[str, float | None]:
    share = wilson(count, trials, confidence) if trials else (None, None, None)
    return dict(zip((name, f"{name}_low", f"{name}_high"), share, strict=True))


def policy_row(policy: str, readout: str, episodes: Episodes, off_road: bool = False) -> Row:
    """Return every metric of thesis 5.4 of a named policy, and its collisions by exposure."""
    outcome, reward = outcome_row(episodes, off_road), reward_row(episodes)
    angle = estimate_angle(*episodes.totals, seed=_BOOTSTRAP_SEED)
    row = {"policy": policy, "readout": readout} | outcome
    row |= {name: reward[name] for name in (*REWARDS, *_CLASSICAL)}
    row |= {"angle": angle.angle, "angle_low": angle.low, "angle_high": angle.high}
    row |= {
        name: "" if value is None else value
        for name, value in conflict_rates(episodes).items()
        if name not in row and name not in ("at_fault", "struck")
    }
    return row | on_foot_row(episodes)


def on_foot_row(episodes: Episodes) -> Row:
    """Return what happened to people by class, with intervals; nothing where no person walks.

    They are the seconds that they lost and would not have without the ego, and the share of
    episodes in which the ego hit a person.
    """
    sums, row = dict(zip(episodes.signal_names, episodes.signals.T, strict=True)), Row()
    for kind in PEOPLE:
        if (delay := sums.get(f"{kind}_delay")) is not None:
            hit = int(sums[f"{kind}_hit"].sum())
            row |= normal_mean(f"{kind}_delay", delay) if len(delay) > 1 else {}
            row |= _share(f"{kind}_hit", hit, len(delay), 0.95)
    return row


def outcome_row(episodes: Episodes, off_road: bool = False) -> Row:
    """Return rates with Wilson intervals, off the road too if asked for, contacts and speeds."""
    count, length = len(episodes.ending), episodes.length
    row: Row = {"episodes": count}
    happened = {name: episodes.ending == kind for name, kind in OUTCOMES.items()}
    happened |= {"off_road": episodes.off_road} if off_road else {}
    for name, which in happened.items():
        share = wilson(int(which.sum()), count)
        row |= {name: share.value, f"{name}_low": share.low, f"{name}_high": share.high}
    return row | {
        "ego_struck": float((episodes.contact == Contact.EGO_STRUCK).mean()),
        "ego_was_struck": float((episodes.contact == Contact.EGO_WAS_STRUCK).mean()),
        "neighbours_collided": float(episodes.neighbours_collided.mean()),
        "length": float(length.mean()),
        "speed_kmh": KMH * float(episodes.speed.mean()),
        "speed_kmh_of_steps": KMH * float((episodes.speed * length).sum() / length.sum()),
        "stopped": float(episodes.stopped.mean()),
        "stopped_of_steps": float((episodes.stopped * length).sum() / length.sum()),
    }


def reward_row(episodes: Episodes) -> Row:
    """Return totals of an episode, and the share of decisions in which each signal is not 0."""
    metrics, steps = episodes.metrics(), episodes.length.sum()
    active = episodes.active.sum(axis=0) / steps
    return {
        "r_env": metrics.r_env,
        "r_env_sd": float(episodes.totals.env.std()),
        "r_social": metrics.r_social,
        "r_social_sd": float(episodes.totals.social.std()),
        **{name: getattr(metrics, name) for name in ("angle", *OUTCOMES)},
        **{
            f"{name}_active": float(share)
            for name, share in zip(episodes.signal_names, active, strict=True)
        },
        "classical_own": float(episodes.classical.env.mean()),
        "classical_own_sd": float(episodes.classical.env.std()),
        "classical_others": float(episodes.classical.social.mean()),
        "classical_others_sd": float(episodes.classical.social.std()),
    }
