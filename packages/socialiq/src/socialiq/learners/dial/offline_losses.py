"""Losses of the offline dial: behaviour policy, critics, dial.

    y = r + γ (1 - d) Σ_a π(a | s', t + 1; α) Q(s', t + 1, a; α)           r, Q, y in R²
    π(a | s, t; α) ∝ β(a | s) exp(R_α(Q(s, t, a; α)) / η)

β is the demonstrators' pooled policy and R_α(Q) = cos α Q_env + sin α Q_social. π maximises
E_π[R_α(Q)] - η KL(π, β), so an action without support in the data has no weight, whatever a network
says of it (Wu et al. 2019, behaviour-regularised learning; the closed form is Todorov's, 2006).
With η to infinity Q is the value of the demonstrators' mixture, with η to 0 that of the best policy
within its support. Q has one value for each reward, under π; the costs of the KL are not part of
it.

An episode may be cut by a clock that observations don't show. The critics read the time, which
recordings have; the dial reads the observation alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from socialiq.learners.dial.config import OfflineDialConfig
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.q_network import QNetwork, perceptron, through
from socialiq.nn.view import Encoding
from socialiq.social.angle import score
from socialiq.types import RewardPair

Scalar = Float[Array, ""]

LEAST = -12.0
"""Smallest log β that the dial's loss sees, so that its gradients are bounded."""
RARE = 0.02
"""Share of the most frequent action below which an action counts as not demonstrated."""

_AT_15 = math.sin(math.radians(30.0))
_AT_30 = math.sin(math.radians(60.0))


class Rows(NamedTuple):
    """Recorded transitions (s, a, s').

    Attributes:
        ended: Whether the episode ends with the row, by its clock too.
        rewards: (r_env, r_social).
        time: Step within the episode, over the length of the longest episode.
        next_time: The same of s'.
        log_behaviour: log β(· | s).
        next_log_behaviour: log β(· | s').
    """

    observation: Float[Array, "row feature"]
    action: Int[Array, " row"]
    next_observation: Float[Array, "row feature"]
    ended: Bool[Array, " row"]
    rewards: Float[Array, "row 2"]
    time: Float[Array, " row"]
    next_time: Float[Array, " row"]
    log_behaviour: Float[Array, "row action"]
    next_log_behaviour: Float[Array, "row action"]


class Critic(eqx.Module):
    """Vector Q-network, from observation, time and (cos α, sin α) to two values per action.

    Attributes:
        layers: Affine layers; the first one's last three inputs are time and direction.
        activation: Name in `q_network.ACTIVATIONS` of the activation between layers.
        view: Encoding of the observation that the first layer reads; None for none.
    """

    layers: tuple[eqx.nn.Linear, ...]
    activation: str = eqx.field(static=True)
    view: Encoding | None = None

    @staticmethod
    def initialise(key: PRNGKeyArray, sizes: tuple[int, int], static: OfflineDialConfig) -> Critic:
        """Draw weights and biases uniformly within ±1/sqrt(fan-in).

        Args:
            key: Random key.
            sizes: Features of an observation, and number of actions.
            static: Config with the shape of the network.

        Returns:
            The critic.

        Raises:
            UserError: If the view doesn't fit the observation.
        """
        n_features, n_actions = sizes
        shape = (n_features, (*static.hidden, 2 * n_actions), static.view, static.one_hot)
        layers, view = perceptron(key, *shape, extra=3)
        return Critic(layers, static.activation, view)

    @staticmethod
    def ensemble(key: PRNGKeyArray, sizes: tuple[int, int], static: OfflineDialConfig) -> Critic:
        """Draw `static.members` critics.

        Args:
            key: Random key.
            sizes: Features of an observation, and number of actions.
            static: Config with the number of members and the shape of a network.

        Returns:
            A critic whose arrays have a leading axis of members.

        Raises:
            UserError: If the view doesn't fit the observation.
        """
        keys = jax.random.split(key, static.members)
        critics = [Critic.initialise(member_key, sizes, static) for member_key in keys]
        return jax.tree.map(lambda *leaves: jnp.stack(leaves), *critics)

    def __call__(
        self, observation: Float[Array, " feature"], time: Float[Array, ""], direction: RewardPair
    ) -> Float[Array, "action 2"]:
        """Return Q of (r_env, r_social) for each action, in the critic's unit."""
        value = self.view(observation) if self.view else observation
        context = jnp.stack([time, direction.env, direction.social])
        outputs = through(self.layers, self.activation, jnp.concatenate([value, context]))
        return outputs.reshape(-1, 2)


def regularised_policy(
    log_behaviour: Float[Array, "*batch action"],
    value: Float[Array, "*batch action"],
    temperature: Float[Array, "*batch"] | float,
) -> Float[Array, "*batch action"]:
    """Return π ∝ β exp(Q / η), which maximises E_π[Q] - η KL(π, β) (Todorov 2006).

    Args:
        log_behaviour: log β(a | s).
        value: Q of each action, a scalar score.
        temperature: η of each state, in units of reward.

    Returns:
        π(a | s), with sum 1 over the actions.

    Args:
        log_behaviour: log β(a | s).
        value: Q of each action, a scalar score.
        temperature: η of each state, in units of reward.

    Returns:
        π(a | s), with sum 1 over the actions.
    """
    return jax.nn.softmax(log_behaviour + value / jnp.asarray(temperature)[..., None], axis=-1)


def supported(log_behaviour: Float[Array, "row action"]) -> Float[Array, "row action"]:
    """Return log β without rare actions, of whose Q little is known (BCQ, Fujimoto et al. 2019).

    Args:
        log_behaviour: log β(a | s).

    Returns:
        The same, -1000 for actions rarer than `RARE` of the most frequent one.
    """
    most = jnp.max(log_behaviour, axis=-1, keepdims=True)
    return jnp.where(log_behaviour < most + math.log(RARE), -1000.0, log_behaviour)


def price(
    direction: RewardPair, temperature: Scalar | float, end_temperature: Scalar | float
) -> Float[Array, " row"]:
    """Return η of each row's angle.

    It is `temperature` from 30 to 60 degrees, and `end_temperature` up to 15 degrees and from 75
    on. Between them it is linear in sin 2α.

    Args:
        direction: (cos α, sin α) of each row.
        temperature: η from 30 to 60 degrees, in units of reward.
        end_temperature: η near both ends, in units of reward.

    Returns:
        η of each row.
    """
    twice = 2.0 * direction.env * direction.social  # sin 2α
    between = jnp.clip((twice - _AT_15) / (_AT_30 - _AT_15), 0.0, 1.0)
    return end_temperature + (temperature - end_temperature) * between


def scored(
    values: Float[Array, "row action 2"], direction: RewardPair
) -> Float[Array, "row action"]:
    """Return R_α(Q) of each row's own direction.

    Args:
        values: (Q_env, Q_social) of each row and action.
        direction: (cos α, sin α) of each row.

    Returns:
        The score of each row and action.

    Args:
        values: (Q_env, Q_social) of each row and action.
        direction: (cos α, sin α) of each row.

    Returns:
        The score of each row and action.
    """
    weights = RewardPair(direction.env[:, None], direction.social[:, None])
    return score(weights, RewardPair(values[..., 0], values[..., 1]))


def ensemble_values(
    critics: Critic,
    observation: Float[Array, "row feature"],
    time: Float[Array, " row"],
    direction: RewardPair,
    unit: Float[Array, " 2"],
) -> Float[Array, "member row action 2"]:
    """Return Q of each member of an ensemble, in units of reward.

    Args:
        critics: The ensemble, with a leading axis of members.
        observation: Observations, (row, feature).
        time: Step within the episode of each row, over the length of an episode.
        direction: (cos α, sin α) of each row.
        unit: Units of the outputs for r_env and r_social.

    Returns:
        (Q_env, Q_social) of each member, row and action.

    Args:
        critics: The ensemble, with a leading axis of members.
        observation: Observations, (row, feature).
        time: Step within the episode of each row, over the length of an episode.
        direction: (cos α, sin α) of each row.
        unit: Units of the outputs for r_env and r_social.

    Returns:
        (Q_env, Q_social) of each member, row and action.
    """
    return unit * jax.vmap(lambda critic: jax.vmap(critic)(observation, time, direction))(critics)


def behaviour_loss(network: QNetwork, rows: Rows) -> Scalar:
    """Return -E[log β(a | s)].

    Args:
        network: Network of the logits of β.
        rows: Recorded transitions.

    Returns:
        The mean over the rows, in nats.
    """
    logits = jax.vmap(network)(rows.observation)
    taken = jax.nn.one_hot(rows.action, logits.shape[-1])
    return -jnp.mean(jnp.sum(taken * jax.nn.log_softmax(logits), axis=-1))


def critic_target(
    averages: Critic,
    rows: Rows,
    direction: RewardPair,
    unit: Float[Array, " 2"],
    temperature: Float[Array, " row"] | float,
    discount: Scalar | float,
) -> Float[Array, "row 2"]:
    """Return y, with Q the mean over the running averages of the members.

    Args:
        averages: Running averages of the members.
        rows: Recorded transitions.
        direction: (cos α, sin α) of each row.
        unit: Units of the outputs for r_env and r_social.
        temperature: η of each row, in units of reward.
        discount: γ.

    Returns:
        y of each row, for r_env and r_social, in units of reward.

    Args:
        averages: Running averages of the members.
        rows: Recorded transitions.
        direction: (cos α, sin α) of each row.
        unit: Units of the outputs for r_env and r_social.
        temperature: η of each row, in units of reward.
        discount: γ.

    Returns:
        y of each row, for r_env and r_social, in units of reward.
    """
    later = ensemble_values(averages, rows.next_observation, rows.next_time, direction, unit)
    values = jnp.mean(later, axis=0)
    chosen = regularised_policy(rows.next_log_behaviour, scored(values, direction), temperature)
    going = jnp.where(rows.ended, 0.0, discount)
    return rows.rewards + going[:, None] * jnp.einsum("ra,rak->rk", chosen, values)


def critic_loss(
    critics: Critic,
    target: Float[Array, "row 2"],
    rows: Rows,
    direction: RewardPair,
    unit: Float[Array, " 2"],
) -> Scalar:
    """Return ``E[|(Q(s, t, a; α) - y) / unit|²]``, summed over the members.

    Args:
        critics: The ensemble, with a leading axis of members.
        target: y of each row, for r_env and r_social.
        rows: Recorded transitions.
        direction: (cos α, sin α) of each row.
        unit: Units of the outputs for r_env and r_social.

    Returns:
        The loss, without unit.
    """
    values = ensemble_values(critics, rows.observation, rows.time, direction, unit)
    taken = jnp.take_along_axis(values, rows.action[None, :, None, None], axis=2)[:, :, 0]
    errors = jnp.sum(jnp.square((taken - target) / unit), axis=-1)
    return jnp.sum(jnp.mean(errors, axis=1))


def dial_loss(
    network: DialNetwork,
    critics: Critic,
    rows: Rows,
    direction: RewardPair,
    unit: Float[Array, " 2"],
    temperature: Float[Array, " row"] | float,
) -> Scalar:
    """Return E[KL(π, β) - E_π[R_α(Q)] / η] of the dial's own π, which doesn't read the time.

    Its minimum at s is β(a|s) exp(E_t[R_α(Q(s, t, a))] / η), normalised: values are averaged over
    the recorded times, and not the policies that would be best at each of them.

    Args:
        network: The dial, whose values are logits of π.
        critics: Trained ensemble, with a leading axis of members.
        rows: Recorded transitions, with log β.
        direction: (cos α, sin α) of each row.
        unit: Units of the critics' outputs for r_env and r_social.
        temperature: η of each row, in units of reward.

    Returns:
        The mean over the rows, up to a constant of each row, in nats. log β is at least `LEAST`.
    """
    values = ensemble_values(critics, rows.observation, rows.time, direction, unit)
    value = scored(jnp.mean(values, axis=0), direction) / jnp.asarray(temperature)[..., None]
    log_policy = jax.nn.log_softmax(jax.vmap(network)(rows.observation, direction))
    shown = rows.log_behaviour > -1000.0
    gain = value - jnp.max(value, axis=-1, keepdims=True, where=shown, initial=-jnp.inf)
    gain = jnp.minimum(gain, 0.0)
    behaviour = jnp.maximum(rows.log_behaviour, LEAST)
    return jnp.mean(jnp.sum(jnp.exp(log_policy) * (log_policy - behaviour - gain), axis=-1))
