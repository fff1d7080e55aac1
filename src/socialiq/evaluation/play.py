"""Seeded episodes of a batch, each with its own seed, whatever the size of the batch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64

from socialiq.errors import UserError
from socialiq.evaluation.metrics import Metrics
from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.intersection.batch import Batch, Decisions

STOPPED_BELOW = 0.5  # m/s


class Played(NamedTuple):
    """One decision of the episodes that are running.

    Attributes:
        episode: Which episode each row of the batch is playing.
        running: Rows that decided.
        observation: What they saw, of all rows.
        action: What they did, of all rows.
        made: What came of it, of all rows.
    """

    episode: Int64[np.ndarray, " batch"]
    running: Bool[np.ndarray, " batch"]
    observation: Float32[np.ndarray, "batch feature"]
    action: Int64[np.ndarray, " batch"]
    made: Decisions


def play(
    batch: Batch, policy: Policy, seeds: Sequence[int] | np.ndarray, deterministic: bool = True
) -> Iterator[Played]:
    """Let a policy drive one episode for each seed.

    Rows take the next seed as they become free, so the batch stays full until seeds run out.

    Args:
        batch: Where to play.
        policy: Who decides, for the whole batch at once.
        seeds: One for each episode.
        deterministic: Passed to the policy.

    Raises:
        UserError: If there is no seed.
    """
    wanted = np.asarray(seeds)
    if not len(wanted):
        raise UserError("episodes must be at least 1, got 0")
    episode = np.arange(batch.size)
    running = episode < len(wanted)
    observation = batch.reset(wanted[: running.sum()], rows=running)
    following = int(running.sum())
    while running.any():
        action = np.asarray(policy.predict(observation, deterministic=deterministic)[0], np.int64)
        made = batch.step(action, auto_reset=False, rows=running)
        yield Played(episode.copy(), running.copy(), observation, action, made)
        ended = running & (made.ending != int(Ending.NONE))
        free = np.flatnonzero(ended)
        reused = free[: max(len(wanted) - following, 0)]
        running[np.setdiff1d(free, reused)] = False
        episode[reused] = following + np.arange(len(reused))
        if len(reused):
            batch.reset(wanted[episode[reused]], rows=reused)
        following += len(reused)
        observation = batch.observation


class Episodes(NamedTuple):
    """What became of each episode.

    Attributes:
        totals: Sums of r_env and r_social.
        classical: Sums of the ego's own reward and of its neighbours' mean (thesis A.1).
        ending: Values of `Ending`.
        contact: Values of `Contact`.
        length: Decisions.
        speed: Mean speed over the decisions, m/s.
        stopped: Share of the decisions that ended slower than 0.5 m/s.
        neighbours_collided: Vehicles that ran into one another.
        signals: Sum of every signal, unweighted, (episodes, signals).
        active: Decisions in which a signal was not 0, (episodes, signals).
        signal_names: Names of the signals.
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

    def metrics(self) -> Metrics:
        """The metrics of thesis 5.4; speed and share stopped are means over episodes."""
        counts = np.bincount(self.ending, minlength=len(Ending))
        return Metrics.of(
            totals=RewardPair(self.totals.env.mean(), self.totals.social.mean()),
            endings=counts / len(self.ending),
            mean_speed=float(self.speed.mean()),
            stopped=float(self.stopped.mean()),
            length=float(self.length.mean()),
        )


def episodes_of(
    batch: Batch, policy: Policy, seeds: Sequence[int] | np.ndarray, deterministic: bool = True
) -> Episodes:
    """Play one episode for each seed and sum it up.

    Args:
        batch: Where to play.
        policy: Who decides.
        seeds: One for each episode.
        deterministic: Passed to the policy.

    Raises:
        UserError: If there is no seed.
    """
    count = len(seeds)
    sums: dict[str, np.ndarray] = {name: np.zeros(count) for name in _SUMMED}
    last = {name: np.zeros(count, np.int64) for name in ("ending", "contact")}
    names: tuple[str, ...] = ()
    signals = active = np.zeros((count, 0))
    for played in play(batch, policy, seeds, deterministic):
        made, rows = played.made, played.running
        which = played.episode[rows]
        names = names or tuple(made.signals)
        values = np.stack([made.signals[name][rows] for name in names], axis=1)
        if not signals.shape[1]:
            signals, active = np.zeros((count, len(names))), np.zeros((count, len(names)))
        signals[which] += values
        active[which] += values != 0
        for name, column in _quantities(made).items():
            sums[name][which] += column[rows]
        last["ending"][which] = made.ending[rows]
        last["contact"][which] = made.contact[rows]
    length = sums["length"]
    return Episodes(
        totals=RewardPair(sums["env"], sums["social"]),
        classical=RewardPair(sums["own"], sums["others"]),
        ending=last["ending"],
        contact=last["contact"],
        length=length.astype(np.int64),
        speed=sums["speed"] / length,
        stopped=sums["stopped"] / length,
        neighbours_collided=sums["neighbours_collided"].astype(np.int64),
        signals=signals,
        active=active.astype(np.int64),
        signal_names=names,
    )


_SUMMED = (
    "env",
    "social",
    "own",
    "others",
    "length",
    "speed",
    "stopped",
    "neighbours_collided",
)


def _quantities(made: Decisions) -> dict[str, np.ndarray]:
    return {
        "env": made.rewards.env,
        "social": made.rewards.social,
        "own": made.classical.env,
        "others": made.classical.social,
        "length": np.ones(len(made.ending)),
        "speed": made.speed,
        "stopped": made.speed < STOPPED_BELOW,
        "neighbours_collided": made.neighbours_collided,
    }
