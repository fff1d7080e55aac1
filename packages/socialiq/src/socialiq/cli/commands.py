"""Table of the commands, and their help pages, without an import of any command's module."""

from __future__ import annotations

import dataclasses
import importlib
import shutil
import textwrap
from importlib.metadata import entry_points
from typing import Annotated, Any

from socialiq.cli import declared

_OWN = {
    "solve": "socialiq.cli.solve:Solve",
    "front": "socialiq.cli.solve:Front",
    "predict-lambda": "socialiq.cli.solve:PredictLambda",
    "render": "socialiq.cli.render:Render",
    "page": "socialiq.cli.page:Page",
    "view": "socialiq.cli.page:View",
    "collect": "socialiq.cli.collect:Collect",
    "train iq-learn": "socialiq.cli.train.iq_learn:IQLearn",
    "train dial": "socialiq.cli.train.dial:Dial",
    "train offline-dial": "socialiq.cli.train.offline_dial:OfflineDial",
    "train improve-dial": "socialiq.cli.train.dial:ImproveDial",
    "train sac": "socialiq.cli.train.actors:SAC",
    "train td3-bc": "socialiq.cli.train.actors:TD3BC",
    "train behaviour-cloning": "socialiq.cli.train.iq_learn:Cloning",
    "train cql": "socialiq.cli.train.iq_learn:ConservativeQ",
    "train own": "socialiq.cli.train.iq_learn:Own",
    "dial": "socialiq.cli.dial:Dial",
    "turn": "socialiq.cli.export:Turn",
    "ensemble": "socialiq.cli.export:Ensemble",
    "evaluate": "socialiq.cli.evaluate:Evaluate",
    "export": "socialiq.cli.export:Export",
    "conformance": "socialiq.cli.conformance:Conformance",
    "profile new": "socialiq.cli.profile:New",
    "profile check": "socialiq.cli.profile:Check",
    "audit": "socialiq.cli.audit:Audit",
    "audit nonce": "socialiq.cli.audit_seed:WriteNonce",
    "audit commit": "socialiq.cli.audit_seed:Commit",
    "audit verify": "socialiq.cli.audit_verify:Verify",
    "audit sign": "socialiq.cli.audit_verify:Sign",
    "data from-arrays": "socialiq.cli.data:FromArrays",
    "data to-arrays": "socialiq.cli.data:ToArrays",
    "data from-trajectories": "socialiq.cli.data:FromTrajectories",
    "data from-minari": "socialiq.cli.data:FromMinari",
    "data to-minari": "socialiq.cli.data:ToMinari",
}
"""Commands of this distribution: module and class."""


def _installed() -> dict[str, str]:
    """Return every installed command; other distributions name theirs by an entry point."""
    distributions = sorted(entry_points(group="socialiq.commands"), key=lambda entry: entry.name)
    return _OWN | {name: target for entry in distributions for name, target in entry.load().items()}


COMMANDS = _installed()
"""Each command's module and class, in the order of the help page."""

GROUPS = {
    "profile": "declarations for an audit",
    "data": "data sets and recorded traffic",
    "train": "learners: the first word, iq-learn if it is a file",
}
"""First words that need a second one, and the subject of their commands."""

ELSEWHERE = {
    "socialiq-recordings": (
        *(f"data {word}" for word in ("import", "inspect", "conflicts", "world", "demonstrations")),
        *(f"data {word}" for word in ("census", "predict", "power")),
        "train practised-dial",
    ),
    "socialiq-lab": ("demo", "sweep", "reproduce", "claims", "bench"),
}
"""Commands of other distributions, which may be missing."""

DESCRIPTION = (
    "Driving policies of a declared social angle, learned from mixed demonstrations. "
    "With --json a command prints its result as one JSON object. "
    "Exit status: 0 done, 1 a check failed, 2 a mistake in the call, 3 an audit that decides "
    "nothing, 130 stopped by Ctrl-C."
)


def command_class(name: str) -> type[Any]:
    """Import a command's module and return its class.

    Args:
        name: A key of `COMMANDS`.
    """
    module, attribute = _place(name)
    return getattr(importlib.import_module(module), attribute)


def options_of(name: str) -> list[str] | None:
    """Return a command's options by its source, or None where only an import gives them.

    Args:
        name: A key of `COMMANDS`.
    """
    return declared.options(*_place(name))


def _place(name: str) -> tuple[str, str]:
    """Return a command's module and the name of its class there."""
    module, _, attribute = COMMANDS[name].partition(":")
    return module, attribute


def help_page(group: str = "") -> str:
    """Return the help page of the program, or of a group of commands.

    Args:
        group: A key of `GROUPS`, or "" for all commands.
    """
    names = [name for name in COMMANDS if name.startswith(f"{group} " if group else "")]
    width = max(shutil.get_terminal_size().columns, 40)
    indent = " " * (max(map(len, names)) + 4)
    lines = [f"usage: socialiq {group or '[--version]'} COMMAND ...", ""]
    lines += textwrap.wrap(f"Commands for {GROUPS[group]}." if group else DESCRIPTION, width)
    lines += ["", "commands:"]
    for name in names:
        start = f"  {name}".ljust(len(indent))
        lines += textwrap.wrap(
            start + declared.summary(*_place(name)), width, subsequent_indent=indent
        )
    word = f"{group} COMMAND" if group else "COMMAND"
    end = textwrap.wrap(f"socialiq {word} --help lists the options of a command.", width)
    return "\n".join([*lines, "", *end, ""])


def every_command() -> Any:
    """Return one type for the parser that holds all commands, for shell completion.

    It imports every module. A command with words below it (`audit verify`) gets a field for them.
    """
    import tyro

    def together(first: str) -> Any:
        """Return the union of the commands below the first words."""
        union: Any = None
        for name in COMMANDS:
            group, _, last = name.rpartition(" ")
            if group == first:
                kind = command_class(name)
                if any(longer.startswith(f"{name} ") for longer in COMMANDS):
                    below, namespace = (
                        [("below", together(name) | None, None)],
                        {"__doc__": kind.__doc__},
                    )
                    kind = dataclasses.make_dataclass(
                        kind.__name__, below, bases=(kind,), namespace=namespace, frozen=True
                    )
                member = Annotated[kind, tyro.conf.subcommand(last)]
                union = member if union is None else union | member
        return union

    commands = together("")
    for group in GROUPS:
        commands = commands | Annotated[together(group), tyro.conf.subcommand(group)]
    return commands
