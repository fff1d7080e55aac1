"""The dial's loss: IQ-Learn with one quadratic centred on λR(α), at an angle of each row's own.

For a row at angle α, with r̂ = Q(s, a; α) - γ (1 - d) V(s'; α) (Eq 2.6):

    L = - E_E[r̂] + E[V(s; α) - γ (1 - d) V(s'; α)] + w / (4 α_χ) E[(r̂ - λR(α))²]

with the *instantaneous* R(α) = cos α · r_env + sin α · r_social. The two quadratics of the thesis'
Eq 4.5 are one such quadratic anyway (docs/theory.md); returns-to-go in the place of R pay a
constant reward for staying, and steps do not.

With pairs the network gives (Q_env, Q_social) of the policy of the row's angle, and there are two
quadratics, each reward's own: the same fixed point, reached with less noise, because neither target
depends on the angle but by the action of the next step (vector-valued values, as in Barreto et al.
2017 for features of the reward).
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from socialiq.learners.dial.config import DialConfig
from socialiq.learners.dial.rows import Rows
from socialiq.learners.iq_learn import losses
from socialiq.learners.state import HyperparameterArrays
from socialiq.nn.dial_network import DialNetwork
from socialiq.social.angle import score
from socialiq.types import RewardPair

Scalar = Float[Array, ""]


def objective(
    network: DialNetwork,
    target_network: DialNetwork,
    rows: Rows,
    hyperparameters: HyperparameterArrays,
    static: DialConfig,
) -> tuple[Scalar, dict[str, Scalar]]:
    """Return the loss and its terms: `expert` and `value` of IQ-Learn, `prior` the quadratic.

    Args:
        network: Network of Q, and of r̂ with V(s').
        target_network: Network of V(s').
        rows: Rows of the update, demonstrations first.
        hyperparameters: Numbers of one run.
        static: Config of the run.

    Returns:
        The loss, and the terms "expert" and "value" if there are demonstrations, "prior", "max_q"
        (recorded only) and "loss".

    Args:
        network: Network of Q, and of r̂ with V(s').
        target_network: Network of V(s').
        rows: Rows of the update, demonstrations first.
        hyperparameters: Numbers of one run.
        static: Config of the run.

    Returns:
        The loss, and the terms "expert" and "value" if there are demonstrations, "prior", "max_q"
        (recorded only) and "loss".
    """
    batch = rows.batch
    direction = rows.direction
    expert = slice(rows.n_expert)
    q, later, rewards = _implied(network, target_network, rows, hyperparameters, static)
    pairs = static.heads == "pair"
    reward = score(direction, like(direction, rewards)) if pairs else rewards[0]
    target = score(direction, batch.target)

    terms = {}
    if static.demonstrations:
        soft = static.backup == "soft"
        value = losses.soft_value(q, hyperparameters.temperature) if soft else q.max(axis=-1)
        follows = score(direction, like(direction, later)) if pairs else later[0]
        terms["expert"] = losses.expert_term("chi2", reward[expert])
        terms["value"] = losses.value_term(value, follows, hyperparameters.discount)
    scored = expert if static.scored == "demonstrations" else slice(None)
    scale = (hyperparameters.strength, hyperparameters.chi2_alpha)
    gaps = [
        losses.shifted_chi2(implied[scored], centre[scored], *scale)
        for implied, centre in zip(rewards, batch.target.parts if pairs else [target], strict=True)
    ]
    terms["prior"] = hyperparameters.prior_weight * sum(gaps[1:], gaps[0])
    total = jnp.sum(jnp.stack(list(terms.values())))
    return total, terms | {"max_q": jnp.max(jnp.abs(q)), "loss": total}


def _implied(
    network: DialNetwork,
    target_network: DialNetwork,
    rows: Rows,
    hyperparameters: HyperparameterArrays,
    static: DialConfig,
) -> tuple[Array, list[Array], list[Array]]:
    """Return Q of all actions, and (1 - d) V(s') and r̂: of pairs each reward's, else one."""
    batch = rows.batch
    direction = rows.direction
    discount = hyperparameters.discount
    pairs = static.heads == "pair"

    def outputs(of: DialNetwork, observation: Array) -> tuple[Array, ...]:
        if pairs:
            return jax.vmap(of.value_pair)(observation, direction).parts
        return (jax.vmap(of)(observation, direction),)

    def values(heads: tuple[Array, ...]) -> Array:
        wide = jax.tree.map(lambda side: side[:, None], direction)
        return score(wide, like(direction, heads)) if pairs else heads[0]

    heads = outputs(network, batch.observation)
    heads_next = outputs(target_network, batch.next_observation)
    q = values(heads)
    absorbing = 0.0
    if static.backup == "soft":
        temperature = hyperparameters.temperature
        absorbing = losses.absorbing_value(q.shape[-1], temperature, discount)
        next_values = [losses.soft_value(heads_next[0], temperature)]
    else:
        q_next = values(heads_next)
        if static.backup == "double":
            q_next = jax.vmap(network)(batch.next_observation, direction)
        action = jnp.argmax(q_next, axis=-1)
        next_values = [_at(head, action) for head in heads_next]
    endings = static.endings.by_kind()
    later = [losses.continuation(value, batch.ending, endings, absorbing) for value in next_values]
    rewards = [
        losses.implicit_reward(_at(head, batch.action), after, discount)
        for head, after in zip(heads, later, strict=True)
    ]
    return q, later, rewards


def like(direction: RewardPair, parts: Any) -> RewardPair:
    """Return the values of parts in the form of a direction: a pair, or r_social by class.

    Args:
        direction: Direction whose form is taken.
        parts: Values of r_env, then of each part of r_social.

    Returns:
        The pair of values.

    Args:
        direction: Direction whose form is taken.
        parts: Values of r_env, then of each part of r_social.

    Returns:
        The pair of values.
    """
    return jax.tree.unflatten(jax.tree.structure(direction), parts)


def _at(
    values: Float[Array, "batch action"], action: Int[Array, " batch"]
) -> Float[Array, " batch"]:
    return jnp.take_along_axis(values, action[:, None], axis=1)[:, 0]
