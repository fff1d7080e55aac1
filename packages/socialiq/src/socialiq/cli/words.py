"""Words that no command has: those of older releases are forwarded, others named the nearest."""

from __future__ import annotations

import contextlib
import difflib
import io
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from socialiq.cli import commands
from socialiq.errors import UserError

OLD_WORDS = ("train", "train-dial", "improve-dial", "compare")
"""First words that `forwarded` may change."""
OFFLINE = "offline-regularised"
"""Preset of `train-dial` that is now the learner offline-dial."""

ALIASES = {
    "alpha": ("angle",),
    "beta": ("strength",),
    "coefficient": ("strength",),
    "env": ("world",),
    "environment": ("world",),
    "epochs": ("updates",),
    "force": ("replace",),
    "gamma": ("discount",),
    "gradient-steps": ("updates",),
    "iterations": ("updates",),
    "lambda": ("strength",),
    "lr": ("learning-rate",),
    "model": ("policy",),
    "overwrite": ("replace",),
    "phi": ("angle",),
    "regularization": ("strength",),
    "rho": ("polyak",),
    "rollouts": ("episodes",),
    "stochastic": ("soft",),
    "svo": ("angle",),
    "tau": ("temperature",),
    "theta": ("angle",),
    "workers": ("threads",),
}
"""Common names of options, and the names here; the first that a command has is taken."""

_DECIDED = ("angle", "strength", "seed", "updates", "hidden")
"""Settings that may be options of other names; a typo is answered with the option."""
_OPTION = re.compile(r"^\W*(?:-\w, )?--([a-z][\w-]*(?:\.[\w-]+)*)", re.MULTILINE)


def forwarded(words: Sequence[str]) -> list[str]:
    """Return a command line in the words of this release; one that changes is printed.

    `train FILE` stands for `train iq-learn FILE`, with `--learner` for that learner; `train-dial
    WORLD` for `train dial --world WORLD`; `improve-dial` for `train improve-dial`; `compare priors`
    for `reproduce compare-priors`.
    """
    first, options = words[0], list(words[1:])
    word = options[0] if options else ""
    is_place = word.startswith("--") or "." in word or "/" in word
    is_place = is_place or (bool(word) and Path(word).exists())
    if first == "improve-dial":
        new = ["train", "improve-dial", *options]
    elif first == "train-dial":
        new = ["train", *_dial(options)]
    elif first == "compare" and options and not word.startswith("-"):
        new = ["reproduce", f"compare-{word}", *options[1:]]
    elif (
        first == "train"
        and is_place
        and word != "--help"
        and f"train {word}" not in commands.COMMANDS
    ):
        learner, options = _without(options, "--learner")
        start = ["own", learner] if ":" in learner else [learner or "iq-learn"]
        new = ["train", *start, *options]
    else:
        return list(words)
    sys.stderr.write(f"socialiq: these words are now: socialiq {' '.join(new[:4])} ...\n")
    return new


def _dial(options: list[str]) -> list[str]:
    """Return the words of `train-dial` with the file first and the world as an option."""
    data, options = _without(options, "--data")
    world = [] if not options or options[0].startswith("-") else ["--world", options.pop(0)]
    file, learner = ([data] if data else []), "dial"
    if any(OFFLINE in word for word in options):
        learner, options = "offline-dial", _without(options, "--preset")[1]
    practised, options = _without(options, "--practice")
    if practised:
        learner = "practised-dial"
        new = {"--practice-episodes": "--episodes", "--practice-seed": "--first-seed"}
        options = ["--rounds", practised, *(new.get(word, word) for word in options)]
    return [learner, *file, *world, *options]


def _without(words: list[str], option: str) -> tuple[str, list[str]]:
    """Return the value of an option, "" if it is not given, and the words without it."""
    for position, word in enumerate(words):
        if word.startswith(f"{option}="):
            return word.partition("=")[2], [*words[:position], *words[position + 1 :]]
        if word == option and position + 1 < len(words):
            return words[position + 1], [*words[:position], *words[position + 2 :]]
    return "", words


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


def option_names(show_help: Callable[[], object]) -> list[str]:
    """Return the options, without their dashes, of a help page that a function prints."""
    page = io.StringIO()
    with contextlib.redirect_stdout(page), contextlib.suppress(SystemExit):
        show_help()
    return list(dict.fromkeys(_OPTION.findall(page.getvalue())))


def unknown_option(program: str, words: Sequence[str], known: Sequence[str]) -> UserError | None:
    """Return the mistake of the first option that a command doesn't have, or None.

    Args:
        program: The command, as it is called.
        words: The command line after the command's name.
        known: The command's options, without their dashes.
    """
    for word in words:
        name = word.removeprefix("--").partition("=")[0].replace("_", "-")
        if not word.startswith("--") or not name or name in (*known, "help"):
            continue
        if program.startswith("socialiq train "):
            spellings = [text.replace("-", "_") for text in (name, *ALIASES.get(name, ()))]
            for setting in spellings:
                if setting in commands.learner_settings() and setting not in _DECIDED:
                    return UserError(f"--{name} is a setting: give --set {setting}=VALUE")
        near = nearest_option(name, known)
        hint = f"did you mean --{near}? " if near else ""
        return UserError(f"unknown option --{name}: {hint}{program} --help lists the options")
    return None


def nearest_option(name: str, known: Sequence[str]) -> str | None:
    """Return the known option that is meant most likely; nested options have dots."""
    plain = {option.rpartition(".")[2]: option for option in reversed(known)}
    shortened = re.sub(r"^(n|num|nb|number-of|total)-", "", name)
    for word in (name, shortened):
        for spelling in (word, *ALIASES.get(word, ()), f"{word}s", word.removesuffix("s")):
            if spelling in plain:
                return plain[spelling]
    near = difflib.get_close_matches(name, list(plain), 1)
    return plain[near[0]] if near else None
