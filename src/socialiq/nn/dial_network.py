"""Angle-conditioned Q-network Q(s, · ; α): one network for all social angles (a dial)."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.nn.q_network import Encoding, QNetwork, affine_layers, encoding, through
from socialiq.types import RewardPair


class DialNetwork(eqx.Module):
    """Angle-conditioned Q-network, from observation and (cos α, sin α) to a value per action.

    Attributes:
        layers: Affine layers; the first one's last two inputs are the direction.
        activation: Name in `q_network.ACTIVATIONS` of the activation between layers.
        view: Encoding of the observation that the first layer reads; None for none.
    """

    layers: tuple[eqx.nn.Linear, ...]
    activation: str = eqx.field(static=True)
    view: Encoding | None = None

    @staticmethod
    def initialise(
        key: PRNGKeyArray,
        n_features: int,
        hidden: tuple[int, ...],
        n_actions: int,
        activation: str = "relu",
        view: str = "flat",
        one_hot: tuple[tuple[int, int], ...] = (),
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

        Raises:
            UserError: If the view is unknown or doesn't fit the observation.
        """
        seen = encoding(key, n_features, view, one_hot)
        inputs = (seen.width if seen else n_features) + 2
        return DialNetwork(affine_layers(key, (inputs, *hidden, n_actions)), activation, seen)

    def __call__(
        self, observation: Float[Array, " feature"], direction: RewardPair
    ) -> Float[Array, " action"]:
        """Return the values of one observation at (cos α, sin α); use `jax.vmap` for a batch."""
        value = self.view(observation) if self.view else observation
        turned = jnp.concatenate([value, jnp.stack([direction.env, direction.social])])
        return through(self.layers, self.activation, turned)

    def at(self, direction: RewardPair) -> QNetwork:
        """Return the network of one angle. A fixed direction changes the first bias only."""
        first, *others = self.layers
        assert first.bias is not None
        fixed = first.weight[:, -2:] @ jnp.stack([direction.env, direction.social])
        plain = eqx.tree_at(
            lambda layer: (layer.weight, layer.bias),
            first,
            (first.weight[:, :-2], first.bias + fixed),
        )
        return QNetwork((plain, *others), self.activation, self.view)
