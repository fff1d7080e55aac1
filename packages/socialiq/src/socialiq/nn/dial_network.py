"""Angle-conditioned Q-network Q(s, · ; α): one network for all social angles (a dial)."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.nn import q_network
from socialiq.nn.q_network import QNetwork, with_weights
from socialiq.nn.view import Encoding, angle_columns
from socialiq.social.angle import score
from socialiq.types import RewardPair


class DialNetwork(eqx.Module):
    """Angle-conditioned Q-network, from observation and (cos α, sin α) to a value per action.

    With pairs, the network gives (Q_env, Q_social) of each action: the expected sums of both
    rewards under the policy of the angle. The value is then their score at the angle.

    Attributes:
        layers: The first one's last inputs are those of the angle: cos α, sin α, and its hats.
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
        classes: bool = False,
    ) -> DialNetwork:
        """Draw a network (`q_network.perceptron`) with hat functions around the knots.

        Args:
            key: Random key.
            n_features: Length of an observation.
            hidden: Widths of the hidden layers.
            n_actions: Number of actions.
            activation: Name in `q_network.ACTIVATIONS` of the activation between layers.
            view: Name in `view.CHOICES` of the encoding of the observation.
            one_hot: Smallest value and number of values of each feature, for observations of
                integers; empty: the network reads the view.
            times: Number of values of the time, the last feature of what a view reads; 0 without.
            pairs: Whether Q of each action is a pair, of both rewards.
            knots: Centres of the angle's hat functions, in degrees; none for (cos α, sin α) alone.
            classes: Whether r_social has two parts, by class.

        Returns:
            The network.

        Raises:
            UserError: If the view is unknown or doesn't fit the observation.
        """
        rewards = 2 + classes
        widths = (*hidden, rewards * n_actions if pairs else n_actions)
        extra = rewards + len(knots)
        shape = (n_features, widths, view, one_hot, times, extra)
        layers, encoder = q_network.perceptron(key, *shape)
        return DialNetwork(layers, activation, encoder, pairs, knots)

    def __call__(
        self, observation: Float[Array, " feature"], direction: RewardPair
    ) -> Float[Array, " action"]:
        """Return the values of one observation at (cos α, sin α); use `jax.vmap` for a batch."""
        if self.pairs:
            return score(direction, self.value_pair(observation, direction))
        return self._outputs(observation, direction)

    def value_pair(
        self, observation: Float[Array, " feature"], direction: RewardPair
    ) -> RewardPair:
        """Return (Q_env, Q_social) of each action, of a network with pairs.

        Args:
            observation: One observation.
            direction: (cos α, sin α), scalars; sin α may have parts by class.

        Returns:
            The values, each (action,), in the form of the direction.
        """
        return _split(self._outputs(observation, direction), direction)

    def _outputs(
        self, observation: Float[Array, " feature"], direction: RewardPair
    ) -> Float[Array, " output"]:
        value = self.view(observation) if self.view else observation
        turned = jnp.concatenate([value, *angle_columns(direction, self.knots)])
        return q_network.through(self.layers, self.activation, turned)

    def at(self, direction: RewardPair) -> QNetwork:
        """Return the network of one angle, with plain values as its outputs.

        A fixed direction changes the first bias, and of pairs the last layer.
        """
        layers = list(self.layers)
        inputs = jnp.concatenate(angle_columns(direction, self.knots))
        first = layers[0]
        count = len(inputs)
        assert first.bias is not None
        bias = first.bias + first.weight[:, -count:] @ inputs
        layers[0] = with_weights(first, first.weight[:, :-count], bias)
        if self.pairs:
            last = layers[-1]
            assert last.bias is not None
            weight, bias = (
                score(direction, _split(array, direction)) for array in (last.weight, last.bias)
            )
            layers[-1] = with_weights(last, weight, bias)
        return QNetwork(tuple(layers), self.activation, self.view)


def _split(outputs: Array, direction: RewardPair) -> RewardPair:
    """Return the outputs of each reward, in the form of a direction."""
    form = jax.tree.structure(direction)
    return jax.tree.unflatten(form, jnp.split(outputs, form.num_leaves))
