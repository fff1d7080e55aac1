"""Seeded episodes of a road: driven, or recorded as demonstrations."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float32

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.simulate import Actor, SoftActor, SoftPolicy, Step, simulate
from socialiq.types import Policy, RewardPair
from socialiq.worlds.highway.episodes import RoadBatch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.world import Decisions


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
