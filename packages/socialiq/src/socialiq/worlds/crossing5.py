"""crossing5, the deterministic 5x5 proof of concept (thesis 5.1.1).

The ego goes or waits; another road user drives on unless blocked.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from socialiq.foreign import Later
from socialiq.types import Ending
from socialiq.worlds.grid_world import Feature, GridWorld, Outcome, Place

jnp: Any = Later("jax.numpy")


@dataclass(frozen=True)
class Options:
    """Options for what thesis 5.1.1 leaves open, each with its default and the reason for it.

    The defaults give the thesis' three expert sequences.
    """

    # Event that ends an episode before its 20 steps. The thesis names only the cap. With
    # `ego_arrival` value iteration gives the published sequences GGGG, WGGGG and WWWWGGGG; with
    # `both_arrived` the egoist takes a fifth step that has no effect.
    ends_on: Literal["ego_arrival", "both_arrived", "time_limit"] = "ego_arrival"
    # Steps in which r_social's -1 is charged. If it never stopped, the altruist would hurry to end
    # the episode (WGGGG), so the published WWWWGGGG needs the cost to stop.
    social_cost: Literal["until_other_arrives", "always"] = "until_other_arrives"
    # Whether +10 on arrival is added to that step's -1 or replaces it. No optimal sequence
    # changes; the text's "and" reads as a sum.
    arrival: Literal["added", "override"] = "added"


WAIT = 0
GO = 1
LAST = 4  # the far edge of the grid, where a road user has arrived
CONFLICT = 2  # both roads cross in cell (2, 2)
HORIZON = 20
ENV_WEIGHTS = {"step": -1.0, "arrival": 10.0}
SOCIAL_WEIGHTS = {"other_step": -1.0, "other_arrival": 10.0}


def _step(options: Options, state: Any, action: Any, _chance: Any) -> Outcome:
    """Move both road users at once (thesis 5.1.1).

    The vehicle on the crossing road holds for this step if its advance would put it into the
    conflict cell together with the ego's new position, so there are no collisions. The signals are
    0 or 1: under way and arrived, for each of both road users. `step` stops once the ego has
    arrived, which matters only if the episode continues after that.
    """
    ego = state[0]
    other = state[3]
    ego_after = jnp.minimum(ego + jnp.where(action == GO, 1, 0), LAST)
    advanced = jnp.minimum(other + 1, LAST)
    blocked = (advanced == CONFLICT) & (ego_after == CONFLICT)
    other_after = jnp.where(blocked, other, advanced)
    over = {
        "ego_arrival": ego_after == LAST,
        "both_arrived": (ego_after == LAST) & (other_after == LAST),
        "time_limit": jnp.zeros_like(blocked),
    }[options.ends_on]
    under_way = ego < LAST
    other_under_way = other < LAST
    arrival = under_way & (ego_after == LAST)
    other_arrival = other_under_way & (other_after == LAST)
    if options.arrival == "override":
        under_way = under_way & ~arrival
        other_under_way = other_under_way & ~other_arrival
    if options.social_cost == "always":
        other_under_way = jnp.ones_like(other_under_way)
    flags = {"step": under_way, "arrival": arrival}
    flags |= {"other_step": other_under_way, "other_arrival": other_arrival}
    return Outcome(
        state=jnp.stack([ego_after, state[1], state[2], other_after]).astype(jnp.int32),
        ending=jnp.where(over, int(Ending.ARRIVAL), int(Ending.NONE)),
        signals={name: jnp.asarray(flag, jnp.float32) for name, flag in flags.items()},
        speed=(ego_after - ego).astype(jnp.float32),
    )


def places(state: Sequence[int]) -> list[Place]:
    """Return the places of the ego and of the vehicle on the crossing road."""
    x_ego, y_ego, x_other, y_other = (int(value) for value in state)
    return [Place(0, x_ego, y_ego, 0), Place(1, x_other, y_other, 90)]


def make(options: Options | None = None) -> GridWorld:
    """Build the 5x5 world with the given options."""
    chosen = options or Options()
    ego = Feature("x_ego", 0, 5), Feature("y_ego", 2, 1)
    other = Feature("x_other", 2, 1), Feature("y_other", 0, 5)
    return GridWorld(
        name="crossing5",
        options=chosen,
        features=(*ego, *other),
        actions=("Wait", "Go"),
        start=(((0, 2, 2, 0), 1.0),),
        chance=(1.0,),
        horizon=HORIZON,
        max_speed=1,
        rules=partial(_step, chosen),
        env_weights=ENV_WEIGHTS,
        social_weights=SOCIAL_WEIGHTS,
        places=places,
        size=5,
        units=("ends_on", "social_cost", "arrival"),
    )
