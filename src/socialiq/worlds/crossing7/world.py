"""Factory of the 7x7 world."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax.numpy as jnp

from socialiq.errors import UserError
from socialiq.worlds.crossing7 import rewards, rules
from socialiq.worlds.crossing7.options import Options
from socialiq.worlds.crossing7.render import draw
from socialiq.worlds.grid_world import Feature, GridWorld, Outcome

_EMPTY = (0, rules.STOP, 0, rules.FAST, rules.ABSENT, rules.STOP)
_FILLED = (0, rules.STOP, 0, rules.FAST, 0, rules.FAST)


def make(options: Options | None = None) -> GridWorld:
    """Build the 7x7 world with the given options.

    Raises:
        UserError: If the spawn probability is not in [0, 1].
    """
    chosen = options or Options()
    p = chosen.spawn_probability
    if not 0.0 <= p <= 1.0:
        raise UserError(f"spawn_probability {p:g} is no probability: choose one in [0, 1]")
    at_random = ((_EMPTY, 1.0 - p), (_FILLED, p))
    return GridWorld(
        name="crossing7",
        options=chosen,
        features=(
            Feature("x_ego", 0, 7),
            Feature("v_ego", 0, 3),
            Feature("y_1", -1, 8),
            Feature("v_1", 0, 3),
            Feature("y_2", -1, 8),
            Feature("v_2", 0, 3),
        ),
        actions=("STOP", "SLOW", "FAST"),
        start=at_random if chosen.second_slot_at_start == "random" else ((_EMPTY, 1.0),),
        chance=(1.0 - p, p),
        horizon=rules.HORIZON,
        max_speed=rules.FAST,
        rules=partial(_step, chosen),
        env_weights=rewards.ENV_WEIGHTS,
        social_weights=rewards.SOCIAL_WEIGHTS,
        draw=draw,
    )


def _step(options: Options, state: Any, action: Any, chance: Any) -> Outcome:
    moved = rules.move(state, action, options)
    ending = rules.ending(moved, options)
    first, second = rules.refill(moved, chance == 1, options)
    after = jnp.stack([moved.ego_after, action, first.y, first.v, second.y, second.v])
    return Outcome(
        state=after.astype(jnp.int32),
        ending=ending,
        signals=rewards.signals(moved, ending, options),
        speed=jnp.asarray(action, jnp.float32),
    )
