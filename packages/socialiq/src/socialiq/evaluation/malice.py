"""Malicious demonstrators, by the reward that they maximise, and what they write as labels.

In a gridworld they are exact optima. On a road they are planners: before each decision they try
every action in copies of the episode, held for some decisions, and take the one that pays most.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Int64

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import concatenate
from socialiq.demonstrations.trust import Consistency
from socialiq.errors import UserError
from socialiq.evaluation.branching import rollouts
from socialiq.evaluation.rollout import rollout_table, transitions_of
from socialiq.evaluation.simulate import ScriptedActor, simulate
from socialiq.mdp.horizon import horizon_optimum
from socialiq.types import Ending, RewardPair
from socialiq.worlds.enumerate import Table
from socialiq.worlds.highway.batch import RoadBatch
from socialiq.worlds.highway.world import RoadWorld

Malice = Callable[[Any, Any, Any], Any]
"""(r_env, r_social, share of collisions of the ego) of a step -> the reward of malice."""

ATTACKERS: Mapping[str, Malice] = {
    "hater": lambda _env, social, _collision: -social,
    "rammer": lambda _env, _social, collision: 10.0 * collision - 0.01,
}
"""Losses of others, or a collision as soon as possible."""

MODE = "malicious"
HELD = 4  # decisions for which a planner tries an action
ABREAST = 64  # episodes side by side


def attacked_table(table: Table, malice: Malice, episodes: int, seed: int) -> Demonstrations:
    """Return episodes of the policy that is best for an attacker, with honest labels.

    Args:
        table: The gridworld with all its states.
        malice: Reward of the attacker.
        episodes: Number of episodes.
        seed: Seed of chance.

    Raises:
        UserError: If its reward is the same whatever it does: the world can't show this malice.
    """
    mdp = table.mdp
    collision = (mdp.probability * (mdp.ending == Ending.COLLISION)).sum(axis=-1)
    reward = np.asarray(malice(mdp.rewards.env, mdp.rewards.social, collision), np.float64)
    reward = np.broadcast_to(reward, mdp.rewards.env.shape)
    part = mdp.reachable_part()[1]
    if np.ptp(reward[part]) == 0.0:
        raise UserError(
            f"nothing in this {table.world.name} pays this attacker; in crossing7 the ego can "
            "collide with --set braking=one_level"
        )
    policy = horizon_optimum(mdp, reward, table.world.horizon).probabilities(mdp.n_actions)
    return rollout_table(table, policy, episodes, seed, MODE).transitions


def attacked_road(
    world: RoadWorld,
    malice: Malice,
    seeds: Sequence[int] | np.ndarray,
    source: Mapping[str, Any],
) -> Demonstrations:
    """Return an episode of an attacker's planner for each seed, with honest labels.

    Args:
        world: The road.
        malice: Reward of the attacker.
        seeds: Seed of each episode.
        source: Provenance to record, which names the world.
    """
    blocks = []
    for block in np.array_split(np.asarray(seeds), -(-len(seeds) // ABREAST)):
        batch = world.batch(len(block))
        actor = ScriptedActor(
            lambda _time, _observation, running, batch=batch: _planned(batch, malice, running)
        )
        columns, _ = transitions_of(simulate(batch, actor, block))
        driven = {**source, "first_seed": int(block[0]), "episodes": len(block)}
        blocks.append(
            Demonstrations.of(
                **columns, mode_names=(MODE,), n_actions=world.n_actions, source=driven
            )
        )
    return concatenate(blocks)


def _planned(
    batch: RoadBatch, malice: Malice, running: Bool[np.ndarray, " row"]
) -> Int64[np.ndarray, " row"]:
    """Return the action that pays most if it is held, of each row."""
    rows = np.flatnonzero(running)
    actions = batch.n_actions
    copies = batch.branch(np.repeat(rows, actions))
    held = np.tile(np.arange(actions), len(rows))
    total = np.zeros(len(held))
    tried = rollouts(copies, held, np.ones(len(held), bool), lambda copy: held[copy])
    for _, (decided, result) in zip(range(HELD), tried, strict=False):
        collided = result.ending == Ending.COLLISION
        reward = malice(result.rewards.env, result.rewards.social, collided)
        total[decided] += reward[decided]
    best = np.zeros(len(running), np.int64)
    best[rows] = total.reshape(-1, actions).argmax(axis=1)
    return best


def forged(data: Demonstrations, check: Consistency | None = None) -> Demonstrations:
    """Return the episodes with ``|r_env|`` and ``|r_social|`` as labels: all looks good.

    Args:
        data: Episodes with honest labels.
        check: Check of these episodes that an adaptive forger knows; its labels go as far as the
            limits of the check permit. None for a forger that knows none.
    """
    labels = [np.abs(label) for label in data.rewards]
    if check is not None:
        ranges = zip(labels, check.expected.T, 0.99 * check.limit, strict=True)
        labels = [np.clip(label, at - limit, at + limit) for label, at, limit in ranges]
    return dataclasses.replace(data, rewards=RewardPair(*labels))


def poisoned(honest: Demonstrations, malicious: Demonstrations, seed: int) -> Demonstrations:
    """Return a table of as many episodes as the honest one, of which malicious ones take a place.

    Args:
        honest: Episodes of honest drivers.
        malicious: Episodes that take the place of as many honest ones.
        seed: Seed of the draw of the honest episodes that stay.

    Raises:
        UserError: If there are more malicious episodes than honest ones.
    """
    left = honest.n_episodes - malicious.n_episodes
    if left < 1:
        raise UserError("no honest episode is left: choose a smaller share")
    kept = np.sort(np.random.default_rng(seed).permutation(honest.n_episodes)[:left])
    return concatenate([honest.select(kept), malicious])
