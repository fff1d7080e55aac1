"""Factory of the 5x5 world."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax.numpy as jnp

from socialiq.worlds.crossing5 import rewards, rules
from socialiq.worlds.crossing5.options import Options
from socialiq.worlds.crossing5.render import draw
from socialiq.worlds.grid_world import Feature, GridWorld, Outcome


def make(options: Options | None = None) -> GridWorld:
    """Build the 5x5 world with the given options."""
    chosen = options or Options()
    return GridWorld(
        name="crossing5",
        options=chosen,
        features=(
            Feature("x_ego", 0, 5),
            Feature("y_ego", 2, 1),
            Feature("x_other", 2, 1),
            Feature("y_other", 0, 5),
        ),
        actions=("Wait", "Go"),
        start=(((0, 2, 2, 0), 1.0),),
        chance=(1.0,),
        horizon=rules.HORIZON,
        max_speed=1,
        rules=partial(_step, chosen),
        env_weights=rewards.ENV_WEIGHTS,
        social_weights=rewards.SOCIAL_WEIGHTS,
        draw=draw,
    )


def _step(options: Options, state: Any, action: Any, _chance: Any) -> Outcome:
    moved = rules.move(state[0], state[3], action)
    after = jnp.stack([moved.ego_after, state[1], state[2], moved.other_after])
    return Outcome(
        state=after.astype(jnp.int32),
        ending=rules.ending(moved, options),
        signals=rewards.signals(moved, options),
        speed=(moved.ego_after - moved.ego).astype(jnp.float32),
    )
