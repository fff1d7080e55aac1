"""The total objective L_IQ + w L_reg (Eq 4.5) of one pair of batches, with its named terms."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
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
    """Rows of one update; None where a run has no use for a part.

    Attributes:
        expert: Demonstrations.
        replay: The learner's own transitions.
        initial: Observations of true initial states.
        endings: Shares of demonstrations and of replay that end in each kind of ending.
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
    functions: UserFunctions = OURS,
) -> tuple[Scalar, dict[str, Scalar]]:
    """Return the loss and its terms by name.

    Args:
        network: Network of Q.
        target_network: Network of V(s'), unless `next_value` is "online".
        batches: Rows of the update.
        hyperparameters: Numbers of one run.
        static: Config of the run.
        functions: Prior and divergence of the user's own.

    Returns:
        The loss, and its terms: `expert`, `value`, `chi2` are terms 1 to 3 of Eq 2.7, `prior` is w
        L_reg; `max_q` and `expert_reward` (mean r̂ on demonstrations) are recorded only.
    """
    batch = batches.expert
    if batches.replay is not None:
        batch = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), batch, batches.replay)
    temperature = hyperparameters.temperature
    discount = hyperparameters.discount

    q = jax.vmap(network)(batch.observation)
    source = target_network if static.next_value == "target" else network
    next_value = losses.soft_value(jax.vmap(source)(batch.next_observation), temperature)
    settings = (q.shape[-1], temperature, hyperparameters, static, batches.endings)
    follows = losses.continued(next_value, batch.ending, *settings)
    taken = jnp.take_along_axis(q, batch.action[:, None], axis=1)[:, 0]
    reward = losses.implicit_reward(taken, follows, discount)
    target = score(hyperparameters.weights, batch.target)
    start = None
    if batches.initial is not None:
        start = losses.soft_value(jax.vmap(network)(batches.initial), temperature)

    values = (losses.soft_value(q, temperature), follows, start)
    terms = terms_of(reward, target, *values, hyperparameters, static, functions)
    total = jnp.sum(jnp.stack(list(terms.values())))
    demonstrated = jnp.mean(reward[: static.batch_size])
    recorded = {"max_q": jnp.max(jnp.abs(q)), "expert_reward": demonstrated}
    return total, terms | recorded | {"loss": total}


def terms_of(
    reward: Array,
    target: Array,
    value: Array,
    follows: Array,
    start: Array | None,
    hyperparameters: HyperparameterArrays,
    static: IQLearnConfig,
    functions: UserFunctions,
) -> dict[str, Scalar]:
    """Return terms 1 to 3 of Eq 2.7 and the social prior of r̂ and R(α); term 3 only with χ².

    Args:
        reward: r̂ of each row; the first `batch_size` rows are demonstrations.
        target: R(α) of each row.
        value: V(s) of each row.
        follows: (1 - d) V(s') of each row.
        start: V(s_0) of true initial states, over which term 2 is taken; None: over rows.
        hyperparameters: Numbers of one run.
        static: Config of the run.
        functions: Prior and divergence of the user's own.

    Returns:
        The terms "expert" and "value", and "chi2" and "prior" where the config has them.
    """
    strength = hyperparameters.strength
    expert = slice(static.batch_size)
    rows = slice(None) if static.chi2_on == "mixture" else expert
    shifted = reward
    if static.prior == "bellman_shift":
        shifted = losses.bellman_shift(reward, target, strength)
    terms = {
        "expert": losses.expert_term(functions.divergence or static.divergence, shifted[expert])
    }
    if start is not None:
        terms["value"] = losses.initial_value_term(start, hyperparameters.discount)
    else:
        of_value = slice(None) if static.value_term == "value" else expert
        values = (value[of_value], follows[of_value])
        terms["value"] = losses.value_term(*values, hyperparameters.discount)
    prior = functions.prior or partial(losses.social_prior, trimmed=static.trimmed)
    if static.prior == "shifted_chi2":
        alpha = hyperparameters.chi2_alpha
        gap = losses.shifted_chi2(reward[rows], target[rows], strength, alpha, prior)
        return terms | {"prior": hyperparameters.prior_weight * gap}
    if static.divergence == "chi2" and functions.divergence is None:
        bounded = shifted if static.shift_term_3 else reward
        terms["chi2"] = losses.chi2_term(bounded[rows], hyperparameters.chi2_alpha)
    if static.prior == "reward":
        gap = prior(reward[expert], target[expert], strength)
        terms["prior"] = hyperparameters.prior_weight * gap
    return terms
