"""Table of the commands, and their help pages by their sources.

A command's module may import a learner or a simulator, which takes seconds. The help page doesn't
wait for that.
"""

import ast
import dataclasses
import functools
import importlib.util
import shutil
import textwrap
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

_PACKAGES = ("socialiq", "socialiq_recordings", "socialiq_lab")

COMMANDS = {
    "worlds": "socialiq.cli.worlds:Worlds",
    "solve": "socialiq.cli.solve:Solve",
    "front": "socialiq.cli.solve:Front",
    "predict-lambda": "socialiq.cli.solve:PredictLambda",
    "render": "socialiq.cli.render:Render",
    "page": "socialiq.cli.render:Page",
    "view": "socialiq.cli.render:View",
    "collect": "socialiq.cli.data:Collect",
    "train iq-learn": "socialiq.cli.train.iq_learn:IQLearn",
    "train dqn": "socialiq.cli.train.dqn:DQN",
    "train dial": "socialiq.cli.train.dial:Dial",
    "train driver": "socialiq.cli.train.driver:Driver",
    "train offline-dial": "socialiq.cli.train.dial:OfflineDial",
    "train improve-dial": "socialiq.cli.train.dial:ImproveDial",
    "train sac": "socialiq.cli.train.actors:SAC",
    "train td3-bc": "socialiq.cli.train.actors:TD3BC",
    "train behaviour-cloning": "socialiq.cli.train.iq_learn:Cloning",
    "train cql": "socialiq.cli.train.iq_learn:ConservativeQ",
    "train own": "socialiq.cli.train.iq_learn:Own",
    "dial": "socialiq.cli.dial:Dial",
    "turn": "socialiq.cli.export:Turn",
    "ensemble": "socialiq.cli.export:Ensemble",
    "unlikeness": "socialiq.cli.export:Score",
    "evaluate": "socialiq.cli.evaluate:Evaluate",
    "plot ring": "socialiq.cli.plot:Ring",
    "plot stops": "socialiq.cli.plot:Stops",
    "plot sweep": "socialiq.cli.plot:Sweep",
    "effects": "socialiq.cli.effects:EffectsOf",
    "population": "socialiq.cli.population:Population",
    "stakeholders": "socialiq.cli.population:Stakeholders",
    "export": "socialiq.cli.export:Export",
    "world sumo": "socialiq.cli.sumo:WorldSumo",
    "conformance": "socialiq.cli.conformance:Conformance",
    "profile new": "socialiq.cli.profile:New",
    "profile check": "socialiq.cli.profile:Check",
    "audit": "socialiq.cli.audit:Audit",
    "audit nonce": "socialiq.cli.audit:WriteNonce",
    "audit commit": "socialiq.cli.audit:Commit",
    "audit verify": "socialiq.cli.audit_verify:Verify",
    "audit across": "socialiq.cli.audit_across:Across",
    "audit sign": "socialiq.cli.audit_verify:Sign",
    "data from-arrays": "socialiq.cli.data:FromArrays",
    "data to-arrays": "socialiq.cli.data:ToArrays",
    "data from-trajectories": "socialiq.cli.data:FromTrajectories",
    "data from-minari": "socialiq.cli.data:FromMinari",
    "data to-minari": "socialiq.cli.data:ToMinari",
    "data trust": "socialiq.cli.trust:Trust",
    "completion": "socialiq.cli.parser:Completion",
}
"""Each command's module and class, in the order of the help page.

Other distributions name theirs by an entry point.
"""
for _entry in sorted(entry_points(group="socialiq.commands"), key=lambda entry: entry.name):
    COMMANDS.update(_entry.load())

GROUPS = {
    "profile": "declarations for an audit",
    "data": "data sets and recorded traffic",
    "world": "worlds of other simulators",
    "plot": "figures of the thesis, of your own policies",
    "train": "learners",
}
"""First words that need a second one, and the subject of their commands."""

READERS = {
    "for everyone": "worlds page view render demo completion",
    "for engineers": "collect train dial turn ensemble evaluate effects export data world",
    "for auditors": "profile audit unlikeness conformance",
}
"""First words of the commands for each reader."""
_OTHERS = "for researchers"

ELSEWHERE = {
    "socialiq-recordings": (
        *(f"data {word}" for word in ("import", "inspect", "conflicts", "world", "demonstrations")),
        "data census",
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
    """Import a command's module and return its class."""
    module, attribute = COMMANDS[name].split(":")
    return getattr(importlib.import_module(module), attribute)


def summary(name: str) -> str:
    """Return the first line of a command's docstring."""
    module, class_name = COMMANDS[name].split(":")
    tree = _source(module)
    for node in tree.body if tree else ():
        if isinstance(node, ast.ClassDef) and node.name == class_name:
            return (ast.get_docstring(node) or "").partition("\n")[0]
    return ""


def _by_reader() -> dict[str, dict[str, str]]:
    """Return the text of each command by its reader; a group of commands has one text."""
    sections: dict[str, dict[str, str]] = {reader: {} for reader in (*READERS, _OTHERS)}
    for name in COMMANDS:
        first, _, last = name.partition(" ")
        reader = next((key for key in READERS if first in READERS[key].split()), _OTHERS)
        section = sections[reader]
        if first not in GROUPS:
            section[name] = summary(name)
        elif first in section:
            section[first] += f", {last}"
        else:
            section[first] = f"{GROUPS[first].capitalize()}: {last}"
    return sections


def help_page(group: str = "") -> str:
    """Return the help page of the program, or of a group of commands."""
    below = [name for name in COMMANDS if name.startswith(f"{group} ")]
    sections = {"commands": {name: summary(name) for name in below}}
    if not group:
        sections = _by_reader()
    width = max(shutil.get_terminal_size().columns, 40)
    indent = " " * (max(len(name) for section in sections.values() for name in section) + 4)
    lines = [f"usage: socialiq {group or '[--version]'} COMMAND ...", ""]
    lines += textwrap.wrap(f"Commands for {GROUPS[group]}." if group else DESCRIPTION, width)
    for title, section in sections.items():
        lines += ["", f"{title}:"]
        for name, text in section.items():
            start = f"  {name}".ljust(len(indent))
            lines += textwrap.wrap(start + text, width, subsequent_indent=indent)
    word = f"{group} COMMAND" if group else "COMMAND"
    end = textwrap.wrap(f"socialiq {word} --help lists the options of a command.", width)
    return "\n".join([*lines, "", *end, ""])


@functools.cache
def learner_settings() -> frozenset[str]:
    """Return the names of all settings of learners, which --set takes."""
    spec = importlib.util.find_spec("socialiq.learners")
    assert spec is not None and spec.origin is not None
    names = set()
    for path in Path(spec.origin).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.ClassDef) and (
                path.stem in ("config", "settings")
                or node.name.endswith(("Config", "Hyperparameters"))
            ):
                fields = [line for line in node.body if isinstance(line, ast.AnnAssign)]
                names |= {ast.unparse(field.target) for field in fields}
    return frozenset(names)


_NO_OPTION = ""  # of a word that is told by its place


def declared_options(module: str, name: str) -> list[str]:
    """Return the options of a class of this workspace, without their dashes, by its source.

    Args:
        module: Name of the module.
        name: Name of a class, or of a module that this one imports and a class in it, with a dot.

    Returns:
        Options in the order of the fields, those of base classes first; none for a class of another
        project. Words that are told by their place are left out.
    """
    tree = _source(module)
    head, _, last = name.partition(".")
    for node in tree.body if tree else ():
        if isinstance(node, ast.ImportFrom) and node.module:
            source = {alias.asname or alias.name: alias.name for alias in node.names}.get(head)
            if source:
                inner = (f"{node.module}.{source}", last) if last else (node.module, source)
                return declared_options(*inner)
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name:
            is_word = "Positional" in ast.unparse(node.value)
            return [_NO_OPTION] if is_word else _options_within(module, node.value)
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == name:
            kind = getattr(importlib.import_module(module), name)  # fields made from a table
            return [field.name.replace("_", "-") for field in dataclasses.fields(kind)]
        if isinstance(node, ast.ClassDef) and node.name == name:
            options = [option for base in node.bases for option in _options_within(module, base)]
            for field in (line for line in node.body if isinstance(line, ast.AnnAssign)):
                option = ast.unparse(field.target).rstrip("_").replace("_", "-")
                is_on = isinstance(field.value, ast.Constant) and field.value.value is True
                is_word = not option or "Positional" in ast.unparse(field.annotation)
                within = [_NO_OPTION] if is_word else _options_within(module, field.annotation)
                options += within or [f"no-{option}" if is_on else option]
            return [option for option in options if option != _NO_OPTION]
    return []


def _options_within(module: str, value: ast.expr) -> list[str]:
    """Return the options of the classes that an expression names."""
    nodes = (node for node in ast.walk(value) if isinstance(node, ast.Name | ast.Attribute))
    names = dict.fromkeys(map(ast.unparse, nodes))
    return [option for name in names for option in declared_options(module, name)]


@functools.cache
def _source(module: str) -> ast.Module | None:
    """Parse a module of this workspace; None for a module of another project."""
    if module.partition(".")[0] not in _PACKAGES:
        return None
    spec = importlib.util.find_spec(module)
    file = Path(spec.origin) if spec and spec.origin else None
    return ast.parse(file.read_bytes()) if file and file.suffix == ".py" else None
