"""Nearest known names for commands and options that are unknown."""

from __future__ import annotations

import contextlib
import difflib
import io
import re
from collections.abc import Callable, Sequence

from socialiq.cli.commands import COMMANDS, ELSEWHERE, GROUPS
from socialiq.cli.declared import learner_settings
from socialiq.errors import UserError

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


def unknown_command(words: Sequence[str]) -> UserError:
    """Return the mistake of a command line that names no command.

    Args:
        words: The command line after the program's name.
    """
    if not words:
        return UserError("name a command: socialiq --help lists them")
    for distribution, names in ELSEWHERE.items():
        for name in {words[0], " ".join(words[:2])} & {*names}:
            return UserError(f"socialiq {name} needs {distribution}: pip install {distribution}")
    group = f"{words[0]} " if words[0] in GROUPS else ""
    names = [name.removeprefix(group) for name in COMMANDS if name.startswith(group)]
    page = f"socialiq {group}--help lists the commands"
    if len(words) == 1 and group:
        return UserError(f"name a command of {words[0]}: {', '.join(names)}")
    word = words[1] if group else words[0]
    firsts = [] if group else list(GROUPS)
    near = difflib.get_close_matches(word, [*names, *firsts], 1) or difflib.get_close_matches(
        " ".join(words[:2]), names, 1, 0.8
    )
    hint = f"did you mean '{group}{near[0]}'? {page}" if near else page
    return UserError(f"unknown command '{group}{word}': {hint}")


def option_names(show_help: Callable[[], object]) -> list[str]:
    """Return the options of a help page, without their dashes.

    Args:
        show_help: Prints the page and may exit.
    """
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
        setting = _setting(name) if program.startswith("socialiq train ") else None
        if setting is not None:
            return UserError(f"--{name} is a setting: give --set {setting}=VALUE")
        near = nearest_option(name, known)
        hint = f"did you mean --{near}? " if near else ""
        return UserError(f"unknown option --{name}: {hint}{program} --help lists the options")
    return None


def _setting(option: str) -> str | None:
    """Return the setting of a learner that an option means exactly, or by an alias."""
    settings = learner_settings()
    for name in (option, *ALIASES.get(option, ())):
        setting = name.replace("-", "_")
        if setting in settings and setting not in _DECIDED:
            return setting
    return None


def nearest_option(name: str, known: Sequence[str]) -> str | None:
    """Return the known option that is meant most likely.

    Args:
        name: The unknown option, without dashes.
        known: The command's options, without dashes; nested ones with dots.
    """
    plain = {option.rpartition(".")[2]: option for option in reversed(known)}
    shortened = re.sub(r"^(n|num|nb|number-of|total)-", "", name)
    for word in (name, shortened):
        for spelling in (word, *ALIASES.get(word, ()), f"{word}s", word.removesuffix("s")):
            if spelling in plain:
                return plain[spelling]
    near = difflib.get_close_matches(name, list(plain), 1)
    return plain[near[0]] if near else None
