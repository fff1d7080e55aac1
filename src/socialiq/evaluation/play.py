"""Seeded episodes of a batch, each with its own seed, whatever the size of the batch."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64

from socialiq.errors import UserError
from socialiq.evaluation.conflicts import conflict_at_junction, entered
from socialiq.evaluation.metrics import Metrics
from socialiq.statistics.intervals import wilson
from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.intersection.batch import Batch, Decisions
from socialiq.worlds.intersection.policies import SLOWER
from socialiq.worlds.intersection.settings import SIGNALS
from socialiq.worlds.intersection.state import Contact

STOPPED_BELOW = 0.5  # m/s
SOFT = 4172  # key of this purpose; draws for other purposes from the same seed are independent


class Played(NamedTuple):
    """Decision of the running episodes.

    Attributes:
        episode: Index of the episode of each row of the batch.
        running: Rows that decided.
        observation: Observations before the decision, of all rows.
        action: Actions, of all rows.
        made: Results of the decision, of all rows.
    """

    episode: Int64[np.ndarray, " batch"]
    running: Bool[np.ndarray, " batch"]
    observation: Float32[np.ndarray, "batch feature"]
    action: Int64[np.ndarray, " batch"]
    made: Decisions


@runtime_checkable
class SoftPolicy(Policy, Protocol):
    """Protocol of a policy with action probabilities, such as `nn.q_policy.QPolicy`."""

    def probabilities(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Return the probability of each action."""
        ...


def play(
    batch: Batch, policy: Policy, seeds: Sequence[int] | np.ndarray, deterministic: bool = True
) -> Iterator[Played]:
    """Run one episode for each seed.

    Rows take the next seed as they become free, so the batch stays full until seeds run out. A
    `SoftPolicy` that is not deterministic draws by the episode's seed, so its episodes don't
    depend on the batch. (A network's float32 products may: their last bits change with the number
    of rows, which changes a draw about once in a million decisions.)

    Args:
        batch: Where to play.
        policy: Policy that decides for the whole batch at once.
        seeds: One for each episode.
        deterministic: Whether it takes its best action; a policy without `probabilities` is told.

    Raises:
        UserError: If there is no seed.
    """
    wanted = np.asarray(seeds)
    if not len(wanted):
        raise UserError("episodes must be at least 1, got 0")
    driver = _driver(batch, policy, deterministic)
    episode = np.arange(batch.size)
    running = episode < len(wanted)
    begun, following = np.flatnonzero(running), int(running.sum())
    while running.any():
        if len(begun):
            batch.reset(wanted[episode[begun]], rows=begun)
            driver.begin(begun, wanted[episode[begun]])
        observation = batch.observation
        action = driver.decide(observation)
        made = batch.step(action, auto_reset=False, rows=running)
        yield Played(episode.copy(), running.copy(), observation, action, made)
        free = np.flatnonzero(running & (made.ending != int(Ending.NONE)))
        begun = free[: max(len(wanted) - following, 0)]
        running[np.setdiff1d(free, begun)] = False
        episode[begun] = following + np.arange(len(begun))
        following += len(begun)


def _driver(batch: Batch, policy: Policy, deterministic: bool) -> _Direct | _Drawn:
    if not deterministic and isinstance(policy, SoftPolicy):
        decisions = math.ceil(batch.options.duration * batch.options.policy_frequency) + 1
        return _Drawn(policy, batch.size, decisions)
    return _Direct(policy, deterministic)


class _Direct:
    """Policy that draws its actions itself, if at all."""

    def __init__(self, policy: Policy, deterministic: bool) -> None:
        self._policy, self._deterministic = policy, deterministic

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Do nothing: the policy has no state by episode."""

    def decide(self, observation: np.ndarray) -> Int64[np.ndarray, " batch"]:
        chosen, _ = self._policy.predict(observation, deterministic=self._deterministic)
        return np.asarray(chosen, np.int64)


class _Drawn:
    """Soft policy; every episode has its own uniform numbers for all its decisions."""

    def __init__(self, policy: SoftPolicy, size: int, decisions: int) -> None:
        self._policy, self._rows = policy, np.arange(size)
        self._uniform = np.zeros((size, decisions))
        self._made = np.zeros(size, np.int64)

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        decisions = self._uniform.shape[1]
        for row, seed in zip(rows, seeds.tolist(), strict=True):
            self._uniform[row] = np.random.default_rng([SOFT, seed]).random(decisions)
        self._made[rows] = 0

    def decide(self, observation: np.ndarray) -> Int64[np.ndarray, " batch"]:
        cumulative = self._policy.probabilities(observation).cumsum(axis=1)
        draws = self._uniform[self._rows, self._made][:, None]
        # Rows whose episode is over are included; their actions are not used.
        self._made = np.minimum(self._made + 1, self._uniform.shape[1] - 1)
        chosen = (draws >= cumulative).sum(axis=1)
        return np.minimum(chosen, cumulative.shape[1] - 1).astype(np.int64)


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
        pressed: Number of these decisions in which the ego did not choose slower.
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

    def metrics(self) -> Metrics:
        """Return the metrics of thesis 5.4; speed and share stopped are means over episodes."""
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
    """Run one episode for each seed and return its sums.

    Args:
        batch: Where to play.
        policy: Who decides.
        seeds: One for each episode.
        deterministic: See `play`.

    Raises:
        UserError: If there is no seed.
    """
    sums: dict[str, np.ndarray] = {}
    last = {name: np.zeros(len(seeds), np.int64) for name in ("ending", "contact")}
    for played in play(batch, policy, seeds, deterministic):
        which = played.episode[played.running]
        for name, column in _quantities(played).items():
            if name not in sums:
                sums[name] = np.zeros((len(seeds), *column.shape[1:]))
            sums[name][which] += column
        for name, column in last.items():
            column[which] = getattr(played.made, name)[played.running]
    counted = {name: sums[name].astype(np.int64) for name in _COUNTED}
    return Episodes(
        totals=RewardPair(sums["env"], sums["social"]),
        classical=RewardPair(sums["own"], sums["others"]),
        speed=sums["speed"] / sums["length"],
        stopped=sums["stopped"] / sums["length"],
        signals=sums["signals"],
        signal_names=SIGNALS,
        entered=sums["beyond"] > 0,
        **last,
        **counted,
    )


_COUNTED = ("length", "neighbours_collided", "active", "conflicts", "pressed")


def _quantities(played: Played) -> dict[str, np.ndarray]:
    """Return the quantities that are summed over an episode, of the rows that decided."""
    made, rows = played.made, np.flatnonzero(played.running)
    signals = np.stack([made.signals[name][rows] for name in SIGNALS], axis=1)
    conflicts = conflict_at_junction(played.observation[rows])
    return {
        "env": made.rewards.env[rows],
        "social": made.rewards.social[rows],
        "own": made.classical.env[rows],
        "others": made.classical.social[rows],
        "length": np.ones(len(rows)),
        "speed": made.speed[rows],
        "stopped": made.speed[rows] < STOPPED_BELOW,
        "neighbours_collided": made.neighbours_collided[rows],
        "signals": signals,
        "active": signals != 0,
        "beyond": entered(made.observation[rows]),
        "conflicts": conflicts,
        "pressed": conflicts & (played.action[rows] != SLOWER),
    }


KINDS = {"at_fault": Contact.EGO_STRUCK, "struck": Contact.EGO_WAS_STRUCK}
"""Kinds of collision, by whose motion closed the gap: the ego's, or the other's."""


def conflict_rates(episodes: Episodes, confidence: float = 0.95) -> dict[str, float | int | None]:
    """Return rates of the ego's collisions, at fault and struck, per episode, entry and conflict.

    A policy that never enters the junction has no collisions there, so its rate per episode says
    nothing about its driving. An episode or an entry is a trial: its share has a Wilson interval.
    Conflicts are decisions and not independent, so a rate per conflict has none; it divides the
    collisions of all episodes by the conflicts of all episodes.

    Args:
        episodes: Results of the episodes.
        confidence: Confidence level of the intervals.

    Returns:
        Counts `episodes`, `entries`, `conflicts`, `pressed`, and for each of `KINDS` its count,
        `KIND_per_episode` and `KIND_per_entry` with `_low` and `_high`, `KIND_per_conflict` and
        `KIND_per_pressed`. Collisions of an episode without entry don't count per entry. A rate
        over nothing is None.
    """
    entered = episodes.entered
    found: dict[str, float | int | None] = {
        "episodes": len(entered),
        "entries": int(entered.sum()),
        "conflicts": int(episodes.conflicts.sum()),
        "pressed": int(episodes.pressed.sum()),
    }
    for kind, contact in KINDS.items():
        collided = episodes.contact == contact
        count, inside = int(collided.sum()), int((collided & entered).sum())
        found[kind] = count
        found |= _share(f"{kind}_per_episode", count, len(entered), confidence)
        found |= _share(f"{kind}_per_entry", inside, int(entered.sum()), confidence)
        for exposure, met in (("conflict", episodes.conflicts), ("pressed", episodes.pressed)):
            found[f"{kind}_per_{exposure}"] = count / int(met.sum()) if met.any() else None
    return found


def _share(name: str, count: int, trials: int, confidence: float) -> dict[str, float | None]:
    share = wilson(count, trials, confidence) if trials else (None, None, None)
    return dict(zip((name, f"{name}_low", f"{name}_high"), share, strict=True))
