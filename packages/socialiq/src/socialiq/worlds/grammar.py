"""Grammar of worlds: `NAME or FILE [, key=value ...]`, parsed here for every command and function.

A name is one of `NAMES`, a network of SUMO, a file of `socialiq data world`, a Gymnasium id or
MODULE:ID. Keys are fields of the world's options and the short words of `kinds_of`. Values are
numbers, true, false or text; commas within [...] belong to a value. A word without a value is a
shift by its name, as `intersection,people=0.1,late`.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import re
import tomllib
import typing
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeVar, get_args

from socialiq.errors import UserError, one_of
from socialiq.foreign import one_line
from socialiq.settings import assignments, typed
from socialiq.storage import is_file
from socialiq.worlds import ENVIRONMENT_PATTERN, crosswalk7, files
from socialiq.worlds.catalogue import (
    FAULTS,
    GRIDS,
    INTERSECTION,
    NAMES,
    OF_CONSTRUCTOR,
    OF_PEOPLE,
    OLD,
    PLAIN,
    ROADS,
    WORDS,
    in_sumo,
    is_road,
    keys_of,
    kinds_of,
    reason_against,
)
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.highway.effects import EffectOptions, check_agents
from socialiq.worlds.highway.kinds import kind_with, parts_of
from socialiq.worlds.highway.options import AgentOptions, ControlOptions, RoadOptions, Schema
from socialiq.worlds.highway.people import PeopleOptions
from socialiq.worlds.highway.scenes import SCENES
from socialiq.worlds.highway.shifts import OR, SHIFTS
from socialiq.worlds.highway.world import (
    OF_FILES,
    SENSED,
    RoadWorld,
    SceneWorld,
    sensed_of,
    world_of,
)
from socialiq.worlds.intersection.generated import ROAD, GeneratedOptions, scene_of_layout
from socialiq.worlds.intersection.options import CrosswalkOptions, Options
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.world import World

Kind = TypeVar("Kind")

_CONTROL = {"discrete": "", "continuous": "continuous", "steering": "continuous_steering"}
"""Values of `control`, and of the field `actions` that they stand for."""


class Written(NamedTuple):
    """World as a text names it."""

    name: str  # of `NAMES` or `SUMO_IDS`, a path, an id, MODULE:ID or MODULE:FUNCTION
    options: dict[str, Any]  # by field, or of `WORDS`; keyword arguments of an environment

    @property
    def in_sumo(self) -> bool:
        """Whether SUMO simulates it."""
        return in_sumo(self.name)

    @property
    def is_built(self) -> bool:
        """Whether this package builds it as a `World`; `build` does."""
        return self.name in NAMES or files.is_world_file(self.name)

    @property
    def control(self) -> str:
        """Value of `actions` of continuous actions, "" for discrete ones."""
        return self.options.get("actions", "")

    @property
    def caused(self) -> bool:
        """Whether r_social is what the ego causes."""
        return self.options.get("reward") == "caused"

    @property
    def walks(self) -> bool:
        """Whether people walk or ride in it."""
        return self.name == "crosswalk7" or not OF_PEOPLE.isdisjoint(self.options)

    def __str__(self) -> str:
        words = [f"{key}={_text(value)}" for key, value in self.options.items()]
        return ",".join([self.name, *words])


def _text(value: Any) -> str:
    if isinstance(value, tuple | list):
        return f"[{','.join(map(_text, value))}]"
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return f"[{text}]" if "," in text else text


def parse(text: str, further: Mapping[str, Any] | None = None) -> Written:
    """Return the name and the options of a world.

    Args:
        text: The world: `NAME or FILE [, key=value ...]`, or a name of 0.3.0.
        further: Options by key that are laid over those of the text.

    Raises:
        UserError: If a key or a value is not one of the world's.
    """
    name, words = _split(text)
    if name in OLD:
        name, before = _split(OLD[name])
        words = before + words
    of_text = {key: _Text(value) for key, value in _assigned(name, words)}
    options = _resolved(name, of_text) | _resolved(name, further or {})
    if name in NAMES and options.get("agents") == 1:
        options |= dict.fromkeys(("agents", "ends", "frame"), "")
    as_usual = ("actions", "reward", "shift", "front_end", "agents", "ends", "frame")
    if name in ROADS and options.get("left_hand") is False:
        del options["left_hand"]
    left_out = {key for key in as_usual if name in NAMES and options.get(key) == ""}
    return Written(name, {k: v for k, v in options.items() if k not in left_out})


class _Text(str):
    """Value that a text gives, which gets the type of its field."""

    __slots__ = ()


def set_options(words: Sequence[Sequence[str]]) -> dict[str, Any]:
    """Return the options that `--set KEY=VALUE ...` gives, which `parse` lays over a text's."""
    values = assignments([word for several in words for word in several])
    return {key: _Text(value) for key, value in values.items()}


def _split(text: str) -> tuple[str, list[str]]:
    """Return the name and the words behind it; commas in brackets belong to a word."""
    text = text.strip()
    if "," not in text or is_file(text):
        return text, []
    name, *words = (word.strip() for word in re.split(r",(?![^\[]*\])", text))
    return name, words


def _assigned(name: str, words: list[str]) -> list[tuple[str, str]]:
    """Return keys and values; names of shifts, and words between `OR`, are one value of `shift`."""
    shifts = list[str]()
    values = dict[str, str]()
    kinds = kinds_of(name)
    fields = kinds.fields if kinds else {}
    on_road = is_road(name)
    for word in words:
        key, sign, value = (part.strip() for part in word.partition("="))
        if not word:
            raise UserError(f"{one_line(name)}: a comma has no word behind it: leave it out")
        if key != "shift" and (word in SHIFTS or OR in word):
            if kinds is not None and not on_road:
                raise UserError(
                    f"{name} has no {one_line(word, 80)}: {reason_against(name, 'noise')}"
                )
            shifts.append(word)
            continue
        if not (sign and key and value):
            raise UserError(
                f"'{one_line(word, 80)}' is no KEY=VALUE of {one_line(name, 80)}: write for "
                "instance people=0.1; `socialiq worlds` lists worlds and keys"
            )
        key = key.replace("-", "_")
        if key in values:
            raise UserError(f"{key} is given twice: leave one out")
        values[key] = value[1:-1] if key in ("shift", "front_end") and value[0] == "[" else value
        if on_road and key in FAULTS - fields.keys():
            shifts.append(f"{key}={values.pop(key)}")
    if shifts:
        values["shift"] = ",".join(filter(None, [values.get("shift", ""), *shifts]))
    return list(values.items())


def _resolved(name: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return options by field: short words are resolved, text gets the type of its field."""
    kinds = kinds_of(name)
    fields = kinds.fields if kinds else {}
    on_road = is_road(name)
    is_file = kinds is None and files.names_file(name)
    options = dict[str, Any]()
    shifts = list[str]()
    for key, value in values.items():
        field = kinds.short.get(key, key) if kinds else key
        if field in options:
            raise UserError(f"{key} and {field} are one option of {name}: leave one out")
        if on_road and key in FAULTS - fields.keys():
            shifts.append(f"{key}={value}")
        elif kinds and on_road and key == "control" and "actions" not in fields:
            raise UserError(_unknown(name, key))
        elif on_road and key in (WORDS if kinds else OF_FILES):
            options |= _word(key, value)
        elif is_file and key not in OF_CONSTRUCTOR:
            if key in OF_FILES:
                files.refuse_file(name)
            raise UserError(_no_option_of_file(key))
        elif kinds is None or key in OF_CONSTRUCTOR:
            options[key] = _guessed(value) if type(value) is _Text else value
        elif field not in fields:
            raise UserError(_unknown(name, key))
        else:
            hints = typing.get_type_hints(fields[field][1])
            options[field] = value
            if type(value) is _Text:
                options[field] = typed(_unquoted(value), hints[field], key)
    if shifts:
        options["shift"] = ",".join(filter(None, [options.get("shift", ""), *shifts]))
    return options


def _no_option_of_file(key: str) -> str:
    return (
        f"the world of a file takes no options, got {one_line(key, 80)}: `socialiq data world` "
        "makes another world"
    )


def _word(key: str, value: Any) -> dict[str, Any]:
    """Return the options that a word of a road stands for."""
    if not isinstance(value, str):
        raise UserError(f"{key} must be text, as latency=1, got {value!r}")
    value = str(value)
    if key == "reward":
        one_of("reward", value, ("thesis", "caused"))
        return {"reward": value.replace("thesis", "")}
    if key == "control":
        one_of("control", value, tuple(_CONTROL))
        return {"actions": _CONTROL[value]}
    if key == "observation":
        one_of("observation", value, get_args(Schema))
        return {} if value == "rows" else {"observation": value}
    return {key: value}


def _unquoted(text: str) -> str:
    is_quoted = len(text) > 1 and text[0] == text[-1] and text[0] in "\"'"
    return str(text[1:-1] if is_quoted else text)


def _guessed(text: str) -> Any:
    """Return a value for a keyword argument whose type is not known, as TOML writes it."""
    for number in (int, float):
        try:
            return number(text) if text.isascii() and "_" not in text else str(text)
        except ValueError:
            continue
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return str(text)


def _unknown(name: str, key: str) -> str:
    """Return the line that refuses a key."""
    kinds = kinds_of(name)
    assert kinds is not None
    key = one_line(key, 80)
    if why := reason_against(name, key):
        return f"{name} has no {key}: {why}"
    keys = keys_of(name)
    near = difflib.get_close_matches(key, keys, 1)
    known = [field.name for field in dataclasses.fields(kinds.plain)]
    words = [key for key in keys if key in kinds.short or key in WORDS]
    meant = f"did you mean {near[0]}? " if near else ""
    further = "; `socialiq worlds` lists more" if kinds.further else ""
    return (
        f"unknown option of {name} '{key}': {meant}choose one of {', '.join([*known, *words])}"
        f"{further}"
    )


def build(name: str, options: Mapping[str, Any] | None = None) -> World:
    """Return the world of a text, with further options by key.

    Raises:
        UserError: If the world, a key or a value is unknown, or options don't go together.
    """
    return build_written(parse(name, options))


_TEXTS: dict[str, str] = {}
"""Texts of worlds by their description; equal descriptions are those of identical worlds."""


def build_written(written: Written) -> World:
    """Return the world that is written; see `build`."""
    name, options = written
    if name in GRIDS:
        chosen = parse_options(name, GRIDS[name].Options, options)
        world: World = _grid(name, chosen, repr(chosen))
    elif name in NAMES:
        world = _road(name, options)
    elif files.names_file(name):
        values = dict(options)
        sensed = sensed_of(values)
        schema = values.pop("observation", "rows")
        if values:
            raise UserError(_no_option_of_file(next(iter(values))))
        world = files.load_world(name).showing(schema).shifted(**sensed)
    elif written.in_sumo or re.fullmatch(ENVIRONMENT_PATTERN, name):
        raise UserError(
            f"unknown world '{one_line(name, 80)}': choose one of {', '.join(NAMES)}; "
            "`socialiq.make_environment` makes an environment"
        )
    else:
        one_of("world", name, NAMES)
        raise AssertionError(name)
    _TEXTS[world.description] = str(written)
    return world


def text_of(world: str | World) -> str:
    """Return how a world is written that `build` made; a text is returned as it is.

    Raises:
        UserError: If the world was made in another way.
    """
    if isinstance(world, str):
        return world
    if world.description not in _TEXTS:
        raise UserError(f"no text names this {one_line(world.name)}: make it by socialiq.world")
    return _TEXTS[world.description]


def _road(name: str, options: Mapping[str, Any]) -> RoadWorld:
    """Return the intersection or a scene with options by field."""
    values = dict(options)
    sensed = sensed_of(values)
    measured = {field.name for field in dataclasses.fields(EffectOptions)}
    of_effects = {key: values.pop(key) for key in tuple(values) if key in measured}
    effects = None
    if values.pop("reward", "thesis") == "caused":
        effects = parse_options(name, EffectOptions, of_effects)
    elif of_effects:
        raise UserError(f"{next(iter(of_effects))} is of what an ego causes: add reward=caused")
    kind = kind_with(PLAIN.get(name, RoadOptions), parts_of(values))
    _refuse_incomplete(kind, values)
    if issubclass(kind, PeopleOptions):
        values = {"pedestrian_rate": 0.0} | values
    world: RoadWorld
    if name == INTERSECTION:
        world = Intersection(parse_options(name, kind, values), effects)
    elif name == ROAD:
        chosen = parse_options(name, kind, values)
        world = SceneWorld(chosen, effects, scene=scene_of_layout(chosen.layout))
    else:
        world = dataclasses.replace(world_of(name, **values), effects=effects)
    if effects is not None:
        check_agents(world.options)
    return world.shifted(**sensed)


def _refuse_incomplete(kind: type[RoadOptions], values: Mapping[str, Any]) -> None:
    """Refuse options whose subject is missing, by naming the word that brings it."""
    fields = {field.name for field in dataclasses.fields(kind)}
    for key in values:
        if key in fields:
            continue
        for missing, word in (
            (PeopleOptions, "people=0.1"),
            (AgentOptions, "agents=2"),
            (ControlOptions, "control=continuous"),
        ):
            if key in {field.name for field in dataclasses.fields(missing)}:
                raise UserError(f"{key} needs {word}: add that, or leave {key} out")


@functools.lru_cache(maxsize=32)
def _grid(name: str, options: Any, _written: str) -> GridWorld:
    """Return one gridworld for equal options, which compiles once; the text tells 1 from 1.0."""
    return GRIDS[name].make(options)


def road_of(options: RoadOptions | None = None, effects: EffectOptions | None = None) -> RoadWorld:
    """Return the intersection with options in a dataclass, by default those of the thesis.

    Args:
        options: Options of the intersection, of any of their kinds.
        effects: Options of a reward of what the ego causes; None for Eq 4.2.
    """
    return Intersection(Options() if options is None else options, effects)  # pyright: ignore[reportArgumentType]


def declared(text: str, further: Mapping[str, Any] | None = None) -> tuple[str, dict[str, Any]]:
    """Return a world's name and options as declarations, reports and saved files have them.

    These names are those of 0.3.0, and the class weights of people are always an option.

    Args:
        text: The world.
        further: Options by key that are laid over those of the text.
    """
    name, options = written = parse(text, further)
    left: dict[str, Any] = {
        key: list(v) if isinstance(v, tuple) else v for key, v in options.items()
    }
    if name == INTERSECTION:
        if written.walks:
            name += "-crosswalk"
            if left.get("pedestrian_rate") == CrosswalkOptions.pedestrian_rate:
                del left["pedestrian_rate"]
            elif "pedestrian_rate" not in left:
                left["pedestrian_rate"] = 0.0
        elif written.control and "agents" not in left:
            name += f"-{left.pop('actions').replace('_', '-')}"
            if left.get("offroad_terminal") and name.endswith("steering"):
                name += "-offroad"
                del left["offroad_terminal"]
        if written.caused and not written.control:
            del left["reward"]
            name += "-caused"
    if name == ROAD:
        fields = {field.name for field in dataclasses.fields(GeneratedOptions)}
        layout = GeneratedOptions(**{key: left[key] for key in fields & left.keys()})
        left |= layout.spelled
    if not written.walks:
        return name, left
    weights = {"class_angle": crosswalk7.Options.class_angle}
    return name, weights | left


def defaults(text: str) -> dict[str, Any]:
    """Return the default of every option of a named world that its name doesn't give, by field."""
    written = parse(text)
    kinds = kinds_of(written.name)
    assert kinds is not None
    fields = {name: field.default for name, (field, _) in kinds.fields.items()}
    fields |= vars(world_of(written.name).options) if written.name in SCENES else {}
    fields |= dict.fromkeys(("reward", *SENSED) if written.name in ROADS else (), "")
    fixed = written.options.keys() - {"pedestrian_rate"}
    return {option: default for option, default in fields.items() if option not in fixed}


def parse_options(world: str, kind: type[Kind], values: Mapping[str, Any]) -> Kind:
    """Return a world's options, of a dataclass, from values by name of the field.

    Args:
        world: Name of the world, for messages.
        kind: The dataclass.
        values: Value of each field that differs from its default.

    Raises:
        UserError: If a field is unknown, a value is not one that its Literal type lists, or a text
            is given for a number or a truth value.
    """
    kinds = typing.get_type_hints(kind)
    fields = tuple(field.name for field in dataclasses.fields(kind))  # pyright: ignore[reportArgumentType]
    for option in values:
        one_of(f"option of {world}", option, fields)
    for option, value in values.items():
        allowed = typing.get_args(kinds[option])
        if typing.get_origin(kinds[option]) is typing.Literal and value not in allowed:
            raise UserError(
                f"unknown value '{value}' for {option} of {world}: "
                f"choose one of {', '.join(map(str, allowed))}"
            )
        if isinstance(value, str) and kinds[option] in (bool, float, int):
            raise UserError(
                f"{option} of {world} is a text, '{value}': give a number, true or false"
            )
    return kind(**values)
