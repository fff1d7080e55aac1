"""Fitted Q evaluation (Le, Voloshin and Yue 2019): regressions on the logged transitions.

With k steps to go, for each signal r,

    Q_k(s, a) = E[ r + (1 - terminated) Σ_b π(b|s') Q_{k-1}(s', b) | s, a ],    Q_0 = 0

and J = E[ Σ_a π(a|s_0) Q_H(s_0, a) ]: H regressions are the sum over H steps, without discounting.
Every transition serves each k, as neither dynamics nor rewards may depend on the time unless it is
observed. So a reward that is paid for running out of time counts as one of its state.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array

from socialiq.evaluation.off_policy.logged import Logged


class Fitted(NamedTuple):
    """Estimates of each resample of the episodes.

    Attributes:
        totals: Sums of r_env and r_social of an episode.
        left: Share of episodes in which the policy comes to an action that the data do not show
            in that observation; there the mean of the actions that they show stands for it.
    """

    totals: Float[np.ndarray, "resample 2"]
    left: Float[np.ndarray, " resample"]


def tabular(
    logged: Logged,
    chances: Float[np.ndarray, "state action"],
    counts: Float[np.ndarray, "resample episode"],
) -> Fitted:
    """Evaluate by means over equal observations and actions.

    Args:
        logged: The episodes.
        chances: The policy's probabilities at each distinct observation.
        counts: How often each episode is in each resample.
    """
    data, (n_states, n_actions) = logged.data, chances.shape
    kinds, cell, follows = _kinds(logged, n_actions)
    times = np.bincount(
        data.episode * len(cell) + kinds, minlength=data.n_episodes * len(cell)
    ).reshape(data.n_episodes, -1)
    weight = counts @ times
    into = csr_array(
        (np.ones(len(cell)), (np.arange(len(cell)), cell)), (len(cell), n_states * n_actions)
    )
    size = weight @ into
    seen = (size > 0).reshape(-1, n_states, n_actions)
    value = np.zeros((len(counts), n_states, 3))
    for _ in range(logged.horizon):
        target = follows.signals + follows.goes_on[:, None] * value[:, follows.state]
        sums = [(weight * target[..., signal]) @ into for signal in range(3)]
        mean = np.stack(sums, axis=2) / np.maximum(size, 1e-12)[:, :, None]
        q = _completed(mean.reshape(-1, n_states, n_actions, 3), seen)
        value = np.einsum("sa,rsac->rsc", chances, q)
    start = logged.state[data.episode_starts]
    found = np.einsum("re,rec->rc", counts, value[:, start]) / counts.sum(axis=1)[:, None]
    return Fitted(found[:, :2], found[:, 2])


class _Follows(NamedTuple):
    """Successors of each kind of transition; the third signal is that of having left the data."""

    state: np.ndarray
    goes_on: np.ndarray
    signals: np.ndarray


def _kinds(logged: Logged, n_actions: int) -> tuple[np.ndarray, np.ndarray, _Follows]:
    """Number equal transitions: the kind of each row, each kind's cell, and what follows it."""
    data = logged.data
    cell = logged.state * n_actions + data.action
    columns = np.stack([cell, logged.next_state, ~data.terminated, *data.rewards], axis=1)
    distinct, kinds = np.unique(columns, axis=0, return_inverse=True)
    signals = np.concatenate([distinct[:, 3:], np.zeros((len(distinct), 1))], axis=1)
    follows = _Follows(distinct[:, 1].astype(int), distinct[:, 2], signals)
    return kinds.reshape(-1), distinct[:, 0].astype(int), follows


def _completed(q: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Fill the cells without data: the mean of the state's other actions, and "left" 1."""
    among = seen[..., None]
    mean = (q * among).sum(axis=2) / np.maximum(seen.sum(axis=2), 1)[..., None]
    filled = np.where(among, q, mean[:, :, None])
    filled[..., 2] = np.where(seen, q[..., 2], 1.0)
    return filled
