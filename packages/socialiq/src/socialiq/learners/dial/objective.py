"""The dial's loss: IQ-Learn with one quadratic centred on λR(α), at an angle of each row's own.

For a row at angle α, with r̂ = Q(s, a; α) - γ (1 - d) V(s'; α) (Eq 2.6):

    L = - E_E[r̂] + E[V(s; α) - γ (1 - d) V(s'; α)] + w / (4 α_χ) E[(r̂ - λR(α))²]

with the *instantaneous* R(α) = cos α · r_env + sin α · r_social. The two quadratics of the thesis'
Eq 4.5 are one such quadratic anyway (docs/theory.md); returns-to-go in the place of R pay a
constant reward for staying, and steps do not.

Where the demonstrators' own angles a_i are given, each is taken for one of its own angle and not of
every row's: what they share beside R(a_i) is a skill f(s, a), learned from all of them, and the
centre is λR(α) + f (`_skill_loss`).

With pairs the network gives (Q_env, Q_social) of the policy of the row's angle, and there are two
quadratics, each reward's own: the same fixed point, reached with less noise, because neither target
depends on the angle but by the action of the next step (vector-valued values, as in Barreto et al.
2017 for features of the reward).
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from socialiq.learners.dial.config import DialConfig
from socialiq.learners.dial.rows import Rows
from socialiq.learners.iq_learn import losses
from socialiq.learners.state import HyperparameterArrays
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.q_network import QNetwork
from socialiq.social.angle import score
from socialiq.types import RewardPair

Scalar = Float[Array, ""]


class Networks(NamedTuple):
    """Inputs of the loss.

    Attributes:
        values: Q.
        skill: f; None if no demonstrators are given.
    """

    values: DialNetwork
    skill: QNetwork | None


def objective(
    networks: Networks,
    target_network: DialNetwork,
    rows: Rows,
    hyperparameters: HyperparameterArrays,
    static: DialConfig,
) -> tuple[Scalar, dict[str, Scalar]]:
    """Return the loss and its terms: `expert` and `value` of IQ-Learn, `prior` the quadratic.

    With `demonstrators`, `skill` stands in the place of IQ-Learn's terms.
    """
    network, skill = networks
    batch, direction, expert = rows.batch, rows.direction, slice(rows.n_expert)
    of_rows = _of_pairs if static.heads == "pair" else _of_scores
    q, follows, reward, pairs = of_rows(network, target_network, rows, hyperparameters, static)
    target = score(direction, batch.target)

    terms = {}
    if skill is not None and rows.own is not None:
        correction = jax.vmap(skill)(batch.observation)
        terms["skill"] = _skill_loss(correction, target_network, rows, rows.own, hyperparameters)
        taken = jnp.take_along_axis(correction, batch.action[:, None], axis=1)[:, 0]
        target = target + jax.lax.stop_gradient(taken) / hyperparameters.strength
    elif static.demonstrations:
        soft = static.backup == "soft"
        value = losses.soft_value(q, hyperparameters.temperature) if soft else q.max(axis=-1)
        terms["expert"] = losses.expert_term("chi2", reward[expert])
        terms["value"] = losses.value_term(value, follows, hyperparameters.discount)
    scored = expert if static.scored == "demonstrations" else slice(None)
    centred = list(zip(pairs, batch.target, strict=True)) if pairs else [(reward, target)]
    gaps = [
        losses.shifted_chi2(
            implied[scored], centre[scored], hyperparameters.strength, hyperparameters.chi2_alpha
        )
        for implied, centre in centred
    ]
    terms["prior"] = hyperparameters.prior_weight * sum(gaps[1:], gaps[0])
    total = jnp.sum(jnp.stack(list(terms.values())))
    return total, terms | {"max_q": jnp.max(jnp.abs(q)), "loss": total}


class _Rewards(NamedTuple):
    """Values and implied rewards of the rows, each at its angle.

    Attributes:
        q: Values of all actions, (batch, action).
        follows: (1 - d) V(s'), (batch,).
        reward: r̂, (batch,).
        pairs: r̂ of each reward, of a network with pairs.
    """

    q: Float[Array, "batch action"]
    follows: Float[Array, " batch"]
    reward: Float[Array, " batch"]
    pairs: RewardPair | None


def _of_scores(
    network: DialNetwork,
    target_network: DialNetwork,
    rows: Rows,
    hyperparameters: HyperparameterArrays,
    static: DialConfig,
) -> _Rewards:
    """Return r̂ of a network whose outputs are values."""
    batch, direction = rows.batch, rows.direction
    q = jax.vmap(network)(batch.observation, direction)
    q_next = jax.vmap(target_network)(batch.next_observation, direction)
    absorbing = 0.0
    if static.backup == "soft":
        absorbing = losses.absorbing_value(
            q.shape[-1], hyperparameters.temperature, hyperparameters.discount
        )
        next_value = losses.soft_value(q_next, hyperparameters.temperature)
    else:
        next_value = _at(q_next, _next_action(network, q_next, rows, static))
    follows = losses.continuation(next_value, batch.ending, static.endings.by_kind(), absorbing)
    reward = losses.implicit_reward(_at(q, batch.action), follows, hyperparameters.discount)
    return _Rewards(q, follows, reward, None)


def _of_pairs(
    network: DialNetwork,
    target_network: DialNetwork,
    rows: Rows,
    hyperparameters: HyperparameterArrays,
    static: DialConfig,
) -> _Rewards:
    """Return r̂ of both rewards, of a network with pairs, and their score."""
    batch, direction = rows.batch, rows.direction
    wide = jax.tree.map(lambda column: column[:, None], direction)
    values = jax.vmap(network.both)(batch.observation, direction)
    both_next = jax.vmap(target_network.both)(batch.next_observation, direction)
    action = _next_action(network, score(wide, both_next), rows, static)
    endings = static.endings.by_kind()
    follows = RewardPair(
        *(
            losses.continuation(_at(next_values, action), batch.ending, endings, 0.0)
            for next_values in both_next
        )
    )
    reward = RewardPair(
        *(
            losses.implicit_reward(_at(q, batch.action), after, hyperparameters.discount)
            for q, after in zip(values, follows, strict=True)
        )
    )
    q = score(wide, values)
    return _Rewards(q, score(direction, follows), score(direction, reward), reward)


def _next_action(
    network: DialNetwork, q_next: Float[Array, "batch action"], rows: Rows, static: DialConfig
) -> Int[Array, " batch"]:
    """Return the action of s' that the backup takes the value of."""
    if static.backup == "double":
        q_next = jax.vmap(network)(rows.batch.next_observation, rows.direction)
    return jnp.argmax(q_next, axis=-1)


def _at(
    values: Float[Array, "batch action"], action: Int[Array, " batch"]
) -> Float[Array, " batch"]:
    return jnp.take_along_axis(values, action[:, None], axis=1)[:, 0]


def _skill_loss(
    correction: Float[Array, "batch action"],
    target_network: DialNetwork,
    rows: Rows,
    own: RewardPair,
    hyperparameters: HyperparameterArrays,
) -> Scalar:
    """Loss of f(s, a): actions of demonstrators that their own R(a_i) + f doesn't explain yet.

        E_i[ Σ_b π(b|s; a_i) f(s, b) - f(s, a) ] + c E_i[ f(s, a)² + ε Σ_b f(s, b)² ]

    π is softmax(Q/τ) of the target network at the demonstrator's own angle a_i. In a state of the
    demonstrations f therefore rises for actions that are taken more often than the policy of
    R(a_i) + f would, and falls for the others, until that policy acts as shown or c outweighs it.
    """
    count = rows.n_expert
    f, action = correction[:count], rows.batch.action[:count]
    q = jax.vmap(target_network)(rows.batch.observation[:count], own)
    policy = jax.lax.stop_gradient(jax.nn.softmax(q / hyperparameters.temperature))
    taken = jnp.take_along_axis(f, action[:, None], axis=1)[:, 0]
    moved = jnp.mean(jnp.sum(policy * f, axis=1) - taken)
    size = jnp.mean(jnp.square(taken) + hyperparameters.spread * jnp.sum(jnp.square(f), axis=1))
    return moved + hyperparameters.shrinkage * size
