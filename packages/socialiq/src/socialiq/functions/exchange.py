"""`collect` and `export`: demonstrations of drivers, and policies for other programs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from socialiq.cli.data import Mode
from socialiq.cli.export import FORMATS, HUB
from socialiq.cli.output import Result
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import one_of
from socialiq.functions.call import Drivers, called, command_of
from socialiq.nn.saved import Saved
from socialiq.policies.interface import Loaded
from socialiq.reading import path_of
from socialiq.types import Policy
from socialiq.worlds.grammar import text_of
from socialiq.worlds.world import World


def collect(
    world: str | World,
    driver: Drivers | Mapping[str, Any] = (),
    *,
    episodes: int = 60,
    seed: int = 0,
    out: str | Path | None = None,
    **options: Any,
) -> Demonstrations:
    """Return demonstrations of drivers of different intent, as `socialiq collect` writes them.

    Args:
        world: The world, as text or object.
        driver: A driver, several, or drivers by the name of their mode; none stands for the exact
            experts of a gridworld.
        episodes: Episodes of each driver, or in all for `weighted` and `contaminated`.
        seed: Seed of the rollouts and of the draw.
        out: File to write too; must not exist.
        **options: Further options of the command by name, as `mixture` or `clock`.

    Returns:
        The mixed demonstrations.

    Raises:
        UserError: If an option is unknown, or world and drivers don't go together.
    """
    if isinstance(driver, Mapping):
        driver = tuple(Mode(name, policy) for name, policy in driver.items())
    options |= {"world": text_of(world), "driver": driver, "episodes": episodes, "seed": seed}
    with called(command_of("collect", options | {"out": out})) as command:
        return command.demonstrations() if out is None else command.written()[0]


def export(
    policy: str | Path | Saved | Policy | Loaded,
    out: str | Path,
    *,
    format: str | None = None,
    angle: float | None = None,
    **options: Any,
) -> Result:
    """Write a policy for other programs, as `socialiq export`.

    Args:
        policy: The policy, as file, name of the atlas or object; a dial with its angle, as
            `dial.safetensors@45` or by `angle`.
        out: File to write; must not exist.
        format: onnx, torch, card, bom or hub; by default that of the ending: .onnx, .safetensors,
            .md, .json, or a folder.
        angle: Social angle of a dial, in degrees.
        **options: Further options of the command by name, as `front_end`.

    Returns:
        What was written: file, format, bytes, SHA-256.

    Raises:
        UserError: If the policy or the format is unknown, or the file exists.
    """
    out = path_of(out)
    policy = policy.policy if isinstance(policy, Loaded) else policy
    if format is None:
        formats = {ending: name for name, endings in FORMATS.items() for ending in endings}
        one_of("ending", out.suffix, ["", *formats])
        format = formats.get(out.suffix, HUB)
    options |= {"policy": policy, "out": out, "format": format, "angle": angle}
    with called(command_of("export", options)) as command:
        return command.result()
