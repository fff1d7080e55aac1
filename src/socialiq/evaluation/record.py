"""Episodes of the intersection as demonstrations: the extended tuples of thesis 5.2."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.play import play
from socialiq.types import Policy, RewardPair
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.state import ACTIONS


class Recorded(NamedTuple):
    """Demonstrations, with the classical rewards for comparison.

    Attributes:
        transitions: One row for each decision.
        classical: The ego's own reward and its neighbours' mean (thesis A.1), each (transition,).
    """

    transitions: Demonstrations
    classical: RewardPair


def record(
    batch: Batch,
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
        n_actions=len(ACTIONS),
        source={"first_seed": int(np.min(seeds)), "episodes": len(seeds), **(source or {})},
    )
    return Recorded(transitions, RewardPair(kept["own"], kept["others"]))
