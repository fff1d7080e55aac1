"""Demonstrations with absorbing terminal states."""

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair


def with_absorbing_states(data: Demonstrations, stay: int = 1) -> Demonstrations:
    """Return the same episodes, with terminal states as absorbing ones (Kostrikov et al. 2019).

    As `worlds.wrapper.AbsorbingStates` would have given them: observations get a last number, 1 in
    the absorbing state, where all other numbers are 0. A transition into a terminal state leads to
    it. Rows in which it is not left follow, with the action before, no reward, and a timeout at
    their end.

    Args:
        data: The episodes.
        stay: Number of these rows, at least 1.

    Raises:
        UserError: If `stay` is below 1.
    """
    if stay < 1:
        raise UserError(f"stay must be at least 1, got {stay}")
    ends = data.terminated.nonzero()[0]
    repeats = np.ones(data.n_transitions, int)
    repeats[ends] += stay
    rows = np.arange(data.n_transitions).repeat(repeats)
    copied = np.append(False, rows[1:] == rows[:-1])
    last = np.append(copied[:-1] & ~copied[1:], copied[-1:])
    absorbed = np.append(np.zeros(data.n_features), 1.0)
    before = np.column_stack([data.observation, np.zeros(data.n_transitions)])[rows]
    after = np.column_stack([data.next_observation, np.zeros(data.n_transitions)])[rows]
    before[copied] = absorbed
    after[data.terminated[rows]] = absorbed
    ending = np.where(data.terminated[rows], int(Ending.NONE), data.ending[rows])
    ending[last] = int(Ending.TIMEOUT)
    pairs = (np.where(copied, 0.0, column[rows]) for column in data.rewards)
    return Demonstrations.of(
        observation=before,
        action=data.action[rows],
        next_observation=after,
        ending=ending,
        rewards=RewardPair(*pairs),
        episode=data.episode[rows],
        n_actions=data.n_actions,
        mode=data.mode[rows],
        mode_names=data.mode_names,
        source={"made_by": "with_absorbing_states", "stay": stay, "of": data.source},
    )
