"""`evaluate`, `effects`, `solve` and `audit`: numbers of policies and worlds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.audit.profile.profile import Profile
from socialiq.cli.output import Result
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.functions.call import Drivers, called, command_of
from socialiq.worlds.grammar import text_of
from socialiq.worlds.world import World


def evaluate(
    policy: Drivers,
    world: str | World = "crossing7",
    *,
    episodes: int = 0,
    angle: float | Sequence[float] | None = None,
    seed: int = 0,
    data: str | Path | Demonstrations | None = None,
    **options: Any,
) -> Result:
    """Measure policies: exactly in a gridworld, or by episodes anywhere.

    Args:
        policy: A driver or several, as text (docs/grammar.md) or objects.
        world: The world, as text or object.
        episodes: Number of episodes; 0 evaluates exactly, which only gridworlds allow.
        angle: Angle in degrees of a dial and of the regret; several measure each policy at each.
        seed: Seed of the episodes and of the bootstrap.
        data: Demonstrations or their file, in the place of a world.
        **options: Further options of `socialiq evaluate` by name, as `soft`.

    Returns:
        Numbers of one policy by name; of several `policies` and `pooled`.

    Raises:
        UserError: If an option is unknown, or policy and world don't go together.
    """
    options |= {"policies": policy, "world": text_of(world), "data": data}
    options |= {"episodes": episodes, "seed": seed}
    commands = [command_of("evaluate", options | {"angle": turn}) for turn in _listed(angle)]
    with called(commands[0]) as command:
        return command.result(commands)


def effects(
    world: str | World,
    driver: Drivers,
    *,
    episodes: int | None = None,
    angle: float | Sequence[float] | None = None,
    seed: int | None = None,
    out: str | Path | None = None,
    **options: Any,
) -> Result:
    """Measure what drivers cause: metres that others lose, hard brakings, close encounters.

    Args:
        world: The world, as text or object.
        driver: A driver or several, as text (docs/grammar.md) or objects.
        episodes: Episodes of each driver on a road, 1000 by default.
        angle: Angles of dials, in degrees; 0, 15, ..., 90 by default.
        seed: Seed of the first episode, 0 by default.
        out: Folder to make.
        **options: Further options of `socialiq effects` by name, as `horizon` in seconds.

    Returns:
        Numbers of the measure, and of each driver at each angle `drivers`.

    Raises:
        UserError: If an option is unknown, or drivers and world don't go together.
    """
    options |= {"world": text_of(world), "policy": driver, "angle": angle, "out": out}
    with called(command_of("effects", options | {"episodes": episodes, "seed": seed})) as command:
        return command.result()


def solve(
    world: str | World, angle: float | Sequence[float] = 0.0, *, stationary: bool = False
) -> Result:
    """Compute the exact optimum of a gridworld at social angles.

    Args:
        world: The world, as text or object.
        angle: Social angle in degrees, or several.
        stationary: Whether to use value iteration at discount 0.99, independent of time.

    Returns:
        Numbers of the optimum by name; of several angles `optima`.

    Raises:
        UserError: If the world can't be solved, or an angle is no angle.
    """
    options = {"world": text_of(world), "stationary": stationary}
    results = list[Result]()
    for degrees in _listed(angle):
        with called(command_of("solve", options | {"angle": degrees})) as command:
            results.append(command.result())
    if len(results) == 1:
        return results[0]
    rows = [dict(result) for result in results]
    return Result({"world": options["world"], "optima": rows}, rows)


def audit(
    policy: str | Path,
    profile: str | Path | Profile,
    out: str | Path | None = None,
    *,
    episodes: int = 1000,
    seed: int | None = None,
    **options: Any,
) -> Result:
    """Audit whether a policy behaves as its profile declares.

    Args:
        policy: A file, a rule, atlas:NAME, "python:FILE.py:NAME" or "process:COMMAND LINE": the
            audit hashes it, so it is no object.
        profile: The declaration: a file of `socialiq profile new`, or a `Profile`.
        out: Folder of the report to write; the audit log is beside it, or in this folder.
        episodes: Number of episodes of every driver.
        seed: Seed of a trial or a repetition, which no log keeps; by default drawn after policy
            and profile were hashed.
        **options: Further options of `socialiq audit` by name, as `reference`.

    Returns:
        Content of `report.json`: `["verdict"]["decision"]` is pass, fail or inconclusive.

    Raises:
        UserError: If the request is invalid, or the policy fails on the way.
    """
    options |= {"policy": policy, "profile": profile, "out": out, "episodes": episodes}
    with called(command_of("audit", options | {"seed": seed})) as command:
        return command.result()


def _listed(angle: Any) -> list[float | None]:
    """Return one or several angles as a list."""
    return [angle] if angle is None or np.ndim(angle) == 0 else list(angle)
