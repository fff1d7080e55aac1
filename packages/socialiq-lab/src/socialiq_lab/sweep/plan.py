"""Read a sweep file: every combination of its values becomes a run, and runs become jobs."""

import dataclasses
import itertools
import json
import math
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

from socialiq import UserError
from socialiq.learners.extensions import LEARNERS, find_learner
from socialiq.learners.iq_learn.config import PRESETS, Endings
from socialiq.reading import read_toml, sha256_of_file
from socialiq.settings import changed
from socialiq.worlds.catalogue import GRIDS, base
from socialiq_lab.jobs import Job
from socialiq_lab.sweep.runs import RunsConfig, train_runs

OFFLINE = "offline"
IQ_LEARN = "iq_learn"
KEYS = (
    *("learner", "preset", "worlds", "options", "data", "seeds", "runs_per_job"),
    *("static", "hyperparameters"),
)
RUNS_PER_JOB = 32
MOST_RUNS = 100_000


@dataclass(frozen=True)
class Plan:
    """A sweep that was read and found in order."""

    file: Path  # the sweep file
    jobs: tuple[Job, ...]
    """Each trains runs of one static config, world and data set in one program."""
    settings: dict[str, Any]  # content of the file, for the record


class _Entry(NamedTuple):
    """One value of a field, dotted below `endings`, and the dotted name of the key that gave it."""

    key: str
    field: str
    value: Any


def read_plan(file: Path, allow_code: bool = False) -> Plan:
    """Read a sweep file.

    It is TOML with `data`, and optionally `learner`, `worlds`, `seeds`, `preset`, `runs_per_job`
    and the tables `options`, of keywords of an environment, and `static` and `hyperparameters`,
    whose keys are fields of the learner's `StaticConfig` and `Hyperparameters`. A list means each
    of its values. Paths are relative to the file.

    Args:
        file: The file.
        allow_code: Whether modules of environments, and a user's learner, may be imported.

    Raises:
        UserError: If the file can't be read, or a key or value is invalid; the line names both.
    """
    return _Reader(file, read_toml(file), allow_code).plan()


class _Reader:
    """One file's content, checked key by key."""

    def __init__(self, file: Path, content: dict[str, Any], allow_code: bool) -> None:
        self.file = file
        self.content = content
        self.allow_code = allow_code
        self.learner = "", ""  # and the SHA-256 of its file; "" for IQ-Learn

    def plan(self) -> Plan:
        """Return the jobs of every combination."""
        self.check_keys("", self.content, KEYS)
        size = self.typed("runs_per_job", self.content.get("runs_per_job", RUNS_PER_JOB), int)
        if size < 1:
            raise self.error("runs_per_job", f"must be at least 1, got {size}")
        static, base = self.settings()
        runs = self.hyperparameters(base)
        values: list[RunsConfig] = []
        for (world, data), options in itertools.product(self.places(), self.options()):
            for item in self.statics(static, world != OFFLINE):
                for first in range(0, len(runs), size):
                    several = tuple(runs[first : first + size])
                    values.append(self.config(world, options, data, item, several))
                    if len(values) * size > MOST_RUNS + size:
                        raise self.too_many()
        jobs = tuple(
            Job(f"training/{number:05d}", train_runs, item, cost=float(len(item.hyperparameters)))
            for number, item in enumerate(values)
        )
        return Plan(self.file, jobs, self.content)

    def settings(self) -> tuple[Any, Any]:
        """Find the learner; return the settings to begin with: the preset's, or its defaults."""
        names = self.typed("learner", self.content.get("learner", IQ_LEARN), str)
        if names != IQ_LEARN:
            if "preset" in self.content:
                raise self.error("preset", f"is of {IQ_LEARN}: leave it out")
            file, _, name = names.rpartition(":")
            if name in LEARNERS and not file:
                self.learner = names, ""
            else:
                path = (self.file.absolute().parent / file).resolve()
                sha256 = sha256_of_file(path) if path.is_file() else ""
                self.learner = f"{path}:{name}" if file else names, sha256
            try:
                kind = find_learner(self.learner[0], "learner", self.allow_code)
            except UserError as error:
                raise self.error("learner", str(error)) from error
            return kind.StaticConfig(), kind.Hyperparameters()
        preset = self.typed("preset", self.content.get("preset", "grid"), str)
        if preset not in PRESETS:
            raise self.error("preset", f"unknown: choose one of {', '.join(PRESETS)}")
        return PRESETS[preset]

    def config(
        self, world: str, options: dict[str, Any], data: str, static: Any, runs: tuple[Any, ...]
    ) -> RunsConfig:
        """Return the configuration of one job.

        Args:
            world: Name of the world, or `OFFLINE`.
            options: Keywords of the environment.
            data: Path of the data set, relative to the sweep file.
            static: Static configuration of the runs.
            runs: Hyperparameters of each run.

        Raises:
            UserError: If the data set can't be read, or the world takes no options.
        """
        path = (self.file.absolute().parent / data).resolve()
        try:
            sha256 = sha256_of_file(path)
        except UserError as error:
            raise self.error("data", str(error)) from error
        location = "" if world == OFFLINE else world
        if options and (not location or base(location) in GRIDS):
            raise self.error("options", f"are of a Gymnasium id: leave {world} out of the worlds")
        files = data, str(path), sha256
        return RunsConfig(*self.learner, location, options, *files, static, runs, self.allow_code)

    def options(self) -> list[dict[str, Any]]:
        """Return every combination of the keywords of an environment."""
        table = self.table("options")
        values = [self.several(f"options.{name}", value) for name, value in table.items()]
        for name, several in zip(table, values, strict=True):
            try:
                json.dumps(several, allow_nan=False)
            except (TypeError, ValueError):
                line = "must be text, a number, or true or false"
                raise self.error(f"options.{name}", line) from None
        return [dict(zip(table, chosen, strict=True)) for chosen in itertools.product(*values)]

    def several(self, key: str, value: Any) -> list[Any]:
        """Return the values of a key.

        Args:
            key: Dotted name of the key, for messages.
            value: A list of values, or a single value.

        Raises:
            UserError: If the list is empty.
        """
        values = _listed(value)
        if not values:
            raise self.error(key, "must have at least one value")
        return values

    def places(self) -> list[tuple[str, str]]:
        """Return every world with each of its data sets."""
        worlds = [
            self.typed("worlds", item, str) for item in _listed(self.content.get("worlds", OFFLINE))
        ]
        value = self.content.get("data")
        if value is None:
            raise self.error("data", "is missing: name at least one file of `socialiq collect`")
        by_world = value if isinstance(value, dict) else dict.fromkeys(worlds, value)
        self.check_keys("data", by_world, worlds)
        pairs = []
        for world in worlds:
            if world not in by_world:
                raise self.error("data", f"names no file for {world}")
            if not (world == OFFLINE or base(world) in GRIDS or ":" in world or "/" in world):
                names_known = f"{', '.join(GRIDS)}, {OFFLINE} or a Gymnasium id"
                raise self.error("worlds", f"unknown world '{world}': choose {names_known}")
            if self.learner[0] and world != OFFLINE and base(world) not in GRIDS:
                raise self.error("worlds", f"this learner trains offline: leave '{world}' out")
            files = _listed(by_world[world])
            if not files:
                raise self.error("data", f"names no file for {world}")
            pairs += [(world, self.typed("data", item, str)) for item in files]
        if not pairs:
            raise self.error("worlds", "must name at least one world")
        return pairs

    def hyperparameters(self, base: Any) -> list[Any]:
        """Return every combination of hyperparameters, seeds last."""
        table = self.table("hyperparameters")
        fields = {field.name for field in dataclasses.fields(base)} - {"seed", "dataset"}
        self.check_keys("hyperparameters", table, sorted(fields))
        values = self.values("hyperparameters", table, type(base))
        seeds = [self.typed("seeds", item, int) for item in _listed(self.content.get("seeds", [0]))]
        if not seeds or len({*seeds}) < len(seeds):
            raise self.error("seeds", "must be one or more different whole numbers")
        values.append([_Entry("seeds", "seed", seed) for seed in seeds])
        if math.prod(map(len, values)) > MOST_RUNS:
            raise self.too_many()
        return [self.replaced(base, entries) for entries in itertools.product(*values)]

    def statics(self, base: Any, online: bool) -> list[Any]:
        """Return every combination of the static choices.

        Args:
            base: Static configuration to begin with.
            online: Whether IQ-Learn acts in a world.

        Raises:
            UserError: If a key or value is invalid.
        """
        table = self.table("static")
        fields = {field.name for field in dataclasses.fields(base)} - {"online"}
        self.check_keys("static", table, sorted(fields))
        endings = table.get("endings", {})
        if not isinstance(endings, dict):
            raise self.error("static.endings", "must be a table")
        self.check_keys(
            "static.endings", endings, [item.name for item in dataclasses.fields(Endings)]
        )
        flat = {name: value for name, value in table.items() if name != "endings"}
        values = [] if self.learner[0] else [[_Entry("worlds", "online", online)]]
        values += self.values("static", flat, type(base))
        values += self.values("static.endings", endings, Endings)
        return [self.replaced(base, entries) for entries in itertools.product(*values)]

    def values(self, where: str, table: Mapping[str, Any], kind: type) -> list[list[_Entry]]:
        """Return the values of each key of a table, converted to the type of its field.

        Args:
            where: Dotted name of the table, for messages.
            table: Values by key: a list of values, or a single value.
            kind: Dataclass with a field for each key.

        Raises:
            UserError: If a value has another type than its field.
        """
        hints = typing.get_type_hints(kind)
        values = []
        for name, value in table.items():
            key = f"{where}.{name}"
            hint = hints[name]
            is_tuple = typing.get_origin(hint) is tuple
            nested = isinstance(value, list) and any(isinstance(item, list) for item in value)
            several = [value] if is_tuple and not nested else self.several(key, value)
            field = key.partition(".")[2]
            values.append([_Entry(key, field, self.typed(key, item, hint)) for item in several])
        return values

    def replaced(self, base: Any, entries: Sequence[_Entry]) -> Any:
        """Return the settings with other values.

        Args:
            base: Settings to begin with.
            entries: Values of fields.

        Raises:
            UserError: If the settings refuse the values; the line names the key at fault.
        """
        try:
            return changed(base, {entry.field: entry.value for entry in entries})
        except UserError as error:
            for entry in entries:
                try:
                    changed(base, {entry.field: entry.value})
                except UserError as alone:
                    if str(alone) == str(error):
                        raise self.error(entry.key, str(error)) from error
            table = "hyperparameters" if hasattr(base, "seed") else "static"
            raise self.error(table, str(error)) from error

    def typed(self, key: str, value: Any, hint: Any) -> Any:
        """Return a value of the hinted type.

        Args:
            key: Dotted name of the key, for messages.
            value: Value of the sweep file; a whole number may stand for a number.
            hint: `str`, `bool`, `int`, `float`, a `Literal`, or a tuple of whole numbers.

        Raises:
            UserError: If the value has another type, or the hint is another one.
        """
        if typing.get_origin(hint) is Literal:
            if value not in typing.get_args(hint):
                names_known = ", ".join(typing.get_args(hint))
                raise self.error(key, f"unknown value {value!r}: choose one of {names_known}")
            return value
        if typing.get_origin(hint) is tuple:
            if not isinstance(value, list):
                raise self.error(key, f"must be a list of whole numbers, got {value!r}")
            return tuple(self.typed(key, item, int) for item in value)
        kinds: dict[Any, tuple[Any, str]] = {
            str: (str, "text in quotes"),
            bool: (bool, "true or false"),
            int: (int, "a whole number"),
            float: ((int, float), "a number"),
        }
        if hint not in kinds:
            raise self.error(key, "is of a type that a sweep file can't set: leave it out")
        expected, what = kinds[hint]
        if not isinstance(value, expected) or (isinstance(value, bool) and hint is not bool):
            raise self.error(key, f"must be {what}, got {value!r}")
        return hint(value)

    def table(self, key: str) -> dict[str, Any]:
        """Return a table of the file, by default an empty one."""
        values = self.content.get(key, {})
        if not isinstance(values, dict):
            raise self.error(key, "must be a table")
        return values

    def check_keys(self, where: str, table: Mapping[str, Any], names: Sequence[str]) -> None:
        """Refuse unknown keys.

        Args:
            where: Dotted name of the table; "" for the file.
            table: The table.
            names: Known keys.

        Raises:
            UserError: The line names the unknown key and the known ones.
        """
        for name in table:
            if name not in names:
                key = f"{where}.{name}" if where else name
                raise self.error(key, f"unknown key: choose from {', '.join(names)}")

    def too_many(self) -> UserError:
        """Return the refusal of a file with too many runs."""
        return UserError(f"{self.file}: more than {MOST_RUNS:,} runs: split it")

    def error(self, key: str, line: str) -> UserError:
        """Return the refusal of a key.

        Args:
            key: Dotted name of the key.
            line: Fault of its value, in words that follow the name.
        """
        return UserError(f"{self.file}: {key}: {line}")


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]
