"""L1 and KL in place of the quadratic prior (thesis 4.3.1), and how far r̂ stays from λR(α).

The thesis argues against both without running them: L1 would match λR(α) exactly on most
state-action pairs and deviate sharply on others; KL would need a softmax.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import logsumexp

from socialiq import Demonstrations, Ending, QPolicy, score, weights
from socialiq.learners.iq_learn.config import IQLearnConfig, IQLearnHyperparameters
from socialiq.types import Row
from socialiq_lab.declared import State
from socialiq_lab.tables import groups, mean, nested

CLOSE = 0.05  # a deviation |r̂ - λR(α)| below this share of the largest |λR(α)| counts as a match


def l1(reward: Array, target: Array, strength: Array) -> Array:
    """Return E|r̂ - λR(α)|, the penalty that the thesis calls L1.

    Args:
        reward: r̂ of each row of a batch.
        target: R(α) of each row.
        strength: λ.
    """
    return jnp.mean(jnp.abs(reward - strength * target))


def kl(reward: Array, target: Array, strength: Array) -> Array:
    """Return KL(softmax(λR(α)) || softmax(r̂)), both over the rows of a batch.

    Args:
        reward: r̂ of each row of a batch.
        target: R(α) of each row.
        strength: λ.
    """
    prior = jax.nn.log_softmax(strength * target)
    learned = jax.nn.log_softmax(reward)
    return jnp.sum(jnp.exp(prior) * (prior - learned))


def deviation_rows(state: State) -> list[Row]:
    """Return how far r̂ stays from λR(α) on the demonstrations of each policy."""
    rows = []
    for label, static, run, data, policy in state.policies:
        gap = deviations(policy, static, run, data)
        rows.append(label | {"seed": run.seed} | _deviation_row(gap, _target(static, run, data)))
    return rows


def deviations(
    policy: QPolicy, static: IQLearnConfig, run: IQLearnHyperparameters, data: Demonstrations
) -> Float[np.ndarray, " transition"]:
    """Return r̂ - λR(α) of each demonstrated transition, with V(s') of the trained network.

    Args:
        policy: Trained policy, whose network is Q.
        static: Static configuration of the run.
        run: Hyperparameters of the run.
        data: Demonstrations that the run learned from.
    """
    q = policy.q_values(data.observation)
    after = policy.q_values(data.next_observation)
    tau = run.temperature
    value = tau * np.asarray(logsumexp(after / tau, axis=1))
    ended = np.asarray(data.ending) != int(Ending.NONE)  # the preset treats every end as zero
    taken = np.take_along_axis(q, data.action[:, None].astype(int), axis=1)[:, 0]
    reward = taken - run.discount * np.where(ended, 0.0, value)
    return reward - _target(static, run, data)


def _target(static: IQLearnConfig, run: IQLearnHyperparameters, data: Demonstrations) -> np.ndarray:
    """Return λR(α) of each transition."""
    pair = data.returns(static.target_kind, static.social_discount)
    return run.strength * np.asarray(score(weights(run.angle), pair))


def _deviation_row(gap: np.ndarray, target: np.ndarray) -> Row:
    """Return the distances of r̂ from λR(α), and how evenly they spread over transitions."""
    scale = float(np.abs(target).max())
    size = np.abs(gap)
    level = gap - gap.mean()
    return {
        "matched": float((size <= CLOSE * scale).mean()),
        "median": float(np.median(size)),
        "mean": float(size.mean()),
        "largest": float(size.max()),
        # 1 if all deviations are equal; large if a few transitions deviate much more than the rest.
        "peakedness": float(size.max() / max(float(np.median(size)), 1e-12)),
        "level": float(gap.mean()),
        "correlation": float(np.corrcoef(target, target + level)[0, 1]),
    }


def summary(state: State) -> dict[str, Any]:
    """Return angle, regret and deviations by penalty, strength and target angle."""
    keys = ("penalty", "strength", "readout", "target_angle")
    summary = nested(state.tables["pooled"], *keys, keep=("angle", "regret", "arrival"))
    columns = ("matched", "median", "mean", "largest", "peakedness", "correlation")
    for (name, strength), gaps in groups(state.tables["deviations"], "penalty", "strength").items():
        entry = summary[name][f"{strength:g}"]
        for readout in ("greedy", "soft"):
            entry[readout]["mean_regret"] = mean(list(entry[readout].values()), "regret")
        entry["deviation"] = {name: mean(gaps, name) for name in columns}
    return summary
