"""Parser of the commands' options, its help pages, and completion scripts of shells."""

import contextlib
import dataclasses
import io
import types
import typing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from socialiq.cli import commands, words

Paths = Annotated[
    tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(help_behavior_hint="(required)")
]
"""One or more paths without an option's name."""
_COMPLETION = "--tyro-print-completion"
_registry = ConstructorRegistry()
_inside: list[Any] = []
"""Kinds of values whose rule is being looked up, for which the parser's own rule counts."""


def options_of(kind: Any, program: str, line: list[str], description: str | None = None) -> Any:
    """Parse the words after a command's name; the parser's boxed messages become one line.

    Args:
        kind: Class of the command, or a union of classes.
        program: Name of the program with the words of the command.
        line: Words that follow it.
        description: Text of the help page; None for the docstring of the class.

    Returns:
        The command's object.

    Raises:
        UserError: If the words can't be understood.
        SystemExit: After a help page or a completion script.
    """
    settings = (tyro.conf.FlagCreatePairsOff, tyro.conf.OmitSubcommandPrefixes)

    def parsed(arguments: list[str]) -> Any:
        with _registry:
            return tyro.cli(
                kind, prog=program, description=description, args=arguments, config=settings
            )

    def complaint(line: list[str]) -> str:
        page = io.StringIO()
        with contextlib.redirect_stderr(page), contextlib.suppress(SystemExit):
            parsed(line)
        return page.getvalue()

    try:
        with contextlib.redirect_stderr(io.StringIO()):
            return parsed(line)
    except SystemExit as stop:
        if not stop.code:
            raise
    raise words.mistake(program, line, complaint)


@_registry.primitive_rule
def _plain_value(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    """Return how a value is read and shown: FLOAT for {None}|FLOAT, and no value as "unset"."""
    kind = info.type
    if kind in _inside:
        return None
    kinds = typing.get_args(kind)
    if len(kinds) == 2 and types.NoneType in kinds:
        [kind] = (inner for inner in kinds if inner is not types.NoneType)
        info = PrimitiveTypeInfo.make(kind, info.markers)
    _inside.append(kind)
    rule = ConstructorRegistry.get_primitive_spec(info)
    _inside.pop()
    if not isinstance(rule, PrimitiveConstructorSpec):
        return None

    def texts(value: Any) -> list[str]:
        return ["unset"] if value in (None, "", (), []) else rule.str_from_instance(value)

    def fits(value: Any) -> Any:
        return value is None or rule.is_instance(value)

    return dataclasses.replace(rule, str_from_instance=texts, is_instance=fits)


def every_command() -> Any:
    """Return one type for the parser that holds all commands, for shell completion.

    It imports every module. A command with words below it (`audit verify`) gets a field for them.
    """

    def together(first: str) -> Any:
        """Return the union of the commands below the first words."""
        union: Any = None
        for name in commands.COMMANDS:
            group, _, last = name.rpartition(" ")
            if group == first:
                kind = commands.command_class(name)
                if any(longer.startswith(f"{name} ") for longer in commands.COMMANDS):
                    below: Any = [("below", together(name) | None, None)]
                    namespace = {"__doc__": kind.__doc__}
                    kind = dataclasses.make_dataclass(
                        kind.__name__, below, bases=(kind,), namespace=namespace, frozen=True
                    )
                member = Annotated[kind, tyro.conf.subcommand(last)]
                union = member if union is None else union | member
        return union

    union = together("")
    for group in commands.GROUPS:
        below = together(group)
        if sum(name.startswith(f"{group} ") for name in commands.COMMANDS) == 1:
            below = below | None  # a union, as the parser needs it
        union = union | Annotated[below, tyro.conf.subcommand(group)]
    return union


@dataclass(frozen=True)
class Completion:
    """Print a script with which a shell completes commands and options.

    Example: socialiq completion bash > ~/.local/share/bash-completion/completions/socialiq
    """

    shell: Annotated[Literal["bash", "zsh"], tyro.conf.Positional]
    """Name of the shell."""

    def run(self) -> int:
        """Print the script."""
        options_of(every_command(), "socialiq", [_COMPLETION, self.shell], commands.DESCRIPTION)
        return 0
