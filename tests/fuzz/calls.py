"""Bad calls of every command: a call that would work, with one thing wrong in it.

Each value is wrong for the kind of its option. A call that must be refused has exit status 2 and
one line on standard error; one that is merely odd may also do its work. No call ends in a
traceback, hangs, or leaves anything but what it was asked to write.
"""

from __future__ import annotations

import dataclasses
import functools
import random
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin

from socialiq.cli.commands import COMMANDS, command_class

POLICY, DATA, PROFILE = "{ok}/policy.safetensors", "{ok}/steps.safetensors", "{ok}/profile.toml"
RECORDING, DIAL, OUT = "{ok}/recording.safetensors", "{ok}/dial.safetensors", "{out}/new"

NEW = ["--out", OUT]
TINY = ["--updates", "2", "--hidden", "4", *NEW]

BASES: dict[str, list[str]] = {
    "demo": ["--seeds", "0", "--out", OUT],
    "worlds": ["crossing5"],
    "solve": ["crossing5"],
    "front": ["crosswalk7", "--every", "45"],
    "predict-lambda": ["crossing5"],
    "render": ["crossing5", "--out", f"{OUT}.png"],
    "collect": ["crossing5", "--episodes", "2", "--out", OUT],
    "page": ["--out", OUT, "--dial", DIAL],
    "view": [POLICY, "--no-open"],  # of another world: refused before anything is served
    "train iq-learn": [DATA, "--world", "crossing5", *TINY],
    "train dial": ["--world", "crossing5", "--preset", "online-alone", "--updates", "2", *NEW],
    "train offline-dial": [DATA, "--world", "crossing5", *TINY],
    "train practised-dial": [DATA, "--world", "{ok}/nowhere", *TINY],
    "train driver": ["--set", "updates=1", "--set", "states_per_update=1", *NEW],
    "train improve-dial": [DIAL, "--updates", "2", "--set", "states_per_update=1", *NEW],
    "train sac": ["--world", "Pendulum-v1", *TINY],
    "train dqn": ["--world", "crossing5", *TINY],
    "train td3-bc": [DATA, *TINY],
    "train behaviour-cloning": [DATA, *TINY],
    "train cql": [DATA, *TINY],
    "train own": ["{ok}/nowhere.py:Mine", DATA, *TINY],
    "sweep": ["{ok}/sweep.toml", "--processes", "1", "--out", OUT],
    "dial": ["crossing5", "--policy", DIAL],
    "turn": [DIAL, "--angle", "30", "--out", OUT],
    "ensemble": [POLICY, POLICY, "--out", OUT],
    "unlikeness": ["prosocial", "--episodes", "2", "--out", OUT],
    "evaluate": [POLICY, "--world", "crossing5", "--shield", "0"],
    "plot ring": [POLICY, "--world", "crossing5", "--out", f"{OUT}.png"],
    "plot stops": [POLICY, "--out", f"{OUT}.png"],
    "plot sweep": ["{ok}/nowhere", "--out", f"{OUT}.png"],
    "completion": ["bash"],
    "effects": [
        "intersection",
        "--policy",
        "go",
        "--shift",
        "late",
        "--episodes",
        "2",
        "--out",
        OUT,
    ],
    "population": [
        "intersection",
        "--policy",
        DIAL,
        "--agents",
        "2",
        "--episodes",
        "2",
        "--out",
        OUT,
    ],
    "stakeholders": ["{ok}/episodes.csv", "--utilities", "{ok}/people.toml", "--out", OUT],
    "export": [POLICY, "--format", "onnx", "--out", OUT],
    "reproduce": ["worlds", "--out", OUT],
    "claims": [],
    "conformance": ["--episodes", "1"],
    "world sumo": ["crossing"],  # without the extra `sumo` refused too
    "bench": ["recordings", "--repeats", "1"],
    "profile new": ["--world", "crossing5", "--angle", "0", "--out", OUT],
    "profile check": [PROFILE],
    "audit": [POLICY, "--profile", PROFILE, "--episodes", "4", "--log", "{out}/log", "--out", OUT],
    "audit nonce": ["--out", OUT],
    "audit commit": [POLICY, "--profile", PROFILE, "--log", "{out}/log"],
    "audit verify": ["{ok}/report"],
    "audit across": ["{ok}/report", "{ok}/report"],
    "audit sign": ["{ok}/report", "--key", "{ok}/nowhere.pem"],
    "data from-arrays": ["{ok}/steps.npz", "--out", OUT],
    "data to-arrays": [DATA, "--out", f"{OUT}.npz"],
    "data trust": [DATA, "--out", OUT],
    "data from-trajectories": [
        "{ok}/rollouts.npz",
        "--n-actions",
        "2",
        "--social=none",
        "--out",
        OUT,
    ],
    "data from-minari": ["{ok}/minari", "--out", OUT],
    "data to-minari": [DATA, "--out", f"{OUT}-v0"],
    "data import": ["commonroad", "{ok}/recording.xml", "--out", OUT],
    "data inspect": [RECORDING],
    "data demonstrations": [RECORDING, "--out", OUT],
    "data census": [RECORDING, "--out", OUT],
    "data world": [RECORDING, "--out", OUT],
    "data conflicts": [RECORDING, "--pictures", "1", "--out", OUT],
}
"""By command, words of a call that would work, or nearly: {ok} has samples, {out} is empty."""

LONG = (
    "demo",
    "view",
    "reproduce",
    "bench",
    "conformance",
    "sweep",
)
"""Commands that take long: only calls that must be refused are made of them."""
TRAINING = tuple(name for name in BASES if name.startswith("train "))
"""Commands that take seconds: calls that may do their work are left to a long run."""

SETTINGS = (
    ("worlds", "episodes"),
    ("grid", "updates"),
    ("lambda-sweep", "strengths"),
    ("intersection-dial", "structure.hidden"),
    ("theory", "random_worlds"),
)
"""Studies, and a setting of each that is a number."""

TRACKERS = ("tensorboard", "wandb", "mlflow")
WRITTEN = ("out", "work", "log", *TRACKERS)
"""Options of paths that are written, not read."""

WRITTEN_BY = (("data world", "demonstrations"), ("data world", "report"), ("dial", "calibrated"))
"""The same of single commands; others read what they name so."""

CODE = ("learner", "loss", "prior", "divergence", "driver", "policy", "reference", "policies")
FREE = ("owner", "mode", "id", "date")
"""Options of any text."""

DIGITS = "1" * 24
LONG_TEXT = "a" * 5000
NOT_UTF8 = "caf\udce9"  # what Python makes of the bytes b"caf\xe9"


class Call(NamedTuple):
    """Words of a call, and whether it must be refused (exit status 2)."""

    words: tuple[str, ...]
    refused: bool

    def at(self, ok: Path, bad: Path, out: Path) -> list[str]:
        """Return the words with the folders of samples, of bad places and of outputs."""
        places = {"{ok}": str(ok), "{bad}": str(bad), "{out}": str(out)}
        found = []
        for word in self.words:
            for name, place in places.items():
                word = word.replace(name, place)
            found.append(word)
        return found


class Option(NamedTuple):
    """An option or an argument without name of a command.

    Attributes:
        name: As it is written after `--`, or of the field of an argument.
        kind: int, float, str, bool or Path.
        positional: Whether it has no name on the command line.
        choices: Valid words, if it is a choice.
        many: Whether it takes any number of values, none included.
    """

    name: str
    kind: type
    positional: bool
    choices: tuple[str, ...] = ()
    many: bool = False


def options(command: type, prefix: str = "") -> Iterator[Option]:
    """Yield the options of a command's class."""
    hints = typing.get_type_hints(command, include_extras=True)
    for one in dataclasses.fields(command):
        marks, kinds = _unfold(hints[one.name])
        names = [getattr(mark, "name", None) for mark in marks]
        given = next((name for name in names if isinstance(name, str)), one.name)
        name = f"{prefix}{given.replace('_', '-')}"
        for kind in kinds:
            if dataclasses.is_dataclass(kind):
                omitted = given == "" or any("OmitArgPrefixes" in repr(mark) for mark in marks)
                yield from options(typing.cast(type, kind), prefix if omitted else f"{name}.")
                break
        else:
            plain = [kind for kind in kinds if kind in (int, float, str, bool, Path)]
            choices = tuple(kind for kind in kinds if isinstance(kind, str))
            if plain or choices:
                positional = any("Positional" in repr(mark) for mark in marks)
                many = "Ellipsis" in repr(hints[one.name]) or ", ...]" in repr(hints[one.name])
                yield Option(name, plain[0] if plain else str, positional, choices, many)


def _unfold(hint: Any) -> tuple[list[Any], list[Any]]:
    """Return the marks of an annotation, and the types in it without tuples and unions."""
    if get_origin(hint) is Annotated:
        inner, *marks = get_args(hint)
        more, kinds = _unfold(inner)
        return [*marks, *more], kinds
    if get_origin(hint) is Literal:
        return [], list(get_args(hint))
    if get_origin(hint) in (typing.Union, types.UnionType, tuple, list):
        marks, kinds = [], []
        for part in get_args(hint):
            if part not in (Ellipsis, type(None)):
                more, found = _unfold(part)
                marks, kinds = [*marks, *more], [*kinds, *found]
        return marks, kinds
    return [], [hint]


ABSURD: dict[type, tuple[str, ...]] = {
    int: ("", "nan", "1.5", "east", DIGITS, f"-{DIGITS}", "9" * 5000, "0x10", "∞", NOT_UTF8, "1e3"),
    float: ("", "nan", "inf", "-inf", "1e400", "east", "1,5", "9" * 5000, NOT_UTF8, "-1e300"),
    str: ("", NOT_UTF8, LONG_TEXT, "\x1b[2J", "no\nsuch"),
    bool: (),
    Path: ("", NOT_UTF8, LONG_TEXT, f"{{bad}}/{NOT_UTF8}"),
}
"""Values that no option of a kind may take."""

ODD: dict[type, tuple[str, ...]] = {
    int: ("-1", "0", "1_000", "٣", "4294967296", "-0"),
    float: ("-1", "0", "1e-320", "1e300", "-0.0", "1e-9", "360", "1e9"),
    str: ("xyzzy", "λ", "-", "..", "../../etc/passwd", "a=b", "python:os:getcwd", "process:true"),
    bool: (),
    Path: (),
}
"""Values that an option of a kind may take or refuse."""

UNREADABLE = (
    "{bad}/nowhere",
    "{bad}/nowhere/below",
    "{bad}/empty",
    "{bad}/bytes",
    "{bad}/zeros",
    "{bad}/text",
    "{bad}/object.json",
    "{bad}/deep.json",
    "{bad}/folder",
    "{bad}/loop",
    "{bad}/dangling",
    "{bad}/zero",
    "{bad}/fifo",
    "{bad}/socket",
    "{bad}/text/below",
    "/dev/null",
    "/dev/zero",
    "/dev/urandom",
    "/proc/self/mem",
    "/",
)
"""Places that hold nothing that a command reads."""

UNWRITABLE = (
    "{bad}/full",
    "{bad}/text",
    "{bad}/text/below",
    "{bad}/fifo",
    "{bad}/socket",
    "{bad}/loop",
    "/dev/full",
    "/dev/null/x",
    "/proc/x",
    "/proc/self/x",
    "/",
    ".",
    "..",
)
"""Places that no command may write or replace."""

MAY_BE_FREE = {("render", "out"), ("profile new", "out")}


def bad_calls(long: bool = False) -> list[Call]:
    """Return every bad call, without repetitions, in a fixed order.

    Args:
        long: Whether calls that may train are among them, which takes an hour.
    """
    found: dict[Call, None] = {}
    for name in COMMANDS:
        for one in _of_command(name, name.split(), BASES[name]):
            if one.refused or long or name not in TRAINING:
                found.setdefault(one)
    for study, setting in SETTINGS:
        for word in ("", "=", "no_such=1", *(f"{setting}{end}" for end in ("", "=x", "=[", "=1e"))):
            found.setdefault(Call(("reproduce", study, "--out", OUT, "--set", word), True))
    for words in NO_COMMANDS:
        found.setdefault(Call(words, True))
    return list(found)


NO_COMMANDS: tuple[tuple[str, ...], ...] = (
    (),
    ("",),
    ("solv",),
    ("audit", "verifies"),
    ("data",),
    ("data", ""),
    ("profile", "--angle"),
    ("--verbose",),
    ("-x",),
    (LONG_TEXT,),
    (NOT_UTF8,),
    ("\x1b[2J",),
    ("solve", "crossing5", "crossing7"),
    ("--", "solve", "crossing5"),
    ("@file",),
)


def _of_command(name: str, start: list[str], base: list[str]) -> Iterator[Call]:
    kind = command_class(name)
    known = list(options(kind))
    for option in known:
        if option.positional:
            yield from _positional(name, start, base, option)
        else:
            yield from _option(name, start, base, option)
    for more in (["--no-such-option"], ["--no-such-option", "1"], ["-z"], ["--out"], [""]):
        yield Call((*start, *base, *more), True)
    if name not in LONG:
        yield Call((*start, *base, "--"), False)
    yield Call((*start, *base, NOT_UTF8), True)
    yield Call((*start, *base, *["more"] * 3), True)


@functools.cache
def _pool(name: str) -> tuple[Call, ...]:
    return tuple(one for one in bad_calls(long=True) if _is_of(one, name))


def _is_of(call: Call, name: str) -> bool:
    start = tuple(name.split())
    return call.words[: len(start)] == start


def mixed_call(generator: random.Random) -> Call:
    """Return a call of a command with the wrong parts of two bad calls.

    It must be refused if one of them must, unless that one was refused for what it lacks.
    """
    name = generator.choice([one for one in COMMANDS if one != "audit"])
    base = (*name.split(), *BASES[name])
    first, second = generator.choice(_pool(name)), generator.choice(_pool(name))
    added = second.words[len(base) :] if second.words[: len(base)] == base else ()
    refused = first.refused or (name in LONG and second.refused)
    if name in LONG and not first.refused:
        return second
    return Call((*first.words, *added), refused and not added)


def _values(name: str, option: Option) -> Iterator[tuple[str, bool]]:
    """Yield bad values, and whether they must be refused."""
    word = option.name.rpartition(".")[2]
    if option.kind is Path:
        written = word in WRITTEN and (name, word) != ("audit verify", "log")
        written |= (name, word) in WRITTEN_BY
        places = UNWRITABLE if written else UNREADABLE
        for value in places:
            if not (written and word in (*TRACKERS, "log")):  # which add files to any folder
                no_log = word == "log" and value.endswith(
                    "empty"
                )  # a log without the look: status 1
                unread = places is UNREADABLE and not no_log
                yield value, (word == "out" and value != ".") or unread
    for value in ABSURD[option.kind]:
        text = option.kind is str and word in FREE
        yield value, not (text and value in ("no\nsuch", "\x1b[2J", LONG_TEXT))
    for value in ODD[option.kind]:
        yield value, bool(option.choices)


def _option(name: str, start: list[str], base: list[str], option: Option) -> Iterator[Call]:
    flag = f"--{option.name}"
    if option.kind is bool:
        for value in ("maybe", "", "1"):
            yield Call((*start, *base, f"{flag}={value}"), True)
        return
    kept = list(base)
    if flag in kept:
        at = kept.index(flag)
        del kept[at : at + 2]
    for value, refused in _values(name, option):
        if refused or name not in LONG:
            joined = [f"{flag}={value}"] if value.startswith("-") else [flag, value]
            yield Call((*start, *kept, *joined), refused)
    if not option.many or name not in (*LONG, *TRAINING):
        yield Call((*start, *kept, flag), not option.many)


def _positional(name: str, start: list[str], base: list[str], option: Option) -> Iterator[Call]:
    if not base or base[0].startswith("-"):
        return
    for value, refused in _values(name, option):
        if value.startswith("-"):
            continue
        if refused or name not in LONG:
            yield Call((*start, value, *base[1:]), refused)
    yield Call((*start, *base[1:]), True)
