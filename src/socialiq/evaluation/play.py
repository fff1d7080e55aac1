"""Seeded episodes of a road: driven, summed up, or recorded as demonstrations."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.conflicts import conflict_at_junction, entered
from socialiq.evaluation.metrics import Metrics
from socialiq.evaluation.simulate import Actor, SoftActor, SoftPolicy, Step, simulate
from socialiq.statistics.intervals import wilson
from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.highway.episodes import Decisions, RoadBatch
from socialiq.worlds.highway.settings import SIGNALS
from socialiq.worlds.highway.state import Contact
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import SLOWER
from socialiq.worlds.intersection.world import Intersection

STOPPED_BELOW = 0.5  # m/s


class BatchSimulator:
    """A compiled road as a back end of `simulate`."""

    def __init__(self, batch: RoadBatch) -> None:
        self.batch, self.size = batch, batch.size

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Reset some rows."""
        self.batch.reset(seeds, rows=rows)

    def observe(self) -> Float32[np.ndarray, "batch feature"]:
        """Return the observations of all egos."""
        return self.batch.observation

    def step(self, action: np.ndarray, running: np.ndarray) -> Decisions:
        """Take a decision in the running rows."""
        return self.batch.step(action, auto_reset=False, rows=running)


class BatchActor:
    """A policy that acts for all rows at once; a stochastic one has its own random numbers."""

    def __init__(self, policy: Policy, deterministic: bool) -> None:
        self._policy, self._deterministic = policy, deterministic

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Do nothing: the policy has no state."""

    def decide(
        self,
        observation: np.ndarray,
        running: np.ndarray,  # noqa: ARG002
    ) -> np.ndarray:
        """Return the policy's actions: numbers, (batch,), or continuous ones, (batch, values)."""
        chosen = np.asarray(self._policy.predict(observation, deterministic=self._deterministic)[0])
        return chosen if chosen.ndim == 2 else chosen.astype(np.int64)


class TimedActor:
    """Actor whose policy may take the time as a last feature (`Batch.seen_by`).

    Args:
        actor: Actor of the policy.
        policy: The policy.
        batch: Batch of episodes that is driven.
    """

    def __init__(self, actor: Actor, policy: Policy, batch: RoadBatch) -> None:
        self._actor, self._policy, self._batch = actor, policy, batch

    def begin(self, rows: np.ndarray, seeds: np.ndarray) -> None:
        """Pass on that an episode begins in each of some rows."""
        self._actor.begin(rows, seeds)

    def decide(
        self,
        observation: np.ndarray,  # noqa: ARG002  the batch has it
        running: np.ndarray,
    ) -> np.ndarray:
        """Return the policy's actions."""
        return self._actor.decide(self._batch.seen_by(self._policy), running)


def play(
    batch: RoadBatch, policy: Policy, seeds: Sequence[int] | np.ndarray, deterministic: bool = True
) -> Iterator[Step]:
    """Run a policy on one episode of a road for each seed.

    The time is a last feature of the input if the policy has one feature more than the world.
    A `SoftPolicy` that is not deterministic draws by the episode's seed, so its episodes don't
    depend on the batch (`SoftActor`).

    Args:
        batch: Batch of episodes to drive.
        policy: Policy of the whole batch.
        seeds: Seed of each episode.
        deterministic: Whether it takes its best action; passed to policies without `probabilities`.

    Raises:
        UserError: If there are no seeds.
    """
    return simulate(BatchSimulator(batch), actor_of(batch, policy, deterministic), seeds)


def actor_of(batch: RoadBatch, policy: Policy, deterministic: bool = True) -> Actor:
    """Return the actor of a policy that drives a batch, as in `play`."""
    actor: Actor = BatchActor(policy, deterministic)
    if not deterministic and isinstance(policy, SoftPolicy):
        decisions = math.ceil(batch.options.duration * batch.options.policy_frequency) + 1
        actor = SoftActor(policy, batch.size, decisions)
    return TimedActor(actor, policy, batch)


def sees_time(policy: Any, options: Options) -> bool:
    """Whether a policy has one feature more than the intersection shows, which is the time."""
    return getattr(policy, "n_features", None) == Intersection(options).n_features + 1


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
        """Return the metrics of thesis 5.4; speed and share stopped are means over episodes."""
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
    """Run one episode for each seed and return its sums.

    Args:
        batch: Batch of episodes to drive.
        policy: Policy of the whole batch.
        seeds: Seed of each episode.
        deterministic: As for `play`.

    Raises:
        UserError: If there are no seeds.
    """
    return summed(play(batch, policy, seeds, deterministic), len(seeds))


def summed(steps: Iterator[Step], count: int) -> Episodes:
    """Return the sums of episodes of the intersection from their decisions.

    Args:
        steps: Result of `play`.
        count: Number of episodes.
    """
    sums, last = _sums(steps, count, _quantities)
    counted = {name: sums[name].astype(np.int64) for name in _COUNTED}
    return Episodes(
        totals=RewardPair(sums["env"], sums["social"]),
        classical=RewardPair(sums["own"], sums["others"]),
        speed=sums["speed"] / sums["length"],
        stopped=sums["stopped"] / sums["length"],
        signals=sums["signals"],
        signal_names=SIGNALS,
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


def slowing(action: np.ndarray) -> Bool[np.ndarray, " row"]:
    """Whether actions slow the ego down: number 0, or a negative acceleration."""
    return action[:, 0] < 0.0 if action.ndim == 2 else action == SLOWER


_COUNTED = ("length", "neighbours_collided", "active", "conflicts", "pressed")


def _driven(played: Step) -> dict[str, np.ndarray]:
    """Quantities of any road that are summed over an episode, of the rows that decided."""
    made, rows = played.made, np.flatnonzero(played.running)
    return {
        "env": made.rewards.env[rows],
        "social": made.rewards.social[rows],
        "length": np.ones(len(rows)),
        "speed": made.speed[rows],
        "stopped": made.speed[rows] < STOPPED_BELOW,
        "off_road": made.off_road[rows],
    }


def _quantities(played: Step) -> dict[str, np.ndarray]:
    """Quantities of the intersection that are summed over an episode, of the rows that decided."""
    made, rows = played.made, np.flatnonzero(played.running)
    signals = np.stack([made.signals[name][rows] for name in SIGNALS], axis=1)
    conflicts = conflict_at_junction(played.observation[rows])
    return _driven(played) | {
        "own": made.classical.env[rows],
        "others": made.classical.social[rows],
        "neighbours_collided": made.neighbours_collided[rows],
        "signals": signals,
        "active": signals != 0,
        "beyond": entered(made.observation[rows]),
        "conflicts": conflicts,
        "pressed": conflicts & ~slowing(played.action[rows]),
    }


KINDS = {"at_fault": Contact.EGO_STRUCK, "struck": Contact.EGO_WAS_STRUCK}
"""Kinds of collision: the gap was closed by the ego's motion, or by the other's."""


def conflict_rates(episodes: Episodes, confidence: float = 0.95) -> dict[str, float | int | None]:
    """Return rates of the ego's collisions, at fault and struck, per episode, entry and conflict.

    A policy that never enters the junction has no collisions there, so its rate per episode is no
    evidence about its driving. An episode or an entry is a trial: its share has a Wilson interval.
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


class Recorded(NamedTuple):
    """Demonstrations, with the classical rewards for comparison.

    Attributes:
        transitions: One row for each decision.
        classical: The ego's own reward and its neighbours' mean (thesis A.1), each (transition,).
    """

    transitions: Demonstrations
    classical: RewardPair


def record(
    batch: RoadBatch,
    policy: Policy,
    seeds: Sequence[int] | np.ndarray,
    mode: str,
    source: Mapping[str, Any] | None = None,
) -> Recorded:
    """Run one greedy episode for each seed, and record every transition.

    Args:
        batch: Batch of episodes to drive.
        policy: Policy of the ego.
        seeds: Seed of each episode.
        mode: Name of the driver mode to record.
        source: Provenance to record.

    Raises:
        UserError: If there is no seed.
    """
    rows: list[dict[str, np.ndarray]] = []
    for played in play(batch, policy, seeds):
        made, running = played.made, played.running
        columns = {
            "episode": played.episode,
            "observation": played.observation,
            "action": played.action,
            "after": made.observation,
            "ending": made.ending,
            "env": made.rewards.env,
            "social": made.rewards.social,
            "own": made.classical.env,
            "others": made.classical.social,
        }
        rows.append({name: column[running] for name, column in columns.items()})
    joined = {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}
    order = np.argsort(joined["episode"], kind="stable")
    kept = {name: column[order] for name, column in joined.items()}
    transitions = Demonstrations.of(
        observation=kept["observation"],
        action=kept["action"],
        next_observation=kept["after"],
        ending=kept["ending"],
        rewards=RewardPair(kept["env"], kept["social"]),
        episode=kept["episode"],
        mode_names=(mode,),
        n_actions=0 if batch.options.continuous else batch.n_actions,
        source={"first_seed": int(np.min(seeds)), "episodes": len(seeds), **(source or {})},
    )
    return Recorded(transitions, RewardPair(kept["own"], kept["others"]))
