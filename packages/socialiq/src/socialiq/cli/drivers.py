"""Drivers of the roads by name or file, and the gridworld of a policy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from socialiq.audit.request import rule_of
from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq.nn.actor_policy import ActorDial
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import ValuePolicy
from socialiq.policies.interface import Interface, Loaded
from socialiq.policies.load import load_policy
from socialiq.storage import kind_of
from socialiq.types import Policy
from socialiq.worlds import CONTINUOUS
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.highway.scenes import SCENES
from socialiq.worlds.highway.world import SceneWorld, world_of
from socialiq.worlds.intersection import atlas, policies
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import continuous_options, make_grid
from socialiq.worlds.situation import load_driver


def driver_of(name: str, seed: int = 0, options: Options | None = None) -> Policy:
    """Return a driver of the intersection.

    Args:
        name: Name of a rule or of a policy of the atlas (with or without `atlas:`), or a file.
        seed: Seed of the random driver.
        options: Scenario of the driver; with continuous actions as `continuous_driver_of`.

    Raises:
        UserError: If it is none of these, or the policy was trained for another world.
    """
    if options is not None and options.continuous:
        return continuous_driver_of(name, Intersection(options), seed=seed).policy
    if name in policies.NAMES:
        return policies.policy(name, seed)
    name, shipped = name.removeprefix("atlas:"), atlas.names()
    if name not in shipped and not Path(name).exists():
        one_of("driver", name, (*policies.NAMES, *shipped, "a policy file"))
    policy = atlas.load(name) if name in shipped else load_driver(Path(name))
    refuse_misfit(name, policy, Intersection(options or Options()))
    return policy


def continuous_driver_of(
    name: str, world: Intersection, angle: float = 0.0, allow_code: bool = False, seed: int = 0
) -> Loaded:
    """Return a driver of the intersection with continuous actions, with its record.

    Args:
        name: Name of a rule or of a policy of the atlas with such actions (with or without
            `atlas:`), or a policy as of `load_policy`; a file of this package may see the time too.
        world: The intersection.
        angle: Of a dial, in degrees.
        allow_code: As of `load_policy`.
        seed: Seed of the random driver.

    Raises:
        UserError: If it is none of these, or the policy was trained for another world.
    """
    if name in policies.NAMES:
        return rule_of(name, world, seed)
    shipped, names = name.removeprefix("atlas:"), atlas.names(atlas.CONTINUOUS_STUDIES)
    if shipped != name or shipped in names:
        name = str(atlas.path_for(shipped, world.options))
    elif ":" not in name and not Path(name).exists():
        one_of("driver", name, (*policies.NAMES, *names, "a policy file"))
    settings: dict[str, Any] = {"angle": angle, "allow_code": allow_code, "clock": True}
    return load_policy(name, world.n_features, 0, action_size=world.action_size, **settings)


def driver_on(
    world: Intersection | SceneWorld, name: str, angle: float | None = None, seed: int = 0
) -> Policy:
    """Return a driver of a road.

    Args:
        world: The road.
        name: A policy file, which may take the time too; at the intersection as of `driver_of`.
        angle: Of a dial, in degrees; None is 0, and of all else.
        seed: Seed of the random driver.

    Raises:
        UserError: If it is none of these, was made for another world, or is no dial and an angle is
            given.
    """
    path = Path(name)
    dial = path.is_file() and kind_of(path) in (DialPolicy.KIND, ActorDial.KIND)
    if angle is not None and not dial:
        raise UserError(f"--angle is of a dial, which {one_line(name)} is not: leave it out")
    if isinstance(world, Intersection) and not dial:
        return driver_of(name, seed, world.options)
    if not path.exists():
        raise UserError(f"no such file: {one_line(name)}: name a policy file")
    size = Interface.of(world)
    settings: dict[str, Any] = {"action_size": size.action_size, "angle": angle or 0.0}
    return load_policy(name, size.n_features, size.n_actions, clock=True, **settings).policy


def refuse_misfit(
    name: str, policy: ValuePolicy | DialPolicy | ActorDial, world: Intersection | SceneWorld
) -> None:
    """Raise an error for a policy or dial that was trained for another world.

    It may have the time as a further feature (`evaluation.simulate.play`).

    Raises:
        UserError: If the numbers of features or actions differ.
    """
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


def road_named(name: str) -> Intersection | SceneWorld:
    """Return the intersection, or another road of highway-env, with its default options."""
    if name in CONTINUOUS:
        return Intersection(continuous_options(name))
    return world_of(name) if name in SCENES else Intersection(Options())


def gridworld_of(name: str, policy: ValuePolicy | DialPolicy) -> Table:
    """Return the gridworld that a policy or dial was trained in, with a clock if it uses one.

    Raises:
        UserError: If the world is unknown, or fits neither with nor without a clock.
    """
    plain = make_grid(name)
    for world in (plain, plain.with_clock()):
        if (world.n_features, world.n_actions) == (policy.n_features, policy.n_actions):
            return tabulate(world)
    raise UserError(
        f"the policy takes {policy.n_features} features and {policy.n_actions} actions, {name} "
        f"has {plain.n_features} (one more with a clock) and {plain.n_actions}: name the world it "
        "was trained for"
    )
