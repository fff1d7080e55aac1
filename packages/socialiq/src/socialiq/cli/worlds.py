"""`worlds`: every world, its options and what it can do, from the code."""

import contextlib
import dataclasses
import functools
import inspect
import re
import textwrap
from dataclasses import dataclass
from typing import Annotated, Any

import tyro

from socialiq.cli.output import Printing, listed, print_json, print_table
from socialiq.errors import UserError, one_of
from socialiq.types import Row
from socialiq.worlds import IDS, SCENE_IDS, SUMO_IDS, catalogue, grammar
from socialiq.worlds.highway.shifts import FAULTS, OPTIONS, SHIFTS, Shift
from socialiq.worlds.intersection.generated import ROAD
from socialiq.worlds.road_users import ROAD_USERS
from socialiq.worlds.world import World

_FURTHER = (
    ("NETWORK.net.xml", "a network of SUMO, by its path"),
    ("FILE.safetensors", "a junction of recorded traffic, of `socialiq data world`"),
    ("ID-v1, MODULE:ID, MODULE:FUNCTION", "an environment; options are its keyword arguments"),
)
_WORDS = {
    "reward": ("thesis", "r_social: Eq 4.2 of the thesis, or caused: what the ego causes"),
    "control": ("discrete", "actions of the ego: discrete, continuous or steering"),
    "shift": ("", "shifts in brackets, as late,noise=1; each may also be a word or key itself"),
    "front_end": ("", "perception before every policy, in brackets, as latency=1,track=3"),
}
_SUBJECTS = {
    "EffectOptions": "reward=caused",
    "AgentOptions": "agents",
    "PeopleOptions": " or ".join(user.key for user in ROAD_USERS),
    "ControlOptions": "control=continuous",
}
"""Words of the grammar that bring the options of a class."""


@dataclass(frozen=True)
class Worlds(Printing):
    """List worlds; of one world its options with defaults, and what it can do.

    A world is written NAME[,key=value ...] in every command, as intersection,people=0.1,late.

    Example: socialiq worlds intersection
    """

    world: Annotated[str, tyro.conf.Positional] = ""
    """One world; by default all are listed."""

    def run(self) -> int:
        """Print."""
        if not self.world:
            rows = [{"world": name, "description": text} for name, text in _descriptions()]
            if self.json:
                print_json({"worlds": rows, "old_names": catalogue.OLD})
                return 0
            print_table(rows, "worlds; `socialiq worlds NAME` prints the options of one")
            return 0
        written = grammar.parse(self.world)
        if catalogue.kinds_of(written.name) is None:
            one_of("world", written.name, (*catalogue.NAMES, *SUMO_IDS, "a network of SUMO"))
        options = options_of(written.name)
        abilities = abilities_of(written)
        if self.json:
            print_json({"world": written.name, "options": options, "can": abilities})
            return 0
        print_table(options, f"options of {written.name}, as {written.name},key=value")
        print_table(listed(abilities, f"what {written} can do"))
        return 0


def _descriptions() -> list[tuple[str, str]]:
    """Return every world with one line on it."""
    rows = list[tuple[str, str]]()
    for name, module in catalogue.GRIDS.items():
        first = (inspect.getdoc(module) or "").partition("\n")[0].rstrip(".")
        rows.append((name, first.partition(", ")[2] or first))
    crossing = grammar.build(catalogue.INTERSECTION)
    rows.append((catalogue.INTERSECTION, (inspect.getdoc(type(crossing)) or "").partition("\n")[0]))
    for name in SCENE_IDS:
        of_env = f"highway-env's {name.replace('_', '-')}"
        drawn = "a crossing or roundabout that a seed draws"
        rows.append((name, drawn if name == ROAD else of_env))
    for name, net in zip(SUMO_IDS, ("a crossing", "a row of three junctions"), strict=True):
        rows.append((name, f"{net} in SUMO, of the extra `sumo`"))
    return [*rows, *_FURTHER]


def options_of(name: str) -> list[Row]:
    """Return a row for each option of a named world: key, default, meaning, what it needs.

    Args:
        name: Name of the world.

    Raises:
        UserError: If the world has no options.
    """
    kinds = catalogue.kinds_of(name)
    if kinds is None:
        raise UserError(f"{name} has keyword arguments of its own: see its documentation")
    short = {field: word for word, field in kinds.short.items()}
    rows = list[Row]()
    for word in catalogue.keys_of(name):
        if word in _WORDS:
            default, meaning = _WORDS[word]
            rows.append({"key": word, "default": default, "meaning": meaning, "needs": ""})
    usual = _usual(name)
    for field, kind in kinds.fields.values():
        key = f"{short[field.name]}, {field.name}" if field.name in short else field.name
        default = usual.get(field.name, field.default)
        needs = _SUBJECTS.get(kind.__name__, "") if kind in kinds.further else ""
        needs = "" if field.name in (*short, "actions", "agents") else needs
        meaning = meanings(kind).get(field.name, "")
        rows.append({"key": key, "default": _shown(default), "meaning": meaning, "needs": needs})
    changed = _changed_by_shifts(name)
    for field in dataclasses.fields(Shift):
        if field.name in changed and field.name not in (*kinds.short, *kinds.fields):
            default = _shown(field.default)
            meaning = meanings(Shift)[field.name]
            rows.append({"key": field.name, "default": default, "meaning": meaning, "needs": ""})
    return rows


def _changed_by_shifts(name: str) -> set[str]:
    """Return the fields of a `Shift` that a world has; none without sensors."""
    if not catalogue.is_road(name):
        return set()
    world: Any = grammar.build(name)
    options = {**OPTIONS, "wet": "population"}
    on_road = {field for field, option in options.items() if option in world.shiftable}
    return on_road | {field.name for field in FAULTS}


def _usual(name: str) -> dict[str, Any]:
    """Return the values of a plain world's options, which a scene changes."""
    options = getattr(grammar.build(name), "options", None) if name in catalogue.NAMES else None
    return {} if options is None else vars(options)


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{','.join(f'{number:g}' for number in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


@functools.cache  # of a class, not of each field: its source is read
def meanings(kind: type[Any]) -> dict[str, str]:
    """Return the meaning of each field of a dataclass: in its metadata, or its comment.

    A comment stands behind the field or in the lines above it. A field without one, and one of a
    generated class without metadata, has its name in words.
    """
    fields: Any = dataclasses.fields(kind)
    found = {
        field.name: field.metadata.get("meaning", field.name.replace("_", " ")) for field in fields
    }
    for base in reversed(kind.__mro__):
        if not dataclasses.is_dataclass(base):
            continue
        try:
            source = inspect.getsource(base)
        except OSError:  # a generated class, whose fields have their meaning in metadata
            continue
        above = list[str]()
        for line in textwrap.dedent(source).splitlines():
            text = line.strip()
            if text.startswith("#"):
                above.append(text.lstrip("# "))
                continue
            if match := re.fullmatch(r"(\w+): [^#]*=[^#]*?(?:  # (.*))?", text):
                own = [match[2]] if match[2] else []
                found[match[1]] = " ".join([*above, *own]) or match[1].replace("_", " ")
            above = []
    return found


def abilities_of(written: grammar.Written) -> Row:
    """Return what a world can do, by asking it.

    Args:
        written: The world.
    """
    kinds = catalogue.kinds_of(written.name)
    assert kinds is not None
    fields = kinds.fields
    if written.in_sumo:
        layout = grammar.build(catalogue.INTERSECTION)
        return _row(layout, written, "by class", "sampled", "yes", "no", "no")
    world = grammar.build_written(written)
    if world.is_exact:
        return _row(world, written, "delay in cells", "exact", _yes(world.walks), "no", "no")
    agents = "agents" in fields and not written.walks
    return _row(
        world,
        written,
        "yes" if not world.action_size else "yes, without the errors of Eq 4.2",
        "sampled",
        "people=0.1" if catalogue.FIRST_RATE in fields else "no",
        _controls(written),
        "agents=4" if agents else "no",
    )


def _row(
    world: World,
    written: grammar.Written,
    effects: str,
    solution: str,
    people: str,
    continuous: str,
    agents: str,
) -> Row:
    ids = IDS | SCENE_IDS | SUMO_IDS
    return {
        "Gymnasium id": ids.get(written.name, "none"),
        "rule drivers": ", ".join(world.drivers) or "none",
        "shipped policies": "atlas" if world.shipped else "none",
        "solution": solution,
        "effects": effects,
        "people": people,
        "faults of sensors": ", ".join(shifts_of(world)) if not written.in_sumo else "no",
        "continuous actions": continuous,
        "several agents": agents,
        "features": world.n_features,
        "actions": world.action_size or world.n_actions,
    }


def _controls(written: grammar.Written) -> str:
    """Return the continuous actions that a world takes, by trying each."""
    taken = list[str]()
    for word in ("continuous", "steering"):
        with contextlib.suppress(UserError):
            grammar.build(str(written), {"control": word})
            taken.append(f"control={word}")
    return " or ".join(taken) or "no"


def shifts_of(world: World) -> list[str]:
    """Return the names of the shifts that a world takes, by trying each."""
    taken = list[str]()
    for name in SHIFTS:
        with contextlib.suppress(UserError):
            world.shifted(name)
            taken.append(name)
    return taken or ["no"]


def _yes(value: bool) -> str:
    return "yes" if value else "no"
