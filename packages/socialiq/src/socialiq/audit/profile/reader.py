"""Read a declaration from `profile.toml`; errors name the file and the line."""

from __future__ import annotations

import datetime
import math
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NoReturn

from socialiq.audit.profile import fields
from socialiq.audit.profile import profile as declared
from socialiq.audit.profile.profile import Bound, Clip, Floor, Margin, Profile, Reward, Scenario
from socialiq.errors import UserError
from socialiq.reading import open_file
from socialiq.social.angle_rule import AngleRule
from socialiq.types import Json
from socialiq.worlds.catalogue import GRIDS, KNOWN, ROADS, base
from socialiq.worlds.files import refuse_file
from socialiq.worlds.situation import check_rule
from socialiq.worlds.world import World

LARGEST_FILE = 64 * 1024  # bytes; a profile with all its comments has about 3,000
_LONGEST_LINE = 1300  # characters: a text of the longest, all of it escaped
_MOST_DOTS = 250


def load(path: Path | Profile) -> Profile:
    """Read a declaration from a TOML file of at most 64 KiB; return a `Profile` as it is.

    Raises:
        UserError: If the file is missing, too large or not TOML, or a field is missing, unknown
            or wrong, or its day has not come anywhere on Earth; the message names file, line number
            and correction.
    """
    if isinstance(path, Profile):
        return path
    if not path.exists():
        raise UserError(f"no such file: {path}: `socialiq profile new` writes one")
    with open_file(path) as file:
        content = file.read(LARGEST_FILE + 1)
    declared = parse(content, str(path))
    if declared.date > (datetime.datetime.now(datetime.UTC) + datetime.timedelta(hours=14)).date():
        line = line_of(content.decode(), "date")
        raise UserError(f"{path}:{line}: date {declared.date} is to come: give the day of today")
    return declared


def parse(content: bytes, name: str = "profile.toml") -> Profile:
    """Read a declaration from the bytes of a file.

    Args:
        content: Bytes of the file, which become the profile's `source`.
        name: Name of the file in messages.

    Raises:
        UserError: As `load`, except for the day.
    """
    if len(content) > LARGEST_FILE:
        raise UserError(f"{name} has more than {LARGEST_FILE} bytes: a profile is a short text")
    try:
        text = content.decode()
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise UserError(f"{name}:{line}: this is not UTF-8 text: save it as UTF-8") from error
    return _Reader(text, name).profile(content)


_MULTI_LINE = ('"""', "'''")
_TOKEN = re.compile(r"""\"\"\"|'''|"(?:[^"\\]|\\.)*"|'[^']*'|\#.*""")
"""Beginning of a multi-line text, a text of one line, or a comment."""


class _Reader:
    """Reader of one file; its errors name the line of the field."""

    def __init__(self, text: str, name: str) -> None:
        self._text = text
        self._name = name
        for number, line in enumerate(text.split("\n"), 1):
            # A dotted key takes `tomllib` time that grows with the square of its parts, and a
            # number of thousands of digits makes it raise something else.
            if len(line) > _LONGEST_LINE or line.count(".") > _MOST_DOTS:
                self._stop(number, "this line is too long for a field: shorten it")
            # Without multi-line text `line_of` is exact.
            if any(token in _MULTI_LINE for token in _TOKEN.findall(line)):
                self._stop(number, "multi-line text is not used here: write it on one line")
        try:
            self._content: dict[str, Any] = tomllib.loads(text)
        except RecursionError:
            self._stop(1, "tables or lists are nested too deeply: a profile has one level")
        except tomllib.TOMLDecodeError as error:
            where = re.search(r"\(at line (\d+)", str(error))
            line = int(where[1]) if where else text.count("\n") + 1
            reason = str(error).split(" (at ")[0]
            self._stop(line, f"not TOML: {_quoted(reason, quoted=False)}: correct this line")

    def profile(self, source: bytes) -> Profile:
        names = [*fields.TABLES[""], *filter(None, fields.TABLES)]
        for name, value in self._content.items():
            if name not in names:
                self._unknown(name, names)
            keys = fields.TABLES.get(name, {})
            if keys and not isinstance(value, dict):
                self.refuse(name, f"{name} must be a table: write [{name}] above its fields")
            for key in value if keys else ():
                if key not in keys:
                    self._unknown(f"{name}.{key}", keys)
        values = {field.path: self._value(field) for field in fields.FIELDS}
        clip = self._checked_margins(values)
        caused = self._checked_bounds(values)
        self._check_scenario(values)
        rule = None
        content = values[fields.RULE]
        if content is not None:
            try:
                rule = AngleRule.of(content)
                check_rule(rule, values["scenario.world"])
            except UserError as error:
                self.refuse(fields.RULE, _quoted(str(error), quoted=False))
            width = values["margin.width"]
            if width is not None and not rule.is_within(width, values["angle"]):
                self.refuse(
                    "margin.width",
                    "a width is of one angle, and of a rule whose angles are no further apart than "
                    "the width, with the field angle among them: leave out margin.width",
                )
        tables: dict[str, Any] = {
            table: {key: values[field.path] for key, field in keys.items()}
            for table, keys in fields.TABLES.items()
        }
        for name in ("format", fields.RULE):
            del tables[""][name]
        return Profile(
            **tables[""],
            margin=Margin(**tables["margin"]),
            reward=Reward(**tables["reward"]),
            scenario=Scenario(**tables["scenario"]),
            competence=Floor(**tables["competence"]),
            source=source,
            rule=rule,
            clip=clip,
            caused=caused,
        )

    def _checked_bounds(self, values: Json) -> tuple[Bound, ...]:
        """Check the bounds of what the policy causes; return those that are declared."""
        bounds = list[Bound]()
        world = values["scenario.world"]
        paths = [path for path, value in values.items() if value is not None]
        for path in (path for path in paths if path.startswith(f"{fields.CAUSED}.")):
            name = path.rpartition(".")[2]
            limit = values[path]
            quantity = re.sub("^(max|min)_|_range$", "", name)
            first = f"{fields.CAUSED}.max_{quantity}"
            measured = declared.measured_in(world)
            if quantity not in measured:
                able = "only " + ", ".join(measured) if measured else "no effects"
                roads = ", ".join(ROADS)
                self.refuse(path, f"{world} measures {able}: leave out {path}, or name {roads}")
            if name.endswith("_range"):
                if not any(path.endswith(f"_{quantity}") for path in paths):
                    self.refuse(path, f"{path} is of a bound: add {first}, or leave it out")
                continue
            range_path = f"{fields.CAUSED}.{quantity}_range"
            limits = values.get(range_path)
            most = values[first]
            if limits is None and measured[quantity]:
                self.refuse(path, f"{path} needs the limits of an episode: add {range_path}")
            low, high = limits or (0.0, 1.0)
            if not low < limit < high:
                self.refuse(
                    path,
                    f"{path} must be above {low:g} and below {high:g}, got {limit:g}: beyond them "
                    "the means of all policies keep it, or none",
                )
            if name.startswith("min_") and most is not None and limit >= most:
                self.refuse(
                    path, f"{path} must be below {first} ({most:g}), got {limit:g}: no mean is both"
                )
            bounds.append(Bound.of(name, limit, limits))
        return tuple(bounds)

    def _checked_margins(self, values: Json) -> Clip | None:
        """Check margins, largest loss, width and clip against each other; return the clip."""
        limits = [values["clip.r_env"], values["clip.r_social"]]
        for name, other in (("r_env", limits[1]), ("r_social", limits[0])):
            if values[f"clip.{name}"] is None and other is not None:
                self.refuse("clip", f"clip.{name} is missing: both rewards are clipped, or none")
        clip = None if limits[0] is None else Clip(*map(tuple, limits))
        loss = values["margin.largest_loss"]
        margin = values["margin.regret"]
        if loss is not None and clip is not None:
            self.refuse("margin.largest_loss", "[clip] gives the largest loss: leave one out")
        least = loss if clip is None else clip.largest_loss(values["angle"])
        if least is not None and least <= margin:  # no policy could fail
            self.refuse(
                "margin.largest_loss" if clip is None else "clip",
                f"margin.largest_loss must be above margin.regret ({margin:g}), got {least:g}: it "
                "is the loss of a single episode, not of the mean",
            )
        if values["margin.width"] is None and values["margin.beyond"] is not None:
            self.refuse("margin.beyond", "margin.beyond is of a width's ends: add margin.width")
        if values["margin.width"] is not None:
            if values["angle"] > fields.LAST_DIRECTION:
                self.refuse(
                    "margin.width", "a width is of one angle from 0 to 90: leave out margin.width"
                )
            if clip is None and base(values["scenario.world"]) not in GRIDS:
                self.refuse("margin.width", "margin.width needs limits of the rewards: add [clip]")
        return clip

    def refuse(self, path: str, message: str) -> NoReturn:
        self._stop(line_of(self._text, path), message)

    def _stop(self, line: int, message: str) -> NoReturn:
        raise UserError(f"{self._name}:{line}: {message}")

    def _unknown(self, path: str, names: Iterable[str]) -> NoReturn:
        self.refuse(path, f"unknown field {_quoted(path)}: choose one of {', '.join(names)}")

    def _value(self, field: fields.Field) -> Any:
        table, _, key = field.path.rpartition(".")
        holder = self._content.get(table, {}) if table else self._content
        if key not in holder and not field.required:
            return None
        if key not in holder:
            self.refuse(field.path, f"{field.path} is missing: add {field.demand}")
        value = holder[key]
        is_world = field.path == "scenario.world" and isinstance(value, str)
        # A report is verified without its world, so that a missing file is none of its errors.
        if is_world and (not declared.is_recorded(value) or Path(value).exists()):
            try:  # a recording has a reason of its own, which helps more than a list of worlds
                refuse_file(value)
            except UserError as error:
                self.refuse("scenario.world", str(error))
        if not _fits(field, value):
            self.refuse(field.path, f"{field.path} must be {field.demand}, got {_quoted(value)}")
        if field.kind == "range":
            return [float(end) for end in value]
        return float(value) if field.kind == "number" else value

    def _check_scenario(self, values: Json) -> None:
        """Check that the world exists and has the declared hashes."""
        name = values["scenario.world"]
        options = values["scenario.options"]
        for option in options:
            if not re.fullmatch("[a-z0-9_]{1,40}", option):
                self.refuse("scenario.options", f"{_quoted(option)} is not the name of an option")
        # Making an environment may run code: only `Profile.world` does it.
        world: World | None = None
        try:
            if base(name) in KNOWN:
                world = declared.world_of(name, options)
            else:
                declared.check_options(options)
        except UserError as error:
            # The longest name, since some names are parts of others.
            option = max(
                (option for option in options if option in str(error)), key=len, default=""
            )
            path = f"scenario.options.{option}" if option else "scenario.options"
            self.refuse(path, _quoted(str(error), quoted=False))
        for path, value in declared.identity(world).items() if world else ():
            if values[path] != value:
                self.refuse(path, declared.WRONG_WORLD.format(path=path, value=value))


_NUMBERS = (int, float)
"""Types of a number: a boolean is none. NaN compares false, and a huge int is not converted."""


def _fits(field: fields.Field, value: Any) -> bool:
    if field.kind == "number":
        if type(value) not in _NUMBERS:
            return False
        over = value > field.low if field.above_low else value >= field.low
        return over and (value < field.high if field.below_high else value <= field.high)
    if field.kind == "date":
        return type(value) is datetime.date  # a datetime is a date too
    if field.kind == "range":
        numbers = isinstance(value, list) and [type(end) in _NUMBERS for end in value]
        return numbers == [True, True] and field.low <= value[0] < value[1] <= field.high
    if field.kind in ("rule", "options"):
        most = fields.MOST_OPTIONS if field.kind == "options" else math.inf
        return isinstance(value, dict) and len(value) <= most
    if not isinstance(value, str):
        return False
    if field.kind == "sha256":
        return re.fullmatch(fields.SHA256_PATTERN, value) is not None
    if field.kind == "world":
        return (
            len(value) <= fields.LONGEST_TEXT
            and re.fullmatch(fields.WORLD_PATTERN, value) is not None
        )
    return fields.visible(value)


def _quoted(value: Any, quoted: bool = True) -> str:
    """Return a user-provided value, escaped for one line of a terminal."""
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "a list"
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > 10**15:
        return "a huge number"
    text = ascii(value) if quoted else str(value).encode("ascii", "backslashreplace").decode()
    text = text if text.isprintable() else ascii(text)
    return text if len(text) <= 160 else text[:157] + "..."


_TABLE = re.compile(r"^\s*\[\s*([^\[\]]+?)\s*\]\s*(#.*)?$")
_KEY = re.compile(r"^\s*([A-Za-z0-9_\-\"'. ]+?)\s*=")


def line_of(text: str, path: str) -> int:
    """Return the number of the line, from 1, on which a field begins.

    The result is exact for files without multi-line strings, which a profile refuses.

    Args:
        text: Text of the file.
        path: Table and key of the field, joined by a dot.

    Returns:
        Line of the field. For a field that is missing, or hidden in an inline table, it is the line
        of the innermost table around it, and 1 if that is missing too.
    """
    table = ""
    lines = {}
    for number, line in enumerate(text.split("\n"), 1):
        header = _TABLE.match(line)
        key = _KEY.match(line)
        if header:
            table = _bare_key(header[1])
            lines.setdefault(table, number)
        elif key:
            lines.setdefault(f"{table}.{_bare_key(key[1])}".lstrip("."), number)
    keys = path.split(".")
    above = (".".join(keys[:length]) for length in range(len(keys), 0, -1))
    return next((lines[name] for name in above if name in lines), 1)


def _bare_key(key: str) -> str:
    """Return a dotted key without its quotes and spaces."""
    return ".".join(name.strip(" \t\"'") for name in key.split("."))
