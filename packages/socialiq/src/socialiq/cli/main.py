"""`socialiq`: find the command, parse its options, run it, and print mistakes as one line."""

from __future__ import annotations

import contextlib
import errno
import io
import itertools
import re
import sys
from pathlib import Path
from typing import Any

from socialiq.cli.checks import check_words
from socialiq.cli.commands import (
    COMMANDS,
    DESCRIPTION,
    GROUPS,
    command_class,
    every_command,
    help_page,
    options_of,
)
from socialiq.cli.forward import OLD_WORDS, forwarded
from socialiq.cli.streams import exit_status
from socialiq.cli.suggest import option_names, unknown_command, unknown_option
from socialiq.errors import UserError
from socialiq.foreign import cut
from socialiq.foreign import one_line as one_line_of

_LONGEST_LINE = 1000
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
_BOX = re.compile(r"[│╭╮╰╯─|+]+|-{3,}")


def main(arguments: list[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: Words after the program's name; by default the process's own.

    Returns:
        The exit status.
    """
    return exit_status(lambda: _run(arguments))


def _run(arguments: list[str] | None) -> int:
    try:
        return _claimed(parse(arguments))
    except KeyboardInterrupt:
        return _fail("stopped; nothing was saved", 130)
    except UserError as error:
        return _fail(str(error), error.exit_status)
    except MemoryError:
        return _fail("not enough memory: ask for less at a time", UserError.exit_status)
    except OSError as error:
        if error.errno in _NO_ROOM:
            line = f"cannot write: {error.strerror}; make room, or choose another place"
            return _fail(line, UserError.exit_status)
        if error.filename is None:
            raise
        return _fail(f"{error.strerror}: {cut(str(error.filename), 200)}", UserError.exit_status)


def _claimed(command: Any) -> int:
    """Check the numbers, claim the output, and run; a command without an output claims nothing."""
    from socialiq.cli.checks import check_options
    from socialiq.outputs import claimed

    check_options(command)
    out = getattr(command, "output", getattr(command, "out", None))
    with claimed(out) if isinstance(out, Path) else contextlib.nullcontext():
        return command.run()


def parse(arguments: list[str] | None) -> Any:
    """Return the command's object, with its options.

    Raises:
        UserError: If the command line can't be understood.
        SystemExit: After a help page, the version or a completion script.
    """
    every = sys.argv[1:] if arguments is None else arguments
    check_words(every)
    words = [word for word in every if word != "--json"]
    first = words[0] if words else ""
    if first in ("-h", "--help"):
        _print_and_exit(help_page())
    if first == "--version":
        _print_and_exit(f"socialiq {_version()}\n")
    if first.startswith(("--tyro-print-completion", "--tyro-write-completion")):
        return _options_of(every_command(), "socialiq", words, DESCRIPTION)
    if first in OLD_WORDS:
        learners = [name.partition(" ")[2] for name in COMMANDS if name.startswith("train ")]
        words = forwarded(words, learners)
        first = words[0]
    for length in (2, 1):
        name = " ".join(words[:length])
        if name in COMMANDS:
            command = _command(name, words[length:])
            if "--json" in every:
                _print_json(command, name)
            return command
    if first in GROUPS and words[1:2] in (["-h"], ["--help"]):
        _print_and_exit(help_page(first))
    raise unknown_command(words)


def _print_json(command: Any, name: str) -> None:
    """Let a command print its result as JSON.

    Raises:
        UserError: If it prints none.
    """
    if not hasattr(command, "json"):
        raise UserError(f"socialiq {name} prints no result: leave --json out")
    object.__setattr__(command, "json", True)


def _command(name: str, words: list[str]) -> Any:
    """Parse a command's options; a mistyped one is refused before anything else is imported."""
    program, names = f"socialiq {name}", options_of(name)
    unknown = None if names is None else unknown_option(program, words, names)
    if unknown:
        raise unknown
    return _options_of(command_class(name), program, words)


def _options_of(kind: Any, program: str, words: list[str], description: str | None = None) -> Any:
    """Parse the words after a command's name; the parser's boxed messages become one line."""
    import tyro

    complaint = io.StringIO()
    settings = (tyro.conf.FlagCreatePairsOff, tyro.conf.OmitSubcommandPrefixes)

    def parsed(given: list[str]) -> Any:
        return tyro.cli(kind, prog=program, description=description, args=given, config=settings)

    try:
        with contextlib.redirect_stderr(complaint):
            return parsed(words)
    except SystemExit as stop:
        if not stop.code:
            raise
    leading = list(itertools.takewhile(lambda word: not word.startswith("-"), words))
    names = option_names(lambda: parsed([*leading, "--help"]))
    raise unknown_option(program, words, names) or UserError(one_line(complaint.getvalue()))


def one_line(boxed: str) -> str:
    """Return a boxed message of the parser as one line."""
    lines = [_BOX.sub(" ", line).strip() for line in boxed.splitlines()]
    return re.sub(r"\s+", " ", "; ".join(line.rstrip(":") for line in lines if line))


def _version() -> str:
    import importlib.metadata

    return importlib.metadata.version("socialiq")


def _print_and_exit(text: str) -> None:
    sys.stdout.write(text)
    raise SystemExit(0)


def _fail(line: str, status: int) -> int:
    from socialiq.cli.output import complain

    complain(one_line_of(line, _LONGEST_LINE))
    return status
