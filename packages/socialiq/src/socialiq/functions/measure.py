"""`evaluate`, `effects`, `solve` and `audit`: numbers of policies and worlds.

Each takes sequences, of worlds, angles and seeds for instance, and then returns one `Result` with a
row for each combination: its `table`, `to_csv()`, and `means()` over the seeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from socialiq.audit.profile.profile import Profile
from socialiq.cli.output import Result
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.functions.call import Angles, Drivers, Seeds, Worlds, over


def evaluate(
    policy: Drivers,
    world: Worlds = "crossing7",
    *,
    episodes: int = 0,
    angle: Angles = None,
    seed: Seeds = 0,
    data: str | Path | Demonstrations | None = None,
    **options: Any,
) -> Result:
    """Measure policies: exactly in a gridworld, or by episodes anywhere.

    Args:
        policy: A driver or several, as text (docs/grammar.md) or objects; or the outcome of
            `train`, whose angles and seeds are then columns of the table.
        world: The world or several, as text or object.
        episodes: Number of episodes; 0 evaluates exactly, which only gridworlds allow.
        angle: Angle in degrees, or several, of a dial and of the regret.
        seed: Seed of the episodes and of the bootstrap, or several.
        data: Demonstrations or their file, in the place of a world.
        **options: Further options of `socialiq evaluate` by name, as `soft`.

    Returns:
        Numbers of one policy by name; of several `policies` and `pooled`; of further sequences
        `policies`, the rows of the table.

    Raises:
        UserError: If an option is unknown, or policy and world don't go together.
    """
    options |= {"policies": policy, "world": world, "data": data}
    options |= {"episodes": episodes, "angle": angle, "seed": seed}
    columns = {"world": "world", "policies": "", "angle": "target_angle", "seed": "seed"}
    return over("evaluate", options, "policies", columns)


def effects(
    world: Worlds,
    driver: Drivers,
    *,
    episodes: int | None = None,
    angle: Angles = None,
    seed: Seeds | None = None,
    out: str | Path | None = None,
    **options: Any,
) -> Result:
    """Measure what drivers cause: metres that others lose, hard brakings, close encounters.

    Args:
        world: The world or several, as text or object.
        driver: A driver or several, as text (docs/grammar.md) or objects; or the outcome of
            `train`.
        episodes: Episodes of each driver on a road, 1000 by default.
        angle: Angles of dials, in degrees; 0, 15, ..., 90 by default.
        seed: Seed of the first episode, or several; 0 by default.
        out: Folder to make; of several worlds or seeds a folder each, as `out-seed1`.
        **options: Further options of `socialiq effects` by name, as `horizon` in seconds.

    Returns:
        Numbers of the measure, and of each driver at each angle `drivers`.

    Raises:
        UserError: If an option is unknown, or drivers and world don't go together.
    """
    options |= {"world": world, "policy": driver, "angle": angle, "out": out}
    options |= {"episodes": episodes, "seed": seed}
    return over("effects", options, "drivers", {"world": "world", "policy": "", "seed": "seed"})


def solve(
    world: Worlds,
    angle: float | Sequence[float] | Sequence[int] = 0.0,
    *,
    stationary: bool = False,
) -> Result:
    """Compute the exact optimum of a gridworld at social angles.

    Args:
        world: The world or several, as text or object.
        angle: Social angle in degrees, or several.
        stationary: Whether to use value iteration at discount 0.99, independent of time.

    Returns:
        Numbers of the optimum by name; of several worlds or angles `optima`.

    Raises:
        UserError: If the world can't be solved, or an angle is no angle.
    """
    options = {"world": world, "angle": angle, "stationary": stationary}
    return over("solve", options, "optima", {"world": "world", "angle": "angle"})


def audit(
    policy: str | Path | Sequence[str | Path],
    profile: str | Path | Profile | Sequence[str | Path | Profile],
    out: str | Path | None = None,
    *,
    episodes: int = 1000,
    seed: Seeds | None = None,
    **options: Any,
) -> Result:
    """Audit whether a policy behaves as its profile declares.

    Args:
        policy: A file, a rule, atlas:NAME, "python:FILE.py:NAME" or "process:COMMAND LINE", or
            several: the audit hashes it, so it is no object.
        profile: The declaration, or several: a file of `socialiq profile new`, or a `Profile`.
        out: Folder of the report to write, of several audits a folder each, as `out-seed1`; the
            audit log is beside it, or in this folder.
        episodes: Number of episodes of every driver.
        seed: Seed of a trial or a repetition, or several, which no log keeps; by default drawn
            after policy and profile were hashed.
        **options: Further options of `socialiq audit` by name, as `reference`.

    Returns:
        Content of `report.json`: `["verdict"]["decision"]` is pass, fail or inconclusive; of
        several audits `audits`, the rows of the table, and the reports as `outcomes`.

    Raises:
        UserError: If the request is invalid, or the policy fails on the way.
    """
    options |= {"policy": policy, "profile": profile, "out": out}
    options |= {"episodes": episodes, "seed": seed}
    columns = {"policy": "policy", "profile": "profile", "seed": "seed"}
    return over("audit", options, "audits", columns)
