"""The dial's loss: IQ-Learn with one quadratic centred on λR(α), at an angle of each row's own.

For a row at angle α, with r̂ = Q(s, a; α) - γ (1 - d) V(s'; α) (Eq 2.6):

    L = - E_E[r̂] + E[V(s; α) - γ (1 - d) V(s'; α)] + w / (4 α_χ) E[(r̂ - λR(α))²]

with the *instantaneous* R(α) = cos α · r_env + sin α · r_social. The two quadratics of the thesis'
Eq 4.5 are one such quadratic anyway (docs/theory.md); returns-to-go in the place of R pay a salary
for staying, and steps do not.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners.dial.config import Structure
from socialiq.learners.expert_table import Batch, draw_between
from socialiq.learners.iq_learn import losses, priors
from socialiq.nn.dial_network import DialNetwork
from socialiq.social.score import score
from socialiq.types import Ending, RewardPair

Scalar = Float[Array, ""]


class Traced(NamedTuple):
    """`Numbers` as arrays."""

    strength: Scalar
    prior_weight: Scalar
    temperature: Scalar
    discount: Scalar
    chi2_alpha: Scalar
    learning_rate: Scalar
    final_rate: Scalar
    polyak: Scalar
    exploration: Scalar
    seed: Array
    dataset: Array


class Rows(NamedTuple):
    """What one update sees.

    Attributes:
        batch: Transitions; the first `n_expert` are demonstrations.
        direction: (cos α, sin α) of each row.
        n_expert: How many are demonstrations.
    """

    batch: Batch
    direction: RewardPair
    n_expert: int


def objective(
    network: DialNetwork, slow: DialNetwork, rows: Rows, numbers: Traced, structure: Structure
) -> tuple[Scalar, dict[str, Scalar]]:
    """The loss and its terms by name: `expert` and `value` of IQ-Learn, `prior` the quadratic."""
    batch, direction, expert = rows.batch, rows.direction, slice(rows.n_expert)
    q = jax.vmap(network)(batch.observation, direction)
    q_next = jax.vmap(slow)(batch.next_observation, direction)
    absorbing = losses.absorbing_value(q.shape[-1], numbers.temperature, numbers.discount)
    follows = losses.continuation(
        losses.soft_value(q_next, numbers.temperature),
        batch.ending,
        structure.endings.by_kind(),
        absorbing,
    )
    taken = jnp.take_along_axis(q, batch.action[:, None], axis=1)[:, 0]
    reward = losses.implicit_reward(taken, follows, numbers.discount)
    target = score(direction, batch.target)

    terms = {}
    if structure.demonstrations:
        value = losses.soft_value(q, numbers.temperature)
        terms["expert"] = losses.expert_term("chi2", reward[expert])
        terms["value"] = losses.value_term(value, follows, numbers.discount)
    scored = expert if structure.scored == "demonstrations" else slice(None)
    gap = priors.shifted_chi2(reward[scored], target[scored], numbers.strength, numbers.chi2_alpha)
    terms["prior"] = numbers.prior_weight * gap
    total = jnp.sum(jnp.stack(list(terms.values())))
    return total, terms | {"max_q": jnp.max(jnp.abs(q)), "loss": total}


def draw_directions(key: PRNGKeyArray, size: int, structure: Structure) -> RewardPair:
    """Draw (cos α, sin α), α uniform between the structure's `low` and `high` and its margin."""
    low, high = structure.low - structure.margin, structure.high + structure.margin
    drawn = jax.random.uniform(key, (size,), minval=low, maxval=high)
    radians = jnp.deg2rad(drawn)
    return RewardPair(jnp.cos(radians), jnp.sin(radians))


def at_other_times(key: PRNGKeyArray, batch: Batch, horizon: int) -> Batch:
    """The same transitions at times drawn anew: the clock's feature and its timeouts change.

    Args:
        key: Random key.
        batch: Transitions whose observations end with the time.
        horizon: At which an episode is cut.
    """
    time = draw_between(key, len(batch.action), 0, jnp.asarray(horizon))
    ended = (batch.ending != int(Ending.NONE)) & (batch.ending != int(Ending.TIMEOUT))
    cut = jnp.where(time == horizon - 1, int(Ending.TIMEOUT), int(Ending.NONE))
    return batch._replace(
        observation=batch.observation.at[:, -1].set(time.astype(jnp.float32)),
        next_observation=batch.next_observation.at[:, -1].set((time + 1).astype(jnp.float32)),
        ending=jnp.where(ended, batch.ending, cut),
    )
