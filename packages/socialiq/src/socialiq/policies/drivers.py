"""Grammar of drivers: `DRIVER [@angle[/class angle]] [+front end]`, the same in every command.

A driver is a rule of the world by its name, `driver`, which ships and drives on every road, a
policy of the atlas, a file, or code. `@` turns a dial, in degrees; `+` puts a front end before it:
`gap_3s`, `driver@45`, `dial.safetensors@60/30+latency=1`, `model.onnx`, `python:mine.py:NAME`. All
that follows `process:` is a command line.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq.policies.front_end import FrontEndPolicy
from socialiq.policies.interface import Interface, Loaded, Record, read_content
from socialiq.policies.load import load_policy, name_of
from socialiq.provenance import package_sha256
from socialiq.reading import sha256_of
from socialiq.social.angle import check_angle, check_class_angle
from socialiq.storage import header_of, is_file, shipped
from socialiq.types import OBSERVATION, ROWS, Memoryless
from socialiq.worlds import grammar
from socialiq.worlds.catalogue import GRIDS, ROADS
from socialiq.worlds.files import names_file
from socialiq.worlds.grammar import Written
from socialiq.worlds.highway.observation import ROUTE
from socialiq.worlds.highway.shifts import OR
from socialiq.worlds.intersection import atlas
from socialiq.worlds.world import World

ATLAS = "atlas:"
DRIVER = "driver"
"""Dial of two angles that ships (`socialiq.driver_training`)."""
DRIVER_FILE = "results/driver/driver.safetensors"
PROCESS = "process:"
RULE = "rule"  # kind of a rule-based driver, in its record
RANDOM = "random"
"""Rule of every world: actions drawn uniformly."""


class RandomPolicy(Memoryless):
    """Actions drawn uniformly, whatever is observed.

    Attributes:
        interface: Sizes of the world's observations and actions.
        rng: Generator of the draws.
    """

    def __init__(self, interface: Interface, seed: int) -> None:
        self.interface = interface
        self.rng = np.random.default_rng(seed)

    def choose(self, observation: Any, _deterministic: bool, /) -> np.ndarray:
        """Return drawn actions, one for each observation."""
        shape = np.shape(observation)[:-1]
        if not self.interface.action_size:
            return self.rng.integers(self.interface.n_actions, size=shape)
        shape = (*shape, self.interface.action_size)
        return self.rng.uniform(-1.0, 1.0, shape).astype(np.float32)

    def probabilities(self, observations: np.ndarray) -> np.ndarray:
        """Return the equal probabilities of all actions of each observation, (batch, action)."""
        count = self.interface.n_actions
        return np.full((len(observations), count), 1.0 / count)


class Driver(NamedTuple):
    """Driver as a text names it."""

    spec: Any  # text of a rule, `atlas:NAME`, file or code; or a policy, a dial
    angle: float | None = None  # to which a dial is turned, degrees
    class_angle: float | None = None  # of a dial of two angles, degrees
    front_end: str = ""  # perception before it, as "latency=1,track=3"

    def is_rule_of(self, world: World) -> bool:
        """Whether this is a rule of a world, whose name at a recorded junction may be `driver`."""
        return self.spec in world.drivers and not (self.spec == DRIVER and self.angle is not None)

    def at(self, angle: float | None, option: str = "--angle") -> float | None:
        """Return the angle of a dial, which an option may give too.

        Args:
            angle: Value of the option in degrees; None if it is not given.
            option: Name of the option, for the message.

        Raises:
            UserError: If both are given and differ.
        """
        if None not in (angle, self.angle) and angle != self.angle:
            raise UserError(
                f"{option} {angle:g} contradicts {one_line(name_of(self.spec))}@{self.angle:g}: "
                "leave one out"
            )
        return self.angle if angle is None else angle


_SUFFIX = re.compile(
    r"(?P<spec>.*?)(?:@(?P<turn>[-.0-9][^@+/]*(?:/[^@+/]*)?))?"
    r"(?:\+(?P<front>(?:known|[a-z_]+=[^,+@]*)(?:,(?:known|[a-z_]+=[^,+@]*))*))?",
    re.DOTALL,
)


def parse(text: Any) -> Driver:
    """Return the driver of a text, or of an object. A file of exactly this name is meant first.

    Raises:
        UserError: If an angle is no number of degrees, or what follows a file's name is neither
            an angle nor a front end.
    """
    if not isinstance(text, str | Path):
        return Driver(text)
    text = str(text)
    if text.startswith(PROCESS) or is_file(text):
        return Driver(text)
    match = _SUFFIX.fullmatch(text)
    if match is None or not (spec := match["spec"]):
        return Driver(text)
    if match["turn"] is None and match["front"] is None:
        for sign, example in (("@", "@60"), ("+", "+latency=1,track=3")):
            file, divider, _ = text.rpartition(sign)
            if divider and is_file(file):
                line = f"'{one_line(text)}': write behind {one_line(file)} for instance {example}"
                raise UserError(line)
        return Driver(text)
    turn, _, class_turn = (match["turn"] or "").partition("/")
    angle = _degrees(turn, text) if turn else None
    class_angle = _degrees(class_turn, text) if "/" in (match["turn"] or "") else None
    if angle is not None:
        check_angle(angle)
    if class_angle is not None:
        check_class_angle(class_angle)
    return Driver(spec, angle, class_angle, match["front"] or "")


def schema_of(spec: Any) -> str:
    """Return the schema of the observations that a file or an object of this package names.

    Args:
        spec: Name of a driver, a file, or a policy.

    Returns:
        `ROWS` or `ROUTE`; "" where it names none of them.
    """
    provenance = getattr(spec, "provenance", None)
    if isinstance(spec, str | Path):
        provenance = header_of(Path(file_of(spec))).get("provenance")
    schema = provenance.get(OBSERVATION) if isinstance(provenance, Mapping) else ""
    return schema if schema in (ROWS, ROUTE) else ""


def showing(world: World, schema: str) -> World:
    """Return a world as a policy of a schema observes it.

    Args:
        world: The world.
        schema: Schema of the policy, as `World.schema`; "" for the world's own.

    Raises:
        UserError: If the policy observes a route and the world has none.
    """
    if schema in ("", world.schema):
        return world
    name = schema.rpartition("-")[0]
    try:
        return world.showing(name)
    except UserError as error:
        raise UserError(f"the policy observes its {name}, and {error}") from None


def world_for(world: str, drivers: Iterable[Any]) -> str:
    """Return the text of a road that shows what its drivers observe.

    The driver that ships observes its route, and so may a file. `observation=route` is added for
    them where the text says nothing of the observation.

    Args:
        world: The world.
        drivers: Its drivers, as texts or objects.

    Raises:
        UserError: If one of them observes its route and the world is a gridworld.
    """
    written = grammar.parse(world)
    of_file = names_file(written.name)  # where `driver` without an angle is a rule
    along = [
        driver.spec
        for driver in map(parse, drivers)
        if schema_of(driver.spec) == ROUTE
        and not (of_file and driver.spec == DRIVER and driver.angle is None)
    ]
    if not along:
        return world
    if written.name in GRIDS:
        raise UserError(
            f"{one_line(name_of(along[0]))} drives on roads, at recorded junctions and in SUMO, "
            f"not in {written.name}: choose one of {', '.join(ROADS)}"
        )
    if not _has_routes(written):
        return world
    return world if "observation" in written.options else f"{world},observation=route"


def shipped_at(world: str, angles: Sequence[float]) -> list[str]:
    """Return the driver that ships at each angle, for a command that names no driver.

    Args:
        world: The world.
        angles: Angles in degrees; none for 45.

    Raises:
        UserError: If it can't drive in the world.
    """
    if not _has_routes(grammar.parse(world)):
        raise UserError(
            f"no driver is named: name a file that `socialiq train` wrote, or a rule of {world}"
        )
    return [f"{DRIVER}@{angle:g}" for angle in angles or (45.0,)]


def _has_routes(written: Written) -> bool:
    """Return whether a world has roads on which the driver that ships can drive."""
    return written.name in ROADS or written.in_sumo or names_file(written.name)


def _degrees(text: str, driver: str) -> float:
    try:
        return float(text) if text.isascii() else float("")
    except ValueError:
        raise UserError(
            f"'{one_line(driver)}': the angle '{one_line(text, 80)}' is no number: write degrees, "
            "as DRIVER@60 or DRIVER@60/30"
        ) from None


def driver_of(
    text: Any, world: World, angle: float | None = None, allow_code: bool = False, seed: int = 0
) -> Loaded:
    """Return a driver of a world, with its record.

    Args:
        text: The driver, in this module's grammar. A policy of the atlas may be named without
            `atlas:`; a file's policy may take the time too. Or an object, as for `load_policy`.
        world: The world.
        angle: Angle of a dial in degrees; 0 by default.
        allow_code: Whether a named Python module may run.
        seed: Seed of the random rule.

    Raises:
        UserError: If there is no such driver, or it doesn't fit the world.
    """
    driver = parse(text)
    name = driver.spec
    angle = driver.at(angle)
    if isinstance(name, str):
        if driver.is_rule_of(world):
            return finished(driver, rule_of(name, world, seed), world)
        if name == RANDOM and world.is_exact:
            return at_random(Interface.of(world), seed)
        name = _spec_of(file_of(name), world)
    size = Interface.of(world)
    settings: dict[str, Any] = {"angle": angle or 0.0, "allow_code": allow_code, "clock": True}
    settings["action_size"] = size.action_size
    classes = of_classes(world, driver.class_angle)
    loaded = load_policy(name, size.n_features, size.n_actions, **settings, **classes)
    return finished(driver, loaded, world)


def file_of(name: Any) -> Any:
    """Return the file of the driver that ships if this is its name, else the name."""
    return str(shipped(Path(DRIVER_FILE))) if name == DRIVER else name


def _spec_of(name: str, world: World) -> str:
    """Return the file or code of a driver that is no rule of a world; refuse an unknown word."""
    if world.shipped:
        listed = name.removeprefix(ATLAS)
        names = atlas.names(world.shipped)
        if listed != name or listed in names:
            name = atlas_file(listed, world)
        elif ":" not in name and not _is_path(name):
            one_of("driver", name, (*world.drivers, *names, "a policy file"))
    elif is_word(name):
        if not world.drivers:
            raise UserError(
                f"{world.name} has no rule-based drivers, and no file is named {one_line(name)}: "
                "its exact optima are `socialiq solve` and `collect`; name a policy's file"
            )
        one_of("driver", name, (*world.drivers, "a policy file"))
    if ":" not in name:
        read_content(Path(name))  # says what is wrong with a path
    return name


def is_word(name: Any) -> bool:
    """Whether a driver is a single word that names no file, as a rule's name does."""
    is_text = isinstance(name, str) and ":" not in name
    return is_text and not _is_path(name) and not Path(name).suffix


def _is_path(name: str) -> bool:
    """Whether a name is that of a file, a folder or a pipe; refuse one too long for any."""
    try:
        return is_file(name) or Path(name).exists()
    except OSError as error:
        raise UserError(f"{error.strerror}: {one_line(name, 200)}") from error


def atlas_file(name: str, world: World) -> str:
    """Return the path of a policy of the atlas that fits the actions of a world.

    Args:
        name: Name of the policy.
        world: The world.

    Raises:
        UserError: If no study has a policy of this name for the world.
    """
    options: Any = getattr(world, "options", None)
    if world.shipped:
        return str(atlas.path_for(name, options))
    return str(atlas.path_of(name, atlas.studies_of(world.action_size)))


def finished(driver: Driver, loaded: Loaded, world: World | None) -> Loaded:
    """Return a loaded policy behind the front end of its driver.

    Args:
        driver: The driver.
        loaded: The policy and its record.
        world: The world, whose sensors the word `known` describes; None without a front end.

    Raises:
        UserError: If a turn is given and the policy is no dial, or the world takes no front end.
    """
    if driver.angle is not None and not loaded.record.kind.endswith("dial"):
        raise UserError(f"@{driver.angle:g} turns a dial, which {one_line(driver.spec)} is not")
    if not driver.front_end:
        return loaded
    assert world is not None
    shifts = OR.join(map(str, getattr(world, "shifts", ()))) or "none"
    behind: Any = world.shifted(shifts, driver.front_end)
    length = getattr(loaded.policy, "n_features", None) or world.n_features
    policy = FrontEndPolicy(loaded.policy, behind.front_end, length)
    text = f"{loaded.record.source}+{driver.front_end}"
    sha256 = sha256_of(f"{loaded.record.sha256}+{driver.front_end}")
    record = dataclasses.replace(loaded.record, source=text, sha256=sha256, soft=False)
    return dataclasses.replace(loaded, policy=policy, record=record, restart=None)


def of_classes(world: Any, class_angle: float | None = None) -> dict[str, Any]:
    """Return how `load_policy` reads policies for a world's schema and classes of road users.

    Args:
        world: The world, or its options.
        class_angle: Class angle of a dial in degrees; None for that of the world.
    """
    classes = getattr(world, "options", world)
    narrow = getattr(world, "narrow", ())
    if class_angle is None:
        alone = None if getattr(world, "walks", True) else 0.0  # vehicles are the one class there
        class_angle = getattr(classes, "class_angle", alone)
    schema = getattr(world, "schema", "")
    return {"narrow": narrow, "class_angle": class_angle, "schema": schema}


def rule_of(name: str, world: World, seed: int = 0) -> Loaded:
    """Return a rule-based driver of a world with its record.

    With continuous actions a rule accelerates and does not steer.

    Args:
        name: One of the world's `drivers`.
        world: The world.
        seed: Seed of the random driver.
    """
    return Loaded(world.driver(name, seed), _record_of_rule(name, Interface.of(world)))


def at_random(interface: Interface, seed: int = 0) -> Loaded:
    """Return the driver that draws its actions, with its record.

    Args:
        interface: Sizes of the world's observations and actions.
        seed: Seed of the draws.
    """
    return Loaded(RandomPolicy(interface, seed), _record_of_rule(RANDOM, interface, soft=True))


def _record_of_rule(name: str, interface: Interface, soft: bool = False) -> Record:
    sha256 = rule_sha256(name, package_sha256())
    return Record(RULE, name, sha256, "the rule's name and this package's code", interface, soft)


def rule_sha256(name: str, package: str) -> str:
    """Return the hash of a rule-based driver: it covers its name and the package's hash.

    Args:
        name: Name of the rule.
        package: Hash of the package.

    Returns:
        64 hexadecimal digits.
    """
    return sha256_of(f"rule {name}\n{package}\n")
