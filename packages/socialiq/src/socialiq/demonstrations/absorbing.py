"""Demonstrations as `worlds.absorbing.AbsorbingStates` would have given them."""

from __future__ import annotations

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair


def with_absorbing_states(shown: Demonstrations, stay: int = 1) -> Demonstrations:
    """Return the same episodes, with terminal states as absorbing ones (Kostrikov et al. 2019).

    Observations get a last number, 1 in the absorbing state, where the others are 0. A transition
    into a terminal state leads there, and rows in which it is not left follow, with the action
    before, no reward, and a timeout at their end.

    Args:
        shown: Demonstrations.
        stay: Rows in the absorbing state after each such episode, at least 1.

    Raises:
        UserError: If `stay` is below 1.
    """
    if stay < 1:
        raise UserError(f"stay must be at least 1, got {stay}")
    kept = shown.terminated.nonzero()[0]
    repeats = np.ones(shown.n_transitions, int)
    repeats[kept] += stay
    rows = np.arange(shown.n_transitions).repeat(repeats)
    copied = np.append(False, rows[1:] == rows[:-1])
    last = np.append(copied[:-1] & ~copied[1:], copied[-1:])
    absorbed = np.append(np.zeros(shown.n_features), 1.0)
    before = np.column_stack([shown.observation, np.zeros(shown.n_transitions)])[rows]
    after = np.column_stack([shown.next_observation, np.zeros(shown.n_transitions)])[rows]
    before[copied], after[shown.terminated[rows]] = absorbed, absorbed
    ending = np.where(shown.terminated[rows], int(Ending.NONE), shown.ending[rows])
    ending[last] = int(Ending.TIMEOUT)
    pairs = (np.where(copied, 0.0, column[rows]) for column in shown.rewards)
    return Demonstrations.of(
        observation=before,
        action=shown.action[rows],
        next_observation=after,
        ending=ending,
        rewards=RewardPair(*pairs),
        episode=shown.episode[rows],
        n_actions=shown.n_actions,
        mode=shown.mode[rows],
        mode_names=shown.mode_names,
        source={"made_by": "with_absorbing_states", "stay": stay, "of": shown.source},
    )
