"""`collect` and `export`: demonstrations of drivers, and policies for other programs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, overload

from socialiq.cli.data import Mode
from socialiq.cli.export import FORMATS, HUB
from socialiq.cli.output import Policies, Result
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import one_of
from socialiq.functions.call import Angles, Drivers, Seeds, Worlds, over
from socialiq.nn.saved import Saved
from socialiq.policies.interface import Loaded
from socialiq.reading import path_of
from socialiq.types import Policy
from socialiq.worlds.world import World


@overload
def collect(
    world: str | World,
    driver: Drivers | Mapping[str, Any] = (),
    *,
    episodes: int = 60,
    seed: int = 0,
    out: str | Path | None = None,
    **options: Any,
) -> Demonstrations: ...


@overload
def collect(
    world: Worlds,
    driver: Drivers | Mapping[str, Any] = (),
    *,
    episodes: int = 60,
    seed: Seeds = 0,
    out: str | Path | None = None,
    **options: Any,
) -> Any: ...


def collect(
    world: Worlds,
    driver: Drivers | Mapping[str, Any] = (),
    *,
    episodes: int = 60,
    seed: Seeds = 0,
    out: str | Path | None = None,
    **options: Any,
) -> Demonstrations | Result:
    """Return demonstrations of drivers of different intent, as `socialiq collect` writes them.

    Args:
        world: The world or several, as text or object.
        driver: A driver, several, or drivers by the name of their mode; none stands for the exact
            experts of a gridworld.
        episodes: Episodes of each driver, or in all for `weighted` and `contaminated`.
        seed: Seed of the rollouts and of the draw, or several.
        out: File to write too; must not exist. Of several worlds or seeds a file each, as
            `mixed-seed1.safetensors`.
        **options: Further options of the command by name, as `mixture` or `clock`.

    Returns:
        The mixed demonstrations; of several worlds or seeds a `Result` with their counts, whose
        `outcomes` are the demonstrations.

    Raises:
        UserError: If an option is unknown, or world and drivers don't go together.
    """
    if isinstance(driver, Mapping):
        driver = tuple(Mode(name, policy) for name, policy in driver.items())
    options |= {"world": world, "driver": driver, "episodes": episodes, "seed": seed, "out": out}

    def work(command: Any) -> Demonstrations:
        return command.demonstrations() if out is None else command.written()[0]

    return over("collect", options, "demonstrations", {"world": "world", "seed": "seed"}, work)


def export(
    policy: str | Path | Saved | Policy | Loaded | Policies,
    out: str | Path,
    *,
    format: str | None = None,
    angle: Angles = None,
    **options: Any,
) -> Result:
    """Write a policy for other programs, as `socialiq export`.

    Args:
        policy: The policy, as file, name of the atlas or object; a dial with its angle, as
            `dial.safetensors@45` or by `angle`; or the outcome of `train`.
        out: File to write; must not exist. Of several policies or angles a file each, as
            `dial-angle45.onnx`.
        format: onnx, torch, card, bom or hub; by default that of the ending: .onnx, .safetensors,
            .md, .json, or a folder.
        angle: Social angle of a dial in degrees, or several.
        **options: Further options of the command by name, as `front_end`.

    Returns:
        What was written: file, format, bytes, SHA-256; of several files `files`.

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
    return over("export", options, "files", {"policy": "", "angle": "angle"})
