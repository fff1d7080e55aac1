"""Drivers of the roads by name or file, and the gridworld of a policy."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from socialiq.audit.profile.environment import Environment
from socialiq.cli.output import complain
from socialiq.errors import UserError
from socialiq.evaluation.dial import stands
from socialiq.evaluation.rollout import rollout_env
from socialiq.evaluation.simulate import Watched, observations_of
from socialiq.foreign import one_line
from socialiq.nn.actor_policy import ActorDial
from socialiq.nn.class_dial import ClassDial
from socialiq.nn.dial_policy import Dial, DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.unlikeness import USUAL_RATE
from socialiq.policies import drivers
from socialiq.policies.interface import Interface, Loaded
from socialiq.policies.load import load_policy, name_of
from socialiq.storage import kind_of
from socialiq.types import ROWS, Policy
from socialiq.worlds import catalogue, grammar, registry
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.environment import action_size, is_environment, sizes
from socialiq.worlds.files import names_file
from socialiq.worlds.grammar import Written
from socialiq.worlds.highway.options import FEATURES
from socialiq.worlds.highway.people import PeopleOptions
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
    """Seconds to a collision with a person below which the ego brakes, in a world with people; 0:
    it doesn't."""
    shift: str = ""
    """Change of a road by name (late, unseen-30, noise-3; of the intersection also right, straight,
    connected, dense, wet, ...) or value (latency=1,unseen=.3); "or" stands between those that are
    drawn."""
    front_end: str = ""
    """Perception between sensors and policy, as latency=1,track=3,noise=1; known: as --shift has
    these. exit=own tells the policy its exit, if it was trained with --shift."""
    fallback: str = ""
    """Driver of the decisions whose state is unlike training, for a policy of `socialiq
    unlikeness`: gap_3s, wait, a file; with a rate of false alarms gap_3s=0.05, by default 0.01."""

    def written(self, world: str, policies: Sequence[Any] = ()) -> Written:
        """Return the world of a text with these options laid over it.

        Args:
            world: The text.
            policies: Drivers of the world, which shows what they observe.

        Raises:
            UserError: If the world lacks what an option changes, or both give it.
        """
        world = drivers.world_for(world, policies)
        plain = grammar.parse(world)
        given = {"shift": self.shift, "front_end": self.front_end, **self.options}
        given = {key: value for key, value in given.items() if value}
        for key in given:
            if key in plain.options:
                raise UserError(f"--{key.replace('_', '-')} and {key} of the world: leave one out")
        self._check(plain)
        return grammar.parse(world, given)

    def _check(self, world: Written) -> None:
        """Refuse, by a `UserError`, what a world has not."""
        if self.shield and world.name in catalogue.GRIDS:
            raise UserError(
                "--shield is for people on foot, and a gridworld has no seconds to a collision: "
                "choose intersection,people=0.1"
            )
        if (self.shift or self.front_end) and not catalogue.is_road(world.name):
            why = "shows policies what its own code makes of a state: change it there"
            if world.name in catalogue.GRIDS:
                why = "is a gridworld, which has no sensor and no latency"
            raise UserError(f"--shift and --front-end are of a road; {one_line(world.name)} {why}")
        if self.fallback and self.shield:
            raise UserError("either --fallback or --shield decides: leave one out")


def with_one_ego(written: Written) -> World:
    """Return the world that is written, of which one vehicle is controlled.

    Raises:
        UserError: If there are several agents.
    """
    world = grammar.build_written(written)
    if world.agents > 1:
        raise UserError(
            f"{world.agents} agents are driven by `socialiq population`: leave agents out here"
        )
    return world


def world_of(written: Written, allow_code: bool = False, needs_pair: bool = True) -> World:
    """Return the world that is written, of one ego: of this package, or an environment.

    Args:
        written: The world.
        allow_code: Whether the module of an environment may be imported.
        needs_pair: Whether an environment must give a pair; else a scalar reward is r_env.

    Raises:
        UserError: If it has several agents, or an environment can't be made or gives no pair.
    """
    if written.is_built or not is_environment(written.name):
        return with_one_ego(written)
    return Environment.of(written.name, written.options, allow_code, needs_pair)


def driver_of(
    name: Any, world: World, angle: float | None = None, allow_code: bool = False, seed: int = 0
) -> Loaded:
    """Return a driver of a world, as `policies.drivers.driver_of`; say which people it overlooks.

    Args:
        name: The driver.
        world: The world.
        angle: Angle of a dial in degrees; 0 by default.
        allow_code: Whether a named Python module may run.
        seed: Seed of the random rule.
    """
    loaded = drivers.driver_of(name, world, angle, allow_code, seed)
    length = loaded.record.interface.n_features
    if length < world.n_features:
        options: Any = getattr(world, "options", None)
        known = length // len(FEATURES)
        classes = options.unseen(known) if isinstance(options, PeopleOptions) else ("people",)
        unseen = " or ".join(classes)
        name = name_of(name)
        complain(f"{name} observes fewer classes than are here: it does not see {unseen}")
    return loaded


def driver_in(
    env: gymnasium.Env[Any, Any],
    text: Any,
    written: Written,
    angle: float | None = None,
    allow_code: bool = False,
    seed: int = 0,
    clock: bool = False,
) -> Loaded:
    """Return a driver of an environment; in SUMO those of the intersection drive.

    Args:
        env: The environment, as `make_environment` makes it.
        text: The driver, in the grammar of `policies.drivers`.
        written: World of the environment.
        angle: Angle of a dial in degrees; 0 by default.
        allow_code: Whether a named Python module may run.
        seed: Seed of the random rule.
        clock: Whether a policy may take the time too.
    """
    if written.in_sumo:
        shows_route = getattr(env.unwrapped, "schema", ROWS) != ROWS
        schema = {"observation": "route"} if shows_route else {}
        like = grammar.build(catalogue.INTERSECTION, schema)
        return driver_of(text, like, angle, allow_code, seed)
    world: Any = getattr(env.unwrapped, "world", None)
    driver = drivers.parse(text)
    if isinstance(world, World) and (world.is_exact or drivers.is_word(driver.spec)):
        return driver_of(text, world, angle, allow_code, seed)
    if driver.spec == drivers.RANDOM:
        return drivers.at_random(Interface(*sizes(env), action_size(env)), seed)
    if driver.front_end and not isinstance(world, World):
        raise UserError(
            f"the sensors of {written.name} are not known: leave +{driver.front_end} out"
        )
    settings: dict[str, Any] = {"angle": driver.at(angle) or 0.0, "allow_code": allow_code}
    of_classes = drivers.of_classes(world, driver.class_angle)
    settings |= {"clock": clock, **of_classes, "narrow": ()}
    loaded = load_policy(driver.spec, *sizes(env), action_size=action_size(env), **settings)
    return drivers.finished(driver, loaded, world)


def with_fallback(text: str, name: Any, loaded: Loaded, read: Callable[[str], Loaded]) -> Policy:
    """Return a driver that hands over to another one where a state is unlike training.

    Args:
        text: The other driver, as `DRIVER` or `DRIVER=RATE` with its rate of false alarms; "" for
            none.
        name: Name of the first driver, for messages.
        loaded: The first driver.
        read: Function that returns a driver of the world by its name.

    Raises:
        UserError: If the driver has no score of unlikeness, or the text is wrong.
    """
    driver, _, rate = text.partition("=")
    if not text:
        return loaded.policy
    if not isinstance(loaded.policy, QPolicy):
        raise UserError(
            f"{name_of(name)} is not one network: give --fallback a policy of `socialiq unlikeness`"
        )
    try:
        alarm = loaded.policy.alarm(float(rate or USUAL_RATE))
    except ValueError as error:
        raise UserError(f"--fallback {text}: give a rate as {driver}=0.05") from error
    return Watched(loaded.policy, alarm, read(driver).policy)


def refuse_misfit(name: str, policy: DialPolicy | ActorDial, world: World) -> None:
    """Refuse a policy or dial of another world; where one shows the time, it may take that too.

    Args:
        name: Name of the policy, for the message.
        policy: The policy or dial.
        world: World that it is to drive in.

    Raises:
        UserError: If the policy's observations or actions are not the world's.
    """
    fits = policy.n_features in (world.n_features, world.n_features + world.shows_time)
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


def dial_of(name: Any, world: str = "") -> Dial[Any] | None:
    """Return a dial, or that of a file, of discrete or continuous actions; else None.

    Args:
        name: The driver.
        world: The world, as text. In that of a file a rule may have the name of the driver that
            ships, which then has an angle.
    """
    driver = drivers.parse(name)
    dial = driver.spec
    if driver.angle is not None or not (world and names_file(grammar.parse(world).name)):
        dial = drivers.file_of(dial)
    kinds = {kind.KIND: kind for kind in (DialPolicy, ActorDial, ClassDial)}
    if isinstance(dial, str):
        kind = kinds.get(kind_of(Path(dial)))
        dial = kind and kind.load(Path(dial))
    elif not isinstance(dial, tuple(kinds.values())):
        dial = None
    return dial.of_class(_ANY_CLASS) if isinstance(dial, ClassDial) else dial


_ANY_CLASS = 45.0  # degrees, where only the range of a dial and whether it stands is of interest


def observed(world: Any, dial: Dial[Any]) -> np.ndarray:
    """Return observations for `complain_if_it_stands`.

    If the dial takes the same actions in its episodes at every angle, it drives the same episodes
    at every angle, so those of its first angle are enough.

    Args:
        world: A table, an environment, or a road.
        dial: The dial, which drives at its first angle.

    Returns:
        Shape (row, feature): all states of a table, or the states of one episode of an environment
        or of 16 episodes of a road.
    """
    if isinstance(world, Table):
        return world.observations()
    if isinstance(world, gymnasium.Env):
        return rollout_env(world, dial.at(dial.low), 1, 0).transitions.observation
    return observations_of(world.batch(16), dial.at(dial.low), range(16))


def complain_if_it_stands(name: Any, dial: Dial[Any], observations: np.ndarray) -> None:
    """Say in one line on standard error if no angle of a dial changes an action.

    Args:
        name: Name of the dial, for the message.
        dial: The dial.
        observations: Observations at which its actions are compared, shape (row, feature).
    """
    if stands(dial, observations):
        complain(
            f"{name_of(name)} takes the same actions at every angle from {dial.low:g} to "
            f"{dial.high:g} degrees: train it with more --updates, or on demonstrations that "
            "differ more"
        )


def gridworld_of(name: str, policy: Interface | DialPolicy | ClassDial) -> Table:
    """Return the gridworld that a policy or dial was trained in, with a clock if it uses one.

    Args:
        name: Name of the gridworld.
        policy: Policy or dial, or its interface.

    Raises:
        UserError: If it fits the gridworld neither with a clock nor without.
    """
    plain = registry.make_grid(name)
    for world in (plain, plain.with_clock()):
        if (world.n_features, world.n_actions) == (policy.n_features, policy.n_actions):
            return tabulate(world)
    raise UserError(
        f"the policy takes {policy.n_features} features and {policy.n_actions} actions, {name} "
        f"has {plain.n_features} (one more with a clock) and {plain.n_actions}: name the world it "
        "was trained for"
    )
