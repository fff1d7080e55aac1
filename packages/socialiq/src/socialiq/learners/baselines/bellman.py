"""Parts that several baselines share: values of taken actions, and what follows a transition."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from socialiq.learners.expert_table import Batch
from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.state import HyperparameterArrays


def of_taken(
    values: Float[Array, "batch action"], action: Int[Array, " batch"]
) -> Float[Array, " batch"]:
    """Return the values of the actions that were taken."""
    return jnp.take_along_axis(values, action[:, None], axis=1)[:, 0]


def soft_continuation(
    network: Any, batch: Batch, hyperparameters: HyperparameterArrays, endings: Endings
) -> Float[Array, " batch"]:
    """(1 - d) V(s') of Eq 2.6, with V(s') = τ logsumexp(Q(s', ·)/τ) of the given network."""
    q_next = jax.vmap(network)(batch.next_observation)
    return losses.continuation(
        losses.soft_value(q_next, hyperparameters.temperature),
        batch.ending,
        endings.by_kind(),
        losses.absorbing_value(
            q_next.shape[-1], hyperparameters.temperature, hyperparameters.discount
        ),
    )


def log_likelihood(
    logits: Float[Array, "batch action"], action: Int[Array, " batch"]
) -> Float[Array, " batch"]:
    """Return log π(a|s) of the taken actions, π = softmax of the logits."""
    return of_taken(jax.nn.log_softmax(logits), action)
