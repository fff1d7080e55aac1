"""crosswalk7, the 7x7 crossing with a crosswalk in the cell behind the conflict cell.

An ego that waits for a pedestrian in the conflict cell blocks the vehicles. Vehicles are those of
crossing7. r_social is a sum over the classes of road users, weighed by the class angle.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

from socialiq.errors import UserError
from socialiq.foreign import Later
from socialiq.social.angle import check_class_angle
from socialiq.types import Ending
from socialiq.worlds import crossing7
from socialiq.worlds.crossing7 import CONFLICT, SLOW, STOP
from socialiq.worlds.grid_world import Feature, GridWorld, Outcome, Place

jnp: Any = Later("jax.numpy")


@dataclass(frozen=True)
class Options(crossing7.Options):
    """Options of the pedestrians; those of crossing7 hold for the vehicles."""

    # Probability per step that a pedestrian arrives where none waits.
    pedestrian_probability: float = 0.2
    # Probability per step that a pedestrian who has waited for three steps or more walks although
    # the ego may come.
    impatience: float = 0.5
    # Angle b in degrees, 0 to 90, of the class weights (cos b, sin b) of vehicles and pedestrians
    # in r_social. 45 weighs both alike; 0 leaves out pedestrians, as the thesis does.
    class_angle: float = 45.0


CROSSWALK = CONFLICT + 1  # column of the crosswalk on the ego's road
LONGEST = 4  # value of the feature for a pedestrian who has waited for three steps or more
FAR = 3  # cells before the crosswalk from which a pedestrian walks ahead of a slow ego
VULNERABLE_WEIGHTS = {"pedestrian_delay": -0.5, "pedestrian_hit": -10.0}


def _step(options: Options, state: Any, action: Any, chance: Any) -> Outcome:
    """Move the ego and the vehicles as in crossing7, and a pedestrian.

    The last feature is 0 without a pedestrian, else one more than the steps of waiting so far, at
    most `LONGEST`. A pedestrian walks if the ego is beyond the crosswalk, stands before it, or is
    `FAR` and slow; if the ego stays on the crosswalk, no one walks. The pedestrian is hit if the
    ego enters or passes over the crosswalk in the step of the walk; the episode ends, and a
    collision with a vehicle precedes it. Each step that a pedestrian does not walk is a delay that
    the ego causes: without it everyone walks at once.
    """
    road = crossing7.step(options, state[:-1], action, chance % 2)
    arrives = chance // 2 % 2 == 1
    insists = chance // 4 == 1
    before = state[0]
    speed = state[1]
    waited = state[-1]
    after = road.state[0]
    present = waited > 0
    free = (before > CROSSWALK) | ((before < CROSSWALK) & (speed == STOP))
    free |= (CROSSWALK - before >= FAR) & (speed <= SLOW)
    blocked = (before == CROSSWALK) & (after == CROSSWALK)
    walks = present & ~blocked & (free | ((waited == LONGEST) & insists))
    hit = walks & (before < CROSSWALK) & (after >= CROSSWALK) & (road.ending == Ending.NONE)
    follows = jnp.where(walks, 0, jnp.minimum(waited + 1, LONGEST))
    follows = jnp.where(present, follows, jnp.where(arrives, 1, 0))
    signals = dict(road.signals)
    for name in ("speed", "step"):
        signals[name] = jnp.where(hit, 0.0, signals[name])
    signals["collision"] = jnp.where(hit, 1.0, signals["collision"])
    signals["pedestrian_delay"] = jnp.asarray(present & ~walks, jnp.float32)
    signals["pedestrian_hit"] = jnp.asarray(hit, jnp.float32)
    return Outcome(
        state=jnp.append(road.state, follows).astype(jnp.int32),
        ending=jnp.where(hit, int(Ending.COLLISION), road.ending),
        signals=signals,
        speed=road.speed,
    )


def places(state: Sequence[int]) -> list[Place]:
    """Return the places of the ego, the vehicles, and the pedestrian who waits at the crosswalk."""
    users = crossing7.places(state[:-1])
    if int(state[-1]):
        users.append(Place(3, CROSSWALK, CONFLICT - 1, 90, on_foot=True))
    return users


def make(options: Options | None = None) -> GridWorld:
    """Build the world with the given options; probabilities must lie in [0, 1]."""
    chosen = options or Options()
    road = crossing7.make(chosen)
    for name in ("pedestrian_probability", "impatience"):
        p = getattr(chosen, name)
        if not 0.0 <= p <= 1.0:
            raise UserError(f"{name} {p:g} is not a probability: choose one in [0, 1]")
    walk = chosen.pedestrian_probability
    insist = chosen.impatience
    chances = product((1.0 - insist, insist), (1.0 - walk, walk), road.chance)
    return GridWorld(
        name="crosswalk7",
        options=chosen,
        features=(*road.features, Feature("waited", 0, LONGEST + 1)),
        actions=road.actions,
        start=tuple(((*state, 0), p) for state, p in road.start),
        chance=tuple(a * b * c for a, b, c in chances),
        horizon=road.horizon,
        max_speed=road.max_speed,
        rules=partial(_step, chosen),
        env_weights=road.env_weights,
        social_weights=road.social_weights,
        places=places,
        size=road.size,
        units=(*road.units, "class_angle"),
        vulnerable_weights=VULNERABLE_WEIGHTS,
        class_angle=check_class_angle(chosen.class_angle),
        crosswalk=CROSSWALK,
    )
