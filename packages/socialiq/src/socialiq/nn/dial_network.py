"""Angle-conditioned Q-network Q(s, · ; α): one network for all social angles (a dial)."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.nn.q_network import Encoding, QNetwork, affine_layers, encoding, through
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
        seen = encoding(key, n_features, view, one_hot, times)
        inputs = (seen.width if seen else n_features) + 2 + len(knots)
        outputs = 2 * n_actions if pairs else n_actions
        layers = affine_layers(key, (inputs, *hidden, outputs))
        return DialNetwork(layers, activation, seen, pairs, knots)

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
        layers = list(self.layers)
        layers[0] = _fixed(layers[0], jnp.concatenate(angle_columns(direction, self.knots)))
        if self.pairs:
            layers[-1] = _scored(layers[-1], direction)
        return QNetwork(tuple(layers), self.activation, self.view)


def knots_between(low: float, high: float, count: int) -> tuple[float, ...]:
    """Return as many angles at equal distances from one to another, in degrees; none for 0."""
    return tuple(np.linspace(low, high, count).tolist())


def hats(degrees: Any, knots: tuple[float, ...]) -> Any:
    """Return the hat functions ``max(0, 1 - |α - k| / h)`` of an angle, with knots k at distance h.

    Their weighted sums are the continuous functions that are linear between knots. The values of
    an angle's best actions have kinks where the policy changes: linear pieces follow these, while
    (cos α, sin α) alone rounds them off and so favours the action whose value has the kink.

    Args:
        degrees: The angle, a NumPy or JAX array of any shape; whole turns don't matter.
        knots: Angles at equal distances, at least two.

    Returns:
        (..., knot).
    """
    middle, distance = (knots[0] + knots[-1]) / 2, knots[1] - knots[0]
    offset = (degrees - middle + 180.0) % 360.0 - 180.0  # of the angle from the middle knot
    places = np.array(knots, np.float32) - np.float32(middle)
    xp = degrees.__array_namespace__()
    return xp.maximum(1.0 - xp.abs(offset[..., None] - places) / distance, 0.0)


def angle_columns(direction: RewardPair, knots: tuple[float, ...]) -> list[Any]:
    """Return the inputs of the first layer for directions: (cos α, sin α), and the hats of α.

    Args:
        direction: NumPy or JAX arrays of any shape.
        knots: Centres of the hat functions, in degrees.

    Returns:
        Arrays with one more axis, of the inputs.
    """
    xp = direction.env.__array_namespace__()
    pair = xp.stack([direction.env, direction.social], axis=-1)
    if not knots:
        return [pair]
    return [pair, hats(xp.rad2deg(xp.arctan2(direction.social, direction.env)), knots)]


def _fixed(first: eqx.nn.Linear, angle: Float[Array, " input"]) -> eqx.nn.Linear:
    """Return a first layer with the part of an angle's inputs in its bias."""
    assert first.bias is not None
    weight = first.weight[:, : -len(angle)]
    return _with(first, weight, first.bias + first.weight[:, -len(angle) :] @ angle)


def _scored(last: eqx.nn.Linear, direction: RewardPair) -> eqx.nn.Linear:
    """Return a last layer that gives the score of the pairs."""
    assert last.bias is not None
    weight, bias = (
        score(direction, RewardPair(*jnp.split(part, 2))) for part in (last.weight, last.bias)
    )
    return _with(last, weight, bias)


def _with(layer: eqx.nn.Linear, weight: Array, bias: Array) -> eqx.nn.Linear:
    return eqx.tree_at(lambda one: (one.weight, one.bias), layer, (weight, bias))
