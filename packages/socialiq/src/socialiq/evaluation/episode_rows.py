"""Rows of tables from episodes on the road: outcomes, rewards, angle and collisions by exposure."""

from __future__ import annotations

from socialiq.evaluation.episodes import Episodes, conflict_rates
from socialiq.social.angle import estimate_angle
from socialiq.statistics.intervals import wilson
from socialiq.types import Ending, Row
from socialiq.worlds.highway.options import Contact

OUTCOMES = {"collision": Ending.COLLISION, "arrival": Ending.ARRIVAL, "timeout": Ending.TIMEOUT}
KMH = 3.6  # km/h of a m/s
_BOOTSTRAP_SEED = 0  # of the angle's interval
REWARDS = ("r_env", "r_env_sd", "r_social", "r_social_sd")
_CLASSICAL = ("classical_own", "classical_own_sd", "classical_others", "classical_others_sd")


def policy_row(policy: str, readout: str, episodes: Episodes, off_road: bool = False) -> Row:
    """Return every metric of thesis 5.4 of one policy, and its collisions by exposure.

    Args:
        policy: Its name.
        readout: How it chooses, greedy or soft.
        episodes: Results of its episodes.
        off_road: As of `outcome_row`.
    """
    outcome, reward = outcome_row(episodes, off_road), reward_row(episodes)
    angle = estimate_angle(*episodes.totals, seed=_BOOTSTRAP_SEED)
    row = {"policy": policy, "readout": readout} | outcome
    row |= {name: reward[name] for name in (*REWARDS, *_CLASSICAL)}
    row |= {"angle": angle.angle, "angle_low": angle.low, "angle_high": angle.high}
    return row | {
        name: "" if value is None else value
        for name, value in conflict_rates(episodes).items()
        if name not in row and name not in ("at_fault", "struck")
    }


def outcome_row(episodes: Episodes, off_road: bool = False) -> Row:
    """Return rates with Wilson intervals, contacts, length and speeds.

    Args:
        episodes: Results of the episodes.
        off_road: Whether to add the share of episodes in which the ego left the road.
    """
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
