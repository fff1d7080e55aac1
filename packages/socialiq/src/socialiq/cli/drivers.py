"""Drivers of the roads by name or file, and the gridworld of a policy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from socialiq.audit.request import of_classes, rule_of
from socialiq.cli.output import complain
from socialiq.errors import UserError, one_of
from socialiq.evaluation.dial import stands
from socialiq.evaluation.rollout import rollout_env
from socialiq.evaluation.simulate import Watched, observations_of
from socialiq.nn.actor_policy import ActorDial
from socialiq.nn.class_dial import ClassDial
from socialiq.nn.dial_policy import Dial, DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.unlikeness import USUAL_RATE
from socialiq.policies.interface import Interface, Loaded, read_content
from socialiq.policies.load import load_policy
from socialiq.storage import kind_of
from socialiq.types import Policy
from socialiq.worlds import SUMO_IDS, in_sumo, registry
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.highway.scenes import SCENES
from socialiq.worlds.highway.world import SceneWorld, world_of
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.world import World


@dataclass(frozen=True)
class Demand:
    """Demand of a world in SUMO."""

    demand: Path | None = None
    """File of trips, vehicles, flows and persons in SUMO's XML, in the place of drawn traffic."""

    @property
    def options(self) -> dict[str, Any]:
        """Options of the world."""
        return {} if self.demand is None else {"demand": str(self.demand)}


@dataclass(frozen=True)
class OnRoads(Demand):
    """Options of one road in the commands that take many worlds."""

    shield: float = 0.0
    """At an intersection with crosswalks: brake where the time to collision with a person on foot
    is below so many seconds; 0: don't."""
    shift: str = ""
    """Change of the intersection by name (late, unseen-30, noise-3, right, straight, connected,
    dense, wet, ...) or value (latency=1,unseen=.3); "or" stands between those that are drawn."""
    front_end: str = ""
    """Perception between sensors and policy, as latency=1,track=3,noise=1; known: as --shift has
    these. exit=own tells the policy its exit, if it was trained with --shift."""
    fallback: str = ""
    """Driver of the decisions whose state is unlike training, for a policy of `socialiq
    unlikeness`: gap_3s, wait, a file; with a rate of false alarms gap_3s=0.05, by default 0.01."""

    def check(self, world: str) -> None:
        """Refuse, by a `UserError`, what a world of this name has not."""
        if self.shield and world not in registry.WALKED:
            raise UserError(f"--shield is for people on foot: choose {registry.WALKED[0]}")
        roads = registry.INTERSECTIONS
        if (self.shift or self.front_end or self.fallback) and world not in roads:
            raise UserError(f"--shift, --front-end and --fallback are of {roads[0]}")
        if self.fallback and self.shield:
            raise UserError("either --fallback or --shield decides: leave one out")
        if self.demand and not in_sumo(world):
            raise UserError(f"--demand is of SUMO: choose {', '.join(SUMO_IDS)} or a network")


def driver_of(
    name: str, world: World, angle: float | None = None, allow_code: bool = False, seed: int = 0
) -> Loaded:
    """Return a driver of a world, with its record; a dial's angle in degrees is 0 by default.

    The name is of a rule (`seed` is of the random one), of a policy of the atlas (with or without
    `atlas:`), or as of `load_policy`; a file may take the time too.
    """
    if name in world.drivers:
        return rule_of(name, world, seed)
    if isinstance(world, Intersection):
        shipped = name.removeprefix("atlas:")
        names = atlas.names(atlas.CONTINUOUS_STUDIES if world.action_size else atlas.STUDIES)
        if shipped != name or shipped in names:
            name = str(atlas.path_for(shipped, world.options))
        elif ":" not in name and not Path(name).exists():
            one_of("driver", name, (*world.drivers, *names, "a policy file"))
    if ":" not in name:
        read_content(Path(name))  # says what is wrong with a path
    size = Interface.of(world)
    settings: dict[str, Any] = {"angle": angle or 0.0, "allow_code": allow_code, "clock": True}
    settings["action_size"] = size.action_size
    loaded = load_policy(name, size.n_features, size.n_actions, **settings, **of_classes(world))
    if (length := loaded.record.interface.n_features) < size.n_features:
        walks = isinstance(world, Intersection) and length > min(world.narrow) + 1
        unseen = "cyclists" if walks else "people on foot or on bicycles"
        complain(f"{name} observes fewer classes than are here: it does not see {unseen}")
    return loaded


def with_fallback(text: str, name: str, loaded: Loaded, world: World) -> Policy:
    """Return a driver, and where a state is unlike training `DRIVER` or `DRIVER=RATE`.

    Raises:
        UserError: If the driver has no score of unlikeness, or the text is wrong.
    """
    driver, _, rate = text.partition("=")
    if not text:
        return loaded.policy
    if not isinstance(loaded.policy, QPolicy):
        raise UserError(
            f"{name} is not one network: give --fallback a policy of `socialiq unlikeness`"
        )
    try:
        alarm = loaded.policy.alarm(float(rate or USUAL_RATE))
    except ValueError as error:
        raise UserError(f"--fallback {text}: give a rate as {driver}=0.05") from error
    return Watched(loaded.policy, alarm, driver_of(driver, world).policy)


def refuse_misfit(
    name: str, policy: DialPolicy | ActorDial, world: Intersection | SceneWorld
) -> None:
    """Refuse a policy or dial that was trained for another world; it may take the time too."""
    fits = policy.n_features in (world.n_features, world.n_features + 1)
    if isinstance(policy, ActorDial):
        observed = Interface.of(world)
        accepted = Interface(policy.n_features, 0, policy.action_size)
        if not fits or accepted.action_size != observed.action_size:
            accepted.check(name, observed)
    elif not (fits and policy.n_actions == world.n_actions):
        raise UserError(
            f"{name} takes {policy.n_features} features and {policy.n_actions} actions, the "
            f"{world.name} has {world.n_features} and {world.n_actions} (a clock adds a feature): "
            "name another policy"
        )


def dial_of(name: str) -> Dial[Any] | None:
    """Return the dial of a file, of discrete or continuous actions; None if it holds none."""
    kinds = {kind.KIND: kind for kind in (DialPolicy, ActorDial, ClassDial)}
    kind = kinds.get(kind_of(Path(name)))
    dial: Any = kind and kind.load(Path(name))
    return dial.of_class(_ANY_CLASS) if isinstance(dial, ClassDial) else dial


_ANY_CLASS = 45.0  # degrees, where only the range of a dial and whether it stands is of interest


def observed(world: Any, dial: Dial[Any]) -> np.ndarray:
    """Return observations for `complain_if_it_stands`: of all states of a table, or of episodes.

    A dial that takes the same actions of its own episodes at every angle drives the same ones.
    """
    if isinstance(world, Table):
        return world.observations()
    if isinstance(world, gymnasium.Env):
        return rollout_env(world, dial.at(dial.low), 1, 0).transitions.observation
    return observations_of(world.batch(16), dial.at(dial.low), range(16))


def complain_if_it_stands(name: str, dial: Dial[Any], observations: np.ndarray) -> None:
    """Say in one line on standard error if no angle of a dial changes an action."""
    if stands(dial, observations):
        complain(
            f"{name} takes the same actions at every angle from {dial.low:g} to {dial.high:g} "
            "degrees: train it with more --updates, or on demonstrations that differ more"
        )


def road_named(name: str) -> Intersection | SceneWorld:
    """Return the intersection, or another road of highway-env, with its default options."""
    return world_of(name) if name in SCENES else intersection_named(name)


def intersection_named(name: str, shift: str = "", front_end: str = "") -> Intersection:
    """Return the intersection with its default options, of discrete or continuous actions."""
    world = registry.make(name)
    assert isinstance(world, Intersection)
    return world.shifted(shift, front_end)


def gridworld_of(name: str, policy: Interface | DialPolicy | ClassDial) -> Table:
    """Return the gridworld that a policy or dial was trained in, with a clock if it uses one."""
    plain = registry.make_grid(name)
    for world in (plain, plain.with_clock()):
        if (world.n_features, world.n_actions) == (policy.n_features, policy.n_actions):
            return tabulate(world)
    raise UserError(
        f"the policy takes {policy.n_features} features and {policy.n_actions} actions, {name} "
        f"has {plain.n_features} (one more with a clock) and {plain.n_actions}: name the world it "
        "was trained for"
    )
