"""Vector Q-network of the offline dial; it observes the time."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners.offline.config import StaticConfig
from socialiq.nn.q_network import affine_layers, encoding, through
from socialiq.nn.view import Encoding
from socialiq.types import RewardPair


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
    def initialise(key: PRNGKeyArray, sizes: tuple[int, int], static: StaticConfig) -> Critic:
        """Draw weights and biases uniformly within ±1/sqrt(fan-in).

        Args:
            key: Random key.
            sizes: Length of an observation, and number of actions.
            static: Shape of the network.

        Raises:
            UserError: If the view doesn't fit the observation.
        """
        n_features, n_actions = sizes
        seen = encoding(key, n_features, static.view, static.one_hot)
        inputs = (seen.width if seen else n_features) + 3
        layers = affine_layers(key, (inputs, *static.hidden, 2 * n_actions))
        return Critic(layers, static.activation, seen)

    @staticmethod
    def ensemble(key: PRNGKeyArray, sizes: tuple[int, int], static: StaticConfig) -> Critic:
        """Draw `static.members` critics; leaves lead with the members."""
        drawn = [
            Critic.initialise(one, sizes, static) for one in jax.random.split(key, static.members)
        ]
        return jax.tree.map(lambda *leaves: jnp.stack(leaves), *drawn)

    def __call__(
        self, observation: Float[Array, " feature"], time: Float[Array, ""], direction: RewardPair
    ) -> Float[Array, "action 2"]:
        """Return Q of (r_env, r_social) for each action, in the critic's unit."""
        value = self.view(observation) if self.view else observation
        more = jnp.stack([time, direction.env, direction.social])
        found = through(self.layers, self.activation, jnp.concatenate([value, more]))
        return found.reshape(-1, 2)
