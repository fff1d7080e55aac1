"""Angle-conditioned Q-network Q(s, · ; α): one network for all social angles (a dial)."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.errors import UserError, one_of
from socialiq.nn.dial_policy import angle_columns
from socialiq.nn.q_network import QNetwork, affine_layers, encoding, through
from socialiq.nn.view import ROW, Encoding, View
from socialiq.social.angle import score
from socialiq.types import RewardPair


class DialNetwork(eqx.Module):
    """Angle-conditioned Q-network, from observation and (cos α, sin α) to a value per action.

    With pairs, the network gives (Q_env, Q_social) of each action: the expected sums of both
    rewards under the policy of the angle. The value is then their score at the angle.

    Attributes:
        layers: Affine layers; the first one's last inputs are those of the angle: cos α, sin α,
            and its hat functions.
        activation: Name in `q_network.ACTIVATIONS` of the activation between layers.
        view: Encoding of the observation that the first layer reads; None for none.
        pairs: Whether the outputs are Q_env of all actions, then Q_social of all actions.
        knots: Centres of the angle's hat functions, in degrees; none for (cos α, sin α) alone.
    """

    layers: tuple[eqx.nn.Linear, ...]
    activation: str = eqx.field(static=True)
    view: Encoding | None = None
    pairs: bool = eqx.field(static=True, default=False)
    knots: tuple[float, ...] = eqx.field(static=True, default=())

    @staticmethod
    def initialise(
        key: PRNGKeyArray,
        n_features: int,
        hidden: tuple[int, ...],
        n_actions: int,
        activation: str = "relu",
        view: str = "flat",
        one_hot: tuple[tuple[int, int], ...] = (),
        times: int = 0,
        pairs: bool = False,
        knots: tuple[float, ...] = (),
    ) -> DialNetwork:
        """Draw weights and biases uniformly within ±1/sqrt(fan-in).

        Args:
            key: Random key.
            n_features: Length of an observation.
            hidden: Widths of the hidden layers.
            n_actions: Number of actions.
            activation: Activation between layers.
            view: A name of `nn.view.CHOICES`.
            one_hot: Smallest value and number of values of each feature; None for the view.
            times: Number of values of the time, the last feature of what a view reads.
            pairs: Whether Q is a pair, of both rewards.
            knots: Centres of the angle's hat functions, in degrees, at equal distances.

        Raises:
            UserError: If the view is unknown or doesn't fit the observation.
        """
        encoder = encoding(key, n_features, view, one_hot, times)
        inputs = (encoder.width if encoder else n_features) + 2 + len(knots)
        outputs = 2 * n_actions if pairs else n_actions
        layers = affine_layers(key, (inputs, *hidden, outputs))
        return DialNetwork(layers, activation, encoder, pairs, knots)

    def __call__(
        self, observation: Float[Array, " feature"], direction: RewardPair
    ) -> Float[Array, " action"]:
        """Return the values of one observation at (cos α, sin α); use `jax.vmap` for a batch."""
        if self.pairs:
            return score(direction, self.both(observation, direction))
        return self._outputs(observation, direction)

    def both(self, observation: Float[Array, " feature"], direction: RewardPair) -> RewardPair:
        """Return (Q_env, Q_social) of each action, each (action,), of a network with pairs."""
        env, social = jnp.split(self._outputs(observation, direction), 2)
        return RewardPair(env, social)

    def _outputs(
        self, observation: Float[Array, " feature"], direction: RewardPair
    ) -> Float[Array, " output"]:
        value = self.view(observation) if self.view else observation
        turned = jnp.concatenate([value, *angle_columns(direction, self.knots)])
        return through(self.layers, self.activation, turned)

    def at(self, direction: RewardPair) -> QNetwork:
        """Return the network of one angle, which has plain values as its outputs.

        A fixed direction changes the first bias only, and of pairs the last layer: the score of
        two affine functions is one.
        """
        layers, inputs = list(self.layers), jnp.concatenate(angle_columns(direction, self.knots))
        first, count = layers[0], len(inputs)
        assert first.bias is not None
        bias = first.bias + first.weight[:, -count:] @ inputs
        layers[0] = _with(first, first.weight[:, :-count], bias)
        if self.pairs:
            last = layers[-1]
            assert last.bias is not None
            weight, bias = (
                score(direction, RewardPair(*jnp.split(array, 2)))
                for array in (last.weight, last.bias)
            )
            layers[-1] = _with(last, weight, bias)
        return QNetwork(tuple(layers), self.activation, self.view)


def transferred(
    network: DialNetwork,
    actions: Sequence[str],
    new_actions: Sequence[str],
    instead: str,
    vehicles: int,
    margin: float = 0.1,
) -> DialNetwork:
    """Return a network that values observations of another road as before.

    An action keeps its outputs by its name. A new action gets those of another, less a margin, so
    that the greedy policy never takes it before it has learned to.

    Args:
        network: Reads a set of vehicles, without the time.
        actions: Names of its actions, in order.
        new_actions: Names of the other road's actions.
        instead: Action whose outputs a new one gets.
        vehicles: Rows of the other road's observation.
        margin: Subtracted from each output of a new action, above 0.

    Raises:
        UserError: If the network reads something else, or `instead` is none of its actions.
    """
    view = network.view
    if not (isinstance(view, View) and view.choice.pooled) or view.times:
        raise UserError("only a dial that reads a set of vehicles without the time is transferred")
    one_of("action", instead, tuple(actions))
    origins = np.array(
        [actions.index(name if name in actions else instead) for name in new_actions]
    )
    less = np.array([0.0 if name in actions else margin for name in new_actions], np.float32)
    heads = 2 if network.pairs else 1
    rows = np.concatenate([origins + head * len(actions) for head in range(heads)])
    *layers, last = network.layers
    assert last.bias is not None
    weight, bias = jnp.asarray(last.weight)[rows], jnp.asarray(last.bias)[rows]
    empty = eqx.nn.Linear(last.weight.shape[1], len(rows), key=jax.random.key(0))
    layers.append(_with(empty, weight, bias - np.tile(less, heads)))
    view = dataclasses.replace(view, n_features=vehicles * ROW)
    return dataclasses.replace(network, layers=tuple(layers), view=view)


def _with(layer: eqx.nn.Linear, weight: Array, bias: Array) -> eqx.nn.Linear:
    return eqx.tree_at(lambda linear: (linear.weight, linear.bias), layer, (weight, bias))
