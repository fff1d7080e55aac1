"""Words of a command line: the checks that all options share, and mistyped words.

The commands' own checks say what a value means; those here keep out values without any meaning.
Unknown words are answered with the nearest that is known.
"""

import dataclasses
import difflib
import itertools
import math
import re
import sys
import textwrap
import typing
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from socialiq.cli import commands
from socialiq.errors import UserError
from socialiq.foreign import one_line

LARGEST_COUNT = 10**9
"""Largest whole number of an option that is no seed."""
LARGEST_SEED = 2**63 - 1
FLOATS = (1e-100, 1e100)
"""Smallest and largest size of a number other than 0."""

_MEANINGS = {
    "angle": "alpha phi svo theta",
    "discount": "gamma",
    "episodes": "rollouts",
    "learning-rate": "lr",
    "policy": "model",
    "polyak": "rho",
    "replace": "force overwrite",
    "soft": "stochastic",
    "strength": "beta coefficient lambda regularization",
    "temperature": "tau",
    "threads": "workers",
    "updates": "epochs gradient-steps iterations",
    "world": "env environment",
}
ALIASES = {word: name for name, words in _MEANINGS.items() for word in words.split()}
"""Common names of options, and the names here."""

_DECIDED = ("angle", "strength", "seed", "updates", "hidden")
"""Settings that may be options of other names; a typo is answered with the option."""


def check_words(words: Sequence[str]) -> None:
    """Refuse words that can't be a value: an empty one, or one that is not text."""
    for position, word in enumerate(words):
        option, sign, value = word.partition("=")
        if not word:
            of = f" of {one_line(words[position - 1], 80)}" if position else ""
            raise UserError(f"an empty word{of}: give a value, or leave the option out")
        if sign and not value and option.startswith("--"):
            raise UserError(f"{one_line(option, 80)} is empty: give a value, or leave it out")
        if "\0" in word:
            raise UserError(f"'{one_line(word, 80)}' has a zero byte: no name or text has one")
        if any(not text.isascii() and _is_number(text) for text in (word, value)):
            raise UserError(f"'{one_line(word, 80)}' has digits of another script: write 0 to 9")
        if any("_" in text and _is_number(text) for text in (word, value)):
            raise UserError(f"'{one_line(word, 80)}' has _ among its digits: leave it out")
        try:
            word.encode()
        except UnicodeEncodeError:  # bytes that are not UTF-8 became halves of surrogates
            text = one_line(word.encode("utf-8", "replace"), 80)
            raise UserError(
                f"'{text}' is not UTF-8 text: rename the file, or type it again"
            ) from None


def _is_number(word: str) -> bool:
    try:
        return bool(word) and math.isfinite(float(word))
    except ValueError:
        return False


def check_options(command: Any) -> None:
    """Refuse numbers of options that no run could take, and lists of values without a value.

    A whole number is at most 10^9, a seed is from 0 to 2^63 - 1, and any other number is finite
    and of a size that arithmetic keeps. The options are the fields of a command's object.
    """
    for name, value in _values(command):
        option = f"--{name.replace('_', '-')}"
        if value is None:
            raise UserError(f"{option} has no value: give one, or leave it out")
        if isinstance(value, float):
            low, high = FLOATS
            if not (value == 0.0 or low <= abs(value) <= high):
                raise UserError(
                    f"{option} {value:g}: give 0, or a number of size {low:g} to {high:g}"
                )
            continue
        is_long = abs(value) >= 10**20
        text = f"a number of {int(math.log10(abs(value))) + 1} digits" if is_long else f"{value}"
        if name in ("seed", "seeds"):
            if not 0 <= value <= LARGEST_SEED:
                limit = "at least 0" if value < 0 else "below 2^63"
                raise UserError(f"{option}: seed must be {limit}, got {text}")
        elif abs(value) > LARGEST_COUNT:
            raise UserError(f"{option} {text}: give at most {LARGEST_COUNT:,}")


def refuse_twice(words: Sequence[str], kind: Any) -> None:
    """Refuse an option that is given twice, of which the parser would take the last.

    Args:
        words: Words that follow the command's name.
        kind: Class of the command.

    Raises:
        UserError: If an option that takes its values in one place is given in two.
    """
    options = [word.partition("=")[0].replace("_", "-") for word in words if word[:2] == "--"]
    several = {f"--{name.rstrip('_').replace('_', '-')}" for name in _appended(kind)}
    for position, option in enumerate(options):
        if option in options[:position] and option not in several:
            raise UserError(f"{one_line(option, 80)} is given twice: give it once, with all values")


def _appended(kind: Any) -> Iterator[str]:
    """Yield the fields of a dataclass, and of those below, that take values in several places."""
    for name, hint in typing.get_type_hints(kind, include_extras=True).items():
        if "UseAppendAction" in str(hint):
            yield name
        for inner in (hint, *typing.get_args(hint)):
            if isinstance(inner, type) and dataclasses.is_dataclass(inner):
                yield from _appended(inner)


def refuse_unused(command: Any, names: Sequence[str], owner: str) -> None:
    """Refuse fields of a command that were given without the option that makes them useful.

    Args:
        command: The command's object.
        names: Names of the fields.
        owner: The option that makes them useful, as the message names it.

    Raises:
        UserError: If one of the fields has another value than its default.
    """
    defaults = {field.name: field.default for field in dataclasses.fields(command)}
    for name in names:
        if getattr(command, name) != defaults[name]:
            raise UserError(f"--{name.replace('_', '-')} is of {owner}: add that, or leave it out")


def _values(options: Any) -> Iterator[tuple[str, int | float | None]]:
    """Yield the name and value of each number in the fields of a dataclass, and in those below."""
    for field in dataclasses.fields(options):
        value = getattr(options, field.name)
        if field.default_factory is not dataclasses.MISSING:  # a group of options
            yield from _values(value)
        if (
            isinstance(value, tuple)
            and not value
            and isinstance(field.default, tuple)
            and field.default
        ):
            yield field.name, None
        for number in value if isinstance(value, tuple | list) else (value,):
            if isinstance(number, int | float) and not isinstance(number, bool):
                yield field.name, number


def forwarded(words: Sequence[str]) -> list[str]:
    """Return a command line in which `compare priors` became `reproduce compare-priors`.

    A line that changes is printed.
    """
    if words[:1] != ["compare"] or len(words) < 2 or words[1].startswith("-"):
        return list(words)
    new = ["reproduce", f"compare-{words[1]}", *words[2:]]
    sys.stderr.write(f"socialiq: these words are now: socialiq {' '.join(new[:2])} ...\n")
    return new


def say_old_world(world: Any) -> None:
    """Say how a world is written now, if a command got a name of 0.3.0 that spells options."""
    name = world.strip().partition(",")[0] if isinstance(world, str) else ""
    if "-" not in name:  # before the worlds are imported, which takes a second
        return
    from socialiq.worlds.catalogue import OLD

    if name in OLD:
        sys.stderr.write(f"socialiq: {name} is now written {OLD[name]}\n")


def unknown_command(words: Sequence[str]) -> UserError:
    """Return the mistake of a command line that names no command."""
    if not words:
        return UserError("name a command: socialiq --help lists them")
    for distribution, names in commands.ELSEWHERE.items():
        for name in {words[0], " ".join(words[:2])} & {*names}:
            return UserError(f"socialiq {name} needs {distribution}: pip install {distribution}")
    group = f"{words[0]} " if words[0] in commands.GROUPS else ""
    names = [name.removeprefix(group) for name in commands.COMMANDS if name.startswith(group)]
    page = f"socialiq {group}--help lists the commands"
    if len(words) == 1 and group:
        return UserError(f"name a command of {words[0]}: {', '.join(names)}")
    word = words[1] if group else words[0]
    firsts = [] if group else list(commands.GROUPS)
    near = difflib.get_close_matches(word, [*names, *firsts], 1) or difflib.get_close_matches(
        " ".join(words[:2]), names, 1, 0.8
    )
    hint = f"did you mean '{group}{near[0]}'? {page}" if near else page
    return UserError(f"unknown command '{group}{word}': {hint}")


_EDGE = re.compile(r"^[│|]|[│|]$")
_RULE = re.compile(r"\s*[─-]{3}")
_KINDS = {"INT": "a whole number", "FLOAT": "a number", "PATH": "a path", "STR": "a text"}
"""Names of the parser's kinds of values."""

Complaint = Callable[[list[str]], str]
"""Returns the parser's boxed message of a command line, "" if it has none."""


def mistake(program: str, line: list[str], complaint: Complaint) -> UserError:
    """Return a mistake of the parser in one line.

    Args:
        program: Name of the program with the words of the command.
        line: Words that follow it.
        complaint: Returns the parser's boxed message of a command line.
    """
    # The first row is the title. Without a box, as in an ASCII locale, a rule is below it.
    page = [row for row in complaint(line).splitlines()[1:] if row[:1] not in ("╰", "+")]
    rows = [_EDGE.sub(" ", row).rstrip() for row in page]
    begin = int(bool(rows) and _RULE.match(rows[0]) is not None)
    rows = textwrap.dedent("\n".join(rows[begin:])).split("\n")
    cut = next((place for place, row in enumerate(rows) if _RULE.match(row)), len(rows))
    text = re.sub(r"\s+", " ", " ".join(rows[:cut])).strip()
    if text.startswith("Missing from"):
        return _missing(program, line, rows[1:cut], complaint)
    if match := re.match(r"Error parsing (\S+): (.*)", text):
        option, reason = match.groups()
        words = [word.removeprefix(f"{option}=") for word in line if word.startswith(f"{option}=")]
        if option in line:
            following = line[line.index(option) + 1 :]
            words = list(itertools.takewhile(lambda word: not word.startswith("--"), following))
        kind = next((row.strip() for row in rows[cut:] if option in row), "").partition(" ")[2]
        named = _KINDS.get(kind.strip("[]. ").partition(" ")[0])
        if words and named:
            several = ", or several" if kind.startswith("[") else ""
            return UserError(f"{option} {one_line(' '.join(words), 80)}: give {named}{several}")
        return UserError(f"{option}: {reason}; see {program} --help")
    if match := re.match(r"invalid choice '(.*)' for argument '(\S+)'. Expected one of (.*)", text):
        choices = re.sub(r"[().']", "", match[3]).rstrip(", ")
        return UserError(f"{match[2]} {one_line(match[1], 80)}: choose one of {choices}")
    if match := re.match(r"Missing value for argument '(\S+)'", text):
        return UserError(f"{match[1]} has no value: give one, or leave it out")
    if match := re.match(r"Unrecognized options: (.*)", text):
        return UserError(f"{program} takes no further '{match[1]}': leave it out, or see --help")
    return UserError(f"{text or 'the options do not go together'}; see {program} --help")


def _missing(program: str, line: list[str], rows: list[str], complaint: Complaint) -> UserError:
    """Return the mistake of missing options, after the first mistake of the given ones."""
    # The help text of an option is indented further than its name.
    names = [row.strip() for row in rows if re.match(r"    \S", row)]
    ending = f"{program} needs {' and '.join(names)}: add {'it' if len(names) == 1 else 'them'}"
    first = []
    last = []
    for name in names:
        option, _, kind = name.rpartition(" ")
        is_number = _KINDS.get(kind, "").endswith("number")
        value = "1" if is_number else kind.strip("{}").partition(",")[0]
        last += [option, value] if option else []
        first += [] if option else [value]
    completed = [*first, *line, *last]
    if names and complaint(completed):
        text = str(mistake(program, completed, complaint))
        if ending not in text:
            return UserError(f"{text}; and {ending}")
    return UserError(f"{ending}, or see {program} --help")


def unknown_option(program: str, words: Sequence[str], options: Sequence[str]) -> UserError | None:
    """Return the mistake of the first option that a command doesn't have, or None.

    Args:
        program: Name of the program with the words of the command.
        words: Words that follow it.
        options: Options of the command, without dashes at the beginning.
    """
    for word in words:
        name = word.removeprefix("--").partition("=")[0].replace("_", "-")
        if not word.startswith("--") or not name or name in (*options, "help"):
            continue
        if program.startswith("socialiq train "):
            spellings = [text.replace("-", "_") for text in (name, ALIASES.get(name, name))]
            for setting in spellings:
                if setting in commands.learner_settings() and setting not in _DECIDED:
                    return UserError(f"--{name} is a setting: give --set {setting}=VALUE")
        near = nearest_option(name, options)
        hint = f"did you mean --{near}? " if near else ""
        return UserError(f"unknown option --{name}: {hint}{program} --help lists the options")
    return None


def nearest_option(name: str, options: Sequence[str]) -> str | None:
    """Return the option that is meant most likely.

    Args:
        name: Word of the user, without dashes at the beginning.
        options: Options of the command; nested ones have dots.

    Returns:
        One of the options; None if none is similar.
    """
    plain = {option.rpartition(".")[2]: option for option in reversed(options)}
    shortened = re.sub(r"^(n|num|nb|number-of|total)-", "", name)
    for word in (name, shortened):
        for spelling in (word, ALIASES.get(word, word), f"{word}s", word.removesuffix("s")):
            if spelling in plain:
                return plain[spelling]
    near = difflib.get_close_matches(name, list(plain), 1)
    return plain[near[0]] if near else None
