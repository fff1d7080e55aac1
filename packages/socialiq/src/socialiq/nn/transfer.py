"""Dial's network on another road: other actions by name, another number of vehicles."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.view import ROW, View


def transferred(
    network: DialNetwork,
    actions: Sequence[str],
    wanted: Sequence[str],
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
        wanted: Names of the other road's actions.
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
    rows = np.array([actions.index(name if name in actions else instead) for name in wanted])
    less = np.array([0.0 if name in actions else margin for name in wanted], np.float32)
    heads = 2 if network.pairs else 1
    taken = np.concatenate([rows + head * len(actions) for head in range(heads)])
    last = network.layers[-1]
    assert last.bias is not None
    weight, bias = jnp.asarray(last.weight)[taken], jnp.asarray(last.bias)[taken]
    empty = eqx.nn.Linear(last.weight.shape[1], len(taken), key=jax.random.key(0))
    values = weight, bias - np.tile(less, heads)
    changed = eqx.tree_at(lambda layer: (layer.weight, layer.bias), empty, values)
    seen = dataclasses.replace(view, n_features=vehicles * ROW)
    return dataclasses.replace(network, layers=(*network.layers[:-1], changed), view=seen)
