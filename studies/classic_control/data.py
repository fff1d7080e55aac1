"""Demonstrations of a task: trajectories, and what is kept of them.

The IQ-Learn paper (Garg et al. 2021, Fig 2) keeps every 20th transition of one expert trajectory.
A bang-bang expert settles into a short cycle, so a stride that is a multiple of the cycle keeps
states of one phase only. The default here is one random row from each block of 20.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.variants import with_images
from socialiq.evaluation.rollout import rollout_env
from studies.classic_control.tasks import Task, make_env

PROTOCOLS = ("rows", "stride", "whole")
"""One random row of each block, the first row of each block, or all rows."""

_SHIFTS = range(2, 13)
_TRANSIENT = 100
_UNIT = 0.1
"""Common unit of the features in the linear fit."""


def trajectories(task: Task, count: int, seed: int) -> Demonstrations:
    """Return whole episodes of the task's expert; episode i is reset with seed + i."""
    return rollout_env(make_env(task), task.expert, count, seed).transitions


def kept(
    shown: Demonstrations, protocol: str, task: Task, seed: int, mirrored: bool
) -> Demonstrations:
    """Return what a learner is given of whole trajectories.

    Args:
        shown: Whole trajectories.
        protocol: One of `PROTOCOLS`.
        task: Their task.
        seed: Seed of the random rows.
        mirrored: Whether every row's mirror image is given too.
    """
    thinned = {
        "rows": lambda: shown.one_of_each_block(task.every, seed),
        "stride": lambda: shown.subsample(task.every),
        "whole": lambda: shown,
    }[protocol]()
    return with_images(thinned, task.symmetry) if mirrored else thinned


def cycle(shown: Demonstrations) -> tuple[int, float]:
    """Return the shift of 2 to 12 steps under which most actions stay equal, and their share.

    It is counted over the second half of the first trajectory, after the transient.
    """
    action = shown.action[shown.episode == 0]
    action = action[len(action) // 2 :]
    shares = {k: float(np.mean(action[k:] == action[:-k])) for k in _SHIFTS if k < len(action)}
    shift = max(shares, key=lambda one: shares[one])
    return shift, shares[shift]


def spread_kept(kept_rows: Demonstrations, shown: Demonstrations) -> float:
    """Return the least share of a feature's standard deviation that the kept rows have.

    Near 0 the rows show one phase of the demonstrator's oscillation, and its reaction to that
    feature can hardly be identified. Rows of the first 100 steps, the transient, are left out.
    """
    kept_part, whole = (
        one.observation[one.step >= _TRANSIENT].std(axis=0) for one in (kept_rows, shown)
    )
    return float(np.min(kept_part / whole))


def linear_fit(data: Demonstrations, shrinkage: float) -> Float[np.ndarray, " feature"]:
    """Fit w of P(right) = logistic(w s) with penalty `shrinkage` |w|², for two actions.

    It is the class of CartPole's experts, without a constant: what is not identified here can't
    be identified in a larger class.
    """
    features = data.observation.astype(float) / _UNIT
    side = 2.0 * data.action - 1.0

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        margin = side * (features @ weights)
        wrong = 0.5 * (1.0 - np.tanh(0.5 * margin))  # the logistic function of -margin
        slope = -(side * wrong) @ features + 2.0 * shrinkage * weights
        return float(np.logaddexp(0.0, -margin).sum() + shrinkage * weights @ weights), slope

    return minimize(loss, np.zeros(features.shape[1]), jac=True, method="BFGS").x
