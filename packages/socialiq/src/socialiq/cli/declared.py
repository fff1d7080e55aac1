"""Docstrings and options of dataclasses, read from their sources without an import.

A command's module may import a learner or a simulator, which takes seconds. The help page and a
mistyped option don't wait for that.
"""

from __future__ import annotations

import ast
import functools
import importlib.util
from collections.abc import Iterator
from pathlib import Path

_PACKAGES = ("socialiq", "socialiq_recordings", "socialiq_lab", "studies")
_PLAIN = {
    "str",
    "int",
    "float",
    "bool",
    "tuple",
    "list",
    "Path",
    "Literal",
    "Annotated",
    "Any",
    "tyro",
}
"""Names in an annotation that make no options of their own."""


def summary(module: str, name: str) -> str:
    """Return the first line of a class's docstring.

    Args:
        module: Module of the class.
        name: Its name there.

    Raises:
        LookupError: If the module has no such class.
    """
    found = _class(module, name)
    if found is None:
        raise LookupError(f"{module} has no class {name}")
    return (ast.get_docstring(found) or "").partition("\n")[0]


def options(module: str, name: str) -> list[str] | None:
    """Return the options that the parser makes of a dataclass, without their dashes.

    Args:
        module: Module of the class, or one that imports it from there.
        name: Its name there.

    Returns:
        The options, or None where an annotation is not understood.
    """
    module, name = _defined(module, name)
    found = _class(module, name)
    if found is None:
        return None
    made: list[str] = []
    for base in found.bases:
        inherited = options(*_defined(module, ast.unparse(base)))
        if inherited is None:
            return None
        made += inherited
    for field in found.body:
        if not isinstance(field, ast.AnnAssign) or not isinstance(field.target, ast.Name):
            continue
        if field.target.id == "_":  # `_: KW_ONLY` separates fields and is none
            continue
        below = _options_below(module, field.annotation)
        if below is None:
            return None
        words = _attributes(module, field.annotation)
        option = _renamed(field.annotation) or field.target.id.replace("_", "-")
        if below:
            prefix = "" if "OmitArgPrefixes" in words else f"{option}."
            made += [prefix + one for one in below]
        elif "Positional" not in words:
            made.append(f"no-{option}" if _is_true(field.value) else option)
    return list(dict.fromkeys(made))


def _options_below(module: str, annotation: ast.expr) -> list[str] | None:
    """Return the options of the dataclasses in an annotation; none for plain types."""
    made: list[str] = []
    optional = _optional(module, annotation)
    if optional is not None:
        return optional
    for name in _types(annotation):
        place, original = _defined(module, name)
        alias = _assigned(place, original)
        below = _options_below(place, alias) if alias else options(place, original)
        if below is None:
            return None
        made += below
    return made


def _optional(module: str, annotation: ast.expr) -> list[str] | None:
    """Return the options of `optional(Config, "left out", ...)`, or None for anything else."""
    for node in ast.walk(annotation):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "optional":
            config, *leave_out = node.args
            below = options(module, ast.unparse(config)) or []
            left_out = {ast.literal_eval(one).replace("_", "-") for one in leave_out}
            made = [one.rpartition(".")[2].removeprefix("no-") for one in below]
            return [one for one in made if one not in left_out]
    return None


def _types(annotation: ast.expr) -> Iterator[str]:
    """Yield the names in an annotation that may make options, as `Config` or `module.Config`."""
    parents = {node.value: node for node in ast.walk(annotation) if isinstance(node, ast.Attribute)}
    for node in ast.walk(annotation):
        if isinstance(node, ast.Name) and node.id not in _PLAIN:
            yield ast.unparse(parents.get(node, node))


def _names(annotation: ast.expr) -> Iterator[str]:
    return (node.id for node in ast.walk(annotation) if isinstance(node, ast.Name))


def _attributes(module: str, annotation: ast.expr) -> set[str]:
    """Return the attributes in an annotation, the module's own aliases spelled out."""
    aliases = [alias for name in _names(annotation) if (alias := _assigned(module, name))]
    nodes = (node for part in (annotation, *aliases) for node in ast.walk(part))
    return {node.attr for node in nodes if isinstance(node, ast.Attribute)}


def _renamed(annotation: ast.expr) -> str | None:
    """Return the name of a `tyro.conf.arg(name=...)`."""
    for node in ast.walk(annotation):
        for word in node.keywords if isinstance(node, ast.Call) else ():
            if word.arg == "name" and isinstance(word.value, ast.Constant):
                return str(word.value.value)
    return None


def _is_true(default: ast.expr | None) -> bool:
    """Whether a field is a flag that is on by default, so that its option turns it off."""
    return isinstance(default, ast.Constant) and default.value is True


def _class(module: str, name: str) -> ast.ClassDef | None:
    tree = _source(module)
    classes = (node for node in tree.body if isinstance(node, ast.ClassDef)) if tree else ()
    return next((node for node in classes if node.name == name), None)


def _assigned(module: str, name: str) -> ast.expr | None:
    """Return what a module assigns to a name."""
    for node in tree.body if (tree := _source(module)) else ():
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name:
            return node.value
    return None


def _defined(module: str, name: str) -> tuple[str, str]:
    """Return the module that a name is imported from and its name there, or the module itself."""
    first, _, rest = name.partition(".")
    for node in tree.body if (tree := _source(module)) else ():
        for alias in node.names if isinstance(node, ast.ImportFrom) else ():
            if first == (alias.asname or alias.name):
                place = str(node.module)  # pyright: ignore[reportAttributeAccessIssue]
                return (f"{place}.{alias.name}", rest) if rest else (place, alias.name)
    return module, name


@functools.cache
def _source(module: str) -> ast.Module | None:
    """Parse a module of this workspace; None for a module of another project."""
    if module.partition(".")[0] not in _PACKAGES:
        return None
    spec = importlib.util.find_spec(module)
    file = Path(spec.origin) if spec and spec.origin else None
    return ast.parse(file.read_bytes()) if file and file.suffix == ".py" else None
