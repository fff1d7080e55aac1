"""The thesis' three experts and the demonstrations collected from them (5.2)."""

from __future__ import annotations

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.rollout import rollout_table
from socialiq.worlds.enumerate import Table
from socialiq.worlds.experts import expert_policy

MODES = {"egoistic": 0.0, "prosocial": 45.0, "altruistic": 90.0}


def expert_pools(table: Table, episodes: dict[str, int], seed: int) -> dict[str, Demonstrations]:
    """Roll out each expert in the stochastic world.

    Args:
        table: The world with all its states.
        episodes: Number of episodes by mode.
        seed: Each mode draws from a stream of its own.

    Returns:
        One pool by mode.
    """
    pools = {}
    for number, (mode, angle) in enumerate(MODES.items()):
        source = {"expert": "value iteration, deterministic variant", "angle": angle}
        pools[mode] = rollout_table(
            table,
            expert_policy(table, angle),
            episodes[mode],
            seed=len(MODES) * seed + number,
            mode=mode,
            source=source,
        ).transitions
    return pools
