"""Demonstrations of the thesis' three experts (5.2)."""

from __future__ import annotations

from collections.abc import Sequence

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import equal_trajectories, equal_transitions
from socialiq.evaluation.rollout import rollout_table
from socialiq.worlds.enumerate import Table, expert_policy

MODES = {"egoistic": 0.0, "prosocial": 45.0, "altruistic": 90.0}


def demonstrations_by_mode(
    table: Table, episodes: dict[str, int], seed: int
) -> dict[str, Demonstrations]:
    """Roll out each expert in the stochastic world.

    Args:
        table: The world with all its states.
        episodes: Number of episodes by mode.
        seed: Seed; each mode has its own stream.

    Returns:
        Demonstrations of each mode.
    """
    demonstrations = {}
    for number, (mode, angle) in enumerate(MODES.items()):
        source = {"expert": "value iteration, deterministic variant", "angle": angle}
        demonstrations[mode] = rollout_table(
            table,
            expert_policy(table, angle),
            episodes[mode],
            seed=len(MODES) * seed + number,
            mode=mode,
            source=source,
        ).transitions
    return demonstrations


def trajectory_datasets(
    table: Table, seeds: Sequence[int], episodes_each: int
) -> list[Demonstrations]:
    """Return, for each seed, a mixture with equal numbers of new episodes of every expert (5.2)."""
    return [
        equal_trajectories(
            demonstrations_by_mode(table, dict.fromkeys(MODES, episodes_each), seed),
            episodes_each,
            seed,
        )
        for seed in seeds
    ]


def transition_datasets(
    table: Table, seeds: Sequence[int], transitions_each: int
) -> list[Demonstrations]:
    """Return, for each seed, a mixture with equal numbers of transitions of every expert (6.3)."""
    enough = dict.fromkeys(MODES, transitions_each)  # an episode has at least one transition
    return [
        equal_transitions(demonstrations_by_mode(table, enough, seed), transitions_each, seed)
        for seed in seeds
    ]
