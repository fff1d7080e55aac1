"""`world`, `driver` and `load`: what the functions and commands take, as objects."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from socialiq.audit.profile import reader
from socialiq.cli import drivers
from socialiq.cli.output import Policies, as_function
from socialiq.demonstrations import files
from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq.nn.saved import FORMS, Saved
from socialiq.policies.drivers import world_for
from socialiq.policies.interface import Loaded
from socialiq.reading import path_of
from socialiq.storage import kind_of, read_json, shipped
from socialiq.types import Policy
from socialiq.worlds import grammar
from socialiq.worlds.environment import make_environment
from socialiq.worlds.files import is_world_file
from socialiq.worlds.registry import open_world
from socialiq.worlds.world import World


def world(name: str | World, **options: Any) -> World:
    """Return a world of a text.

    Args:
        name: The world, as `intersection,people=0.1` (docs/grammar.md); or a world, for one with
            further options.
        **options: Options by key, laid over those of the text.

    Raises:
        UserError: If the world, an option or a value is unknown.
    """
    return open_world(name, **options)


def driver(
    name: str | Path | Saved | Policy,
    world: str | World,
    angle: float | None = None,
    *,
    seed: int = 0,
    allow_code: bool = False,
) -> Loaded:
    """Return a driver of a world: its `predict` chooses actions, its `record` has its facts.

    Args:
        name: The driver, as `gap_3s` or `dial.safetensors@45` (docs/grammar.md); or a policy or
            dial.
        world: World that it drives in, as text or object.
        angle: Angle of a dial in degrees; 0 by default.
        seed: Seed of the random rule.
        allow_code: Whether a named Python module may run.

    Returns:
        The driver; a context manager, which ends the process of a driver that is a program.

    Raises:
        UserError: If there is no such driver, or it doesn't fit the world.
    """
    written = grammar.parse(world_for(grammar.text_of(world), [name]))
    how = angle, allow_code, seed
    with as_function():
        if written.is_built:
            return drivers.driver_of(name, grammar.build_written(written), *how)
        env = make_environment(*written, allow_code=allow_code, continuous=True)
        return drivers.driver_in(env, name, written, *how)


def load(path: str | Path) -> Any:
    """Read any file or folder that this package writes.

    Args:
        path: Demonstrations, a policy or a dial, a world, a profile (.toml), a run's folder.

    Returns:
        `Demonstrations`; the policy or the dial; the world; the profile; or of a run its numbers,
        with `trained`, its policies or dials.

    Raises:
        UserError: If the file is missing, damaged, or none of these.
    """
    place = shipped(path_of(path))
    kind = kind_of(place)
    if place.is_dir():
        return _run(place)
    if is_world_file(str(place)):
        return open_world(str(path))
    if kind == files.KIND:
        return files.load(place, continuous=True)
    if kind in FORMS:
        return FORMS[kind].load(place)
    if place.suffix == ".toml":
        return reader.load(place)
    if place.suffix in (".onnx", ".zip"):
        raise UserError(f"{place} names no world: load it by socialiq.driver(FILE, WORLD)")
    files.load(place)  # says what is wrong with the file
    raise UserError(f"{place} holds {one_line(kind, 80)}, which no function reads: name another")


def _run(folder: Path) -> Policies:
    """Return the numbers and policies of the folder of a run."""
    record = read_json(folder / "run.json")
    names = [key for key in ("policies", "dials") if isinstance(record, dict) and key in record]
    if not names:
        one_of("run", str(folder), ["a folder of `socialiq train`"])
    rows = record[names[0]]
    trained = tuple(load(folder / Path(row["file"]).name) for row in rows)
    return Policies(record, rows, table=rows, trained=trained)
