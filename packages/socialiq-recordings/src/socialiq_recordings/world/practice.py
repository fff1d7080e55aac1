"""Dials that practise at a recorded junction: they drive in it and learn again from what they met.

The world, its drivers and the demonstrations come from recordings alone. The first dial learns
from the recorded drivers; each round the dials drive episodes at several angles, some decisions
drawn at random, and new dials learn from the recorded drivers and all practice so far (growing
batch learning: Lange, Gabel and Riedmiller 2012).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Int64

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import concatenate
from socialiq.errors import UserError
from socialiq.evaluation.rollout import transitions_of
from socialiq.evaluation.simulate import ScriptedActor, simulate
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.config import OfflineDialConfig, OfflineDialHyperparameters
from socialiq.learners.dial.offline import train
from socialiq.learners.kernel import Trained
from socialiq.learners.settings import check_counts, check_seed, check_shares
from socialiq.types import Policy
from socialiq_recordings.world.recorded_world import RecordedWorld
from socialiq_recordings.world.replay import MADE_BY

ANGLES = 7  # angles at which a dial practises, from its least to its largest


@dataclass(frozen=True)
class Practice:
    """Amount of practice."""

    rounds: int  # times that dials drive and learn again; 0: from the demonstrations alone
    episodes: int = 100  # of each dial in a round, at each of `ANGLES` angles
    exploration: float = 0.1  # share of decisions that are drawn at random
    first_seed: int = 65_000_000  # seed of the first episode

    def __post_init__(self) -> None:
        """Refuse counts, shares or seeds out of their ranges."""
        check_counts(self, ("episodes",))
        check_shares(self, ("exploration",))
        check_seed(self.first_seed)
        if self.rounds < 0:
            raise UserError(f"rounds of practice must be 0 or more, got {self.rounds}")

    @property
    def span(self) -> int:
        """Seeds that a dial uses; the next one's begin behind them."""
        return self.rounds * ANGLES * self.episodes


@dataclass(frozen=True)
class Practised:
    """Outcome of a training with practice."""

    stages: dict[str, Trained]  # outcome of each stage of the last training, by its name
    driven: list[list[Demonstrations]]  # episodes that each run has driven, of each round


def train_with_practice(
    world: RecordedWorld,
    static: OfflineDialConfig,
    hyperparameters: Sequence[OfflineDialHyperparameters],
    demonstrations: Demonstrations,
    practice: Practice,
    callbacks: Callable[[int, str], Callbacks] | None = None,
    chunk: int = 500,
) -> Practised:
    """Train dials on demonstrations of a world, and again after each round of practice in it.

    Each training begins with new weights, and each run practises on separate episodes.

    Args:
        world: World of recorded junctions.
        static: What all runs share.
        hyperparameters: Hyperparameters of each run.
        demonstrations: Demonstrations from which all runs learn.
        practice: Amount of practice.
        callbacks: Function of the number of practised rounds and the name of a stage; it returns
            what that stage of training calls. None for no calls.
        chunk: Number of updates between calls.

    Returns:
        The outcome of the last training, and the episodes that each run has driven.

    Raises:
        UserError: If demonstrations of recorded drivers meet a world that rewards what is caused,
            or as `learners.dial.offline.train` raises it.
    """
    if world.effects and demonstrations.source.get("made_by") == MADE_BY:
        raise UserError(
            "demonstrations of recorded drivers have the rewards of Eq 4.2, not of what is caused: "
            "give episodes of this world (`socialiq collect WORLD --driver POLICY`)"
        )
    driven: list[list[Demonstrations]] = [[] for _ in hyperparameters]

    def learn(number: int) -> dict[str, Trained]:
        data = [
            concatenate([demonstrations, *tables]) if tables else demonstrations
            for tables in driven
        ]
        of_stage = functools.partial(callbacks, number) if callbacks else None
        return train(static, hyperparameters, data, of_stage, chunk)

    stages = learn(0)
    for number in range(1, practice.rounds + 1):
        for run, tables in enumerate(driven):
            dial = stages["dial"].policy(run)
            angles = np.linspace(static.low, static.high, ANGLES).tolist()
            drivers = {f"practice {number} at {a:g}": dial.at(a) for a in angles}
            first = practice.first_seed + run * practice.span
            first += (number - 1) * ANGLES * practice.episodes
            tables.append(record(world, drivers, practice.episodes, practice.exploration, first))
        stages = learn(number)
    return Practised(stages, driven)


def record(
    world: RecordedWorld,
    drivers: Mapping[str, Policy],
    episodes: int,
    share: float,
    first_seed: int,
) -> Demonstrations:
    """Record policies, a mode for each name, each on separate episodes.

    The random decisions come from one stream for all episodes of a policy.

    Args:
        world: World of recorded junctions.
        drivers: Policies by the names of their modes.
        episodes: Number of episodes of each policy.
        share: Share of the decisions that are drawn at random, in [0, 1].
        first_seed: Seed of the first episode of the first policy; seeds go up by one.

    Returns:
        All episodes in one table, in the order of the policies.
    """
    tables = []
    for number, (name, policy) in enumerate(drivers.items()):
        seeds = np.arange(episodes) + first_seed + number * episodes
        actor = ScriptedActor(_exploring(policy, world.n_actions, share, int(seeds[0])))
        columns, _ = transitions_of(simulate(world.batch(episodes), actor, seeds))
        names: dict[str, Any] = {"mode_names": (name,), "n_actions": world.n_actions}
        names["source"] = {"made_by": "practice", "first_seed": first_seed, "share": share}
        tables.append(Demonstrations.of(**columns, **names))
    return concatenate(tables)


def _exploring(
    policy: Policy, n_actions: int, share: float, seed: int
) -> Callable[[int, np.ndarray, np.ndarray], Int64[np.ndarray, " row"]]:
    rng = np.random.default_rng(seed)

    def decide(_time: int, observation: np.ndarray, running: np.ndarray) -> np.ndarray:
        actions = rng.integers(n_actions, size=len(running))
        chosen, _ = policy.predict(observation)
        return np.where(rng.random(len(running)) < share, actions, np.asarray(chosen))

    return decide
