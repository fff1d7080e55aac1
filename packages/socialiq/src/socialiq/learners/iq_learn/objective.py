"""The total objective L_IQ + w L_reg (Eq 4.5) of one pair of batches, with its named terms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from socialiq.learners.expert_table import Batch
from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.config import IQLearnConfig
from socialiq.learners.iq_learn.losses import Divergence
from socialiq.learners.state import HyperparameterArrays
from socialiq.nn.q_network import ValueNetwork
from socialiq.social.angle import score

Scalar = Float[Array, ""]


class UserFunctions(NamedTuple):
    """Functions of the user's own in the place of ours; None keeps ours.

    Attributes:
        prior: (reward, target, strength) -> scalar, in the place of L_reg (Eq 4.4); `reward` is r̂
            and `target` R(α) of each demonstrated transition of a batch.
        divergence: In the place of the divergence of term 1.
        loss: (network, target_network, batches, hyperparameters, static) -> (loss, terms), in the
            place of `objective`.
    """

    prior: Callable[..., Any] | None = None
    divergence: Divergence | None = None
    loss: Callable[..., Any] | None = None


OURS = UserFunctions()


class Batches(NamedTuple):
    """Rows of one update.

    Attributes:
        expert: Demonstrations.
        replay: The learner's own transitions; None offline.
        initial: Observations of true initial states; None unless term 2 is `v0`.
        endings: Shares of demonstrations and of replay that end in each kind of ending, (2, kinds);
            None unless an ending is treated by occupancy.
    """

    expert: Batch
    replay: Batch | None
    initial: Float[Array, "batch feature"] | None
    endings: Float[Array, "2 kind"] | None = None


def objective(
    network: ValueNetwork,
    target_network: ValueNetwork,
    batches: Batches,
    hyperparameters: HyperparameterArrays,
    static: IQLearnConfig,
    own: UserFunctions = OURS,
) -> tuple[Scalar, dict[str, Scalar]]:
    """Return the loss and its terms by name.

    Terms: `expert`, `value`, `chi2` are terms 1 to 3 of Eq 2.7, `prior` is w L_reg; `max_q` and
    `expert_reward` (mean r̂ on demonstrations) are recorded only.
    """
    batch = batches.expert
    if batches.replay is not None:
        batch = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), batch, batches.replay)
    size = static.batch_size  # the first rows are the demonstrations

    q = jax.vmap(network)(batch.observation)
    value = losses.soft_value(q, hyperparameters.temperature)
    follows = _continuation(
        network, target_network, batch, batches.endings, hyperparameters, static
    )
    taken = jnp.take_along_axis(q, batch.action[:, None], axis=1)[:, 0]
    reward = losses.implicit_reward(taken, follows, hyperparameters.discount)
    target = score(hyperparameters.weights, batch.target)

    terms = {
        "expert": expert_term(reward[:size], target[:size], hyperparameters, static, own),
        "value": _value_term(network, value, follows, batches.initial, hyperparameters, static),
    }
    terms |= quadratic_terms(reward, target, hyperparameters, static, own)
    total = jnp.sum(jnp.stack(list(terms.values())))
    recorded = {"max_q": jnp.max(jnp.abs(q)), "expert_reward": jnp.mean(reward[:size])}
    return total, terms | recorded | {"loss": total}


def _continuation(
    network: ValueNetwork,
    target_network: ValueNetwork,
    batch: Batch,
    endings: Float[Array, "2 kind"] | None,
    hyperparameters: HyperparameterArrays,
    static: IQLearnConfig,
) -> Float[Array, " batch"]:
    """(1 - d) V(s'), from the target network without gradient or from the network with gradient."""
    source = target_network if static.next_value == "target" else network
    q_next = jax.vmap(source)(batch.next_observation)
    temperature, discount = hyperparameters.temperature, hyperparameters.discount
    value = losses.soft_value(q_next, temperature)
    if static.bounded:
        alpha = hyperparameters.chi2_alpha
        value = jnp.clip(
            value, *losses.value_bounds(q_next.shape[-1], temperature, discount, alpha)
        )
    absorbing = losses.absorbing_value(q_next.shape[-1], temperature, discount)
    occupancy = None
    if endings is not None:
        occupancy = losses.occupancy_value(
            endings[0], endings[1], discount, hyperparameters.chi2_alpha
        )
    treatment = static.endings.by_kind()
    return losses.continuation(value, batch.ending, treatment, absorbing, occupancy)


def expert_term(
    reward: Array,
    target: Array,
    hyperparameters: HyperparameterArrays,
    static: IQLearnConfig,
    own: UserFunctions,
) -> Scalar:
    """Term 1 on demonstrations, of the shifted r̂ with the prior "bellman_shift"."""
    if static.prior == "bellman_shift":
        reward = losses.bellman_shift(reward, target, hyperparameters.strength)
    return losses.expert_term(own.divergence or static.divergence, reward)


def _value_term(
    network: ValueNetwork,
    value: Array,
    follows: Array,
    initial: Array | None,
    hyperparameters: HyperparameterArrays,
    static: IQLearnConfig,
) -> Scalar:
    if initial is not None:
        start = losses.soft_value(jax.vmap(network)(initial), hyperparameters.temperature)
        return losses.initial_value_term(start, hyperparameters.discount)
    rows = slice(None) if static.value_term == "value" else slice(static.batch_size)
    return losses.value_term(value[rows], follows[rows], hyperparameters.discount)


def quadratic_terms(
    reward: Array,
    target: Array,
    hyperparameters: HyperparameterArrays,
    static: IQLearnConfig,
    own: UserFunctions,
) -> dict[str, Scalar]:
    """Term 3 (only with χ²) and the social prior."""
    rows = slice(None) if static.chi2_on == "mixture" else slice(static.batch_size)
    expert = slice(static.batch_size)
    if static.prior == "shifted_chi2":
        shifted = losses.shifted_chi2(
            reward[rows], target[rows], hyperparameters.strength, hyperparameters.chi2_alpha
        )
        return {"prior": hyperparameters.prior_weight * shifted}
    terms = {}
    if static.divergence == "chi2" and own.divergence is None:
        bounded = reward[rows]
        if static.prior == "bellman_shift" and static.shift_term_3:
            bounded = losses.bellman_shift(bounded, target[rows], hyperparameters.strength)
        terms["chi2"] = losses.chi2_term(bounded, hyperparameters.chi2_alpha)
    if static.prior == "reward":
        prior = own.prior or losses.social_prior
        gap = prior(reward[expert], target[expert], hyperparameters.strength)
        terms["prior"] = hyperparameters.prior_weight * gap
    return terms
