"""Docstrings and options of commands, read from their sources without an import.

A command's module may import a learner or a simulator, which takes seconds. The help page and a
mistyped option don't wait for that.
"""

from __future__ import annotations

import ast
import functools
import importlib.util
from collections.abc import Iterator
from pathlib import Path

_PACKAGES = ("socialiq", "socialiq_recordings", "socialiq_lab")
_PLAIN = ("str", "int", "float", "bool", "tuple", "Path", "Literal", "Annotated", "Any", "tyro")
"""Names in an annotation that make no options of their own."""
_OF_SETTINGS = ("Config", "Hyperparameters")


def summary(module: str, name: str) -> str:
    """Return the first line of a class's docstring.

    Args:
        module: Module of the class.
        name: Its name there.

    Raises:
        LookupError: If the module has no such class.
    """
    definition = _class(module, name)
    if definition is None:
        raise LookupError(f"{module} has no class {name}")
    return (ast.get_docstring(definition) or "").partition("\n")[0]


def options(module: str, name: str) -> list[str] | None:
    """Return the options that the parser makes of a dataclass, without their dashes.

    Args:
        module: Module of the class, or one that imports it from there.
        name: Its name there.

    Returns:
        The options, or None where an annotation is not understood.
    """
    module, name = _defined(module, name)
    alias = _assigned(module, name)
    if alias is not None:
        return _options_below(module, alias)
    definition = _class(module, name)
    if definition is None:
        return None
    names: list[str] = []
    for base in definition.bases:
        inherited = options(module, ast.unparse(base))
        if inherited is None:
            return None
        names += inherited
    for field in definition.body:
        if not isinstance(field, ast.AnnAssign) or not isinstance(field.target, ast.Name):
            continue
        if field.target.id == "_":  # `_: KW_ONLY` separates fields and is none
            continue
        below = _options_below(module, field.annotation)
        if below is None:
            return None
        marks = _marks(module, field.annotation)
        option = _renamed(field.annotation) or field.target.id.replace("_", "-")
        if below:
            prefix = "" if "OmitArgPrefixes" in marks else f"{option}."
            names += [prefix + nested for nested in below]
        elif "Positional" not in marks:
            is_true = isinstance(field.value, ast.Constant) and field.value.value is True
            names.append(f"no-{option}" if is_true else option)
    return list(dict.fromkeys(names))


def learner_settings() -> frozenset[str]:
    """Return the names of all settings of learners, which --set takes."""
    spec = importlib.util.find_spec("socialiq.learners")
    assert spec is not None and spec.origin is not None
    names = set()
    for path in Path(spec.origin).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.ClassDef) and (
                path.stem in ("config", "settings") or node.name.endswith(_OF_SETTINGS)
            ):
                fields = [line for line in node.body if isinstance(line, ast.AnnAssign)]
                names |= {ast.unparse(field.target) for field in fields}
    return frozenset(names)


def _options_below(module: str, annotation: ast.expr) -> list[str] | None:
    """Return the options of the dataclasses in an annotation; none for plain types."""
    names: list[str] = []
    for name in _types(annotation):
        alias = _assigned(*_defined(module, name))
        below = options(module, name)
        if below is None and alias is None:
            return None
        names += below or ()
    return names


def _types(annotation: ast.expr) -> Iterator[str]:
    """Yield the names in an annotation that may make options, as `Config` or `module.Config`."""
    nodes = list(ast.walk(annotation))
    parents = {node.value: node for node in nodes if isinstance(node, ast.Attribute)}
    metadata = {
        inner
        for node in nodes
        if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "Annotated"
        for extra in getattr(node.slice, "elts", [])[1:]
        for inner in ast.walk(extra)
    }
    for node in nodes:
        if isinstance(node, ast.Name) and node.id not in _PLAIN and node not in metadata:
            yield ast.unparse(parents.get(node, node))


def _marks(module: str, annotation: ast.expr) -> set[str]:
    """Return the attributes in an annotation, the module's own aliases spelled out."""
    names = [node.id for node in ast.walk(annotation) if isinstance(node, ast.Name)]
    aliases = [alias for name in names if (alias := _assigned(*_defined(module, name)))]
    nodes = (node for tree in (annotation, *aliases) for node in ast.walk(tree))
    return {node.attr for node in nodes if isinstance(node, ast.Attribute)}


def _renamed(annotation: ast.expr) -> str | None:
    """Return the name of a `tyro.conf.arg(name=...)`."""
    for node in ast.walk(annotation):
        for word in node.keywords if isinstance(node, ast.Call) else ():
            if word.arg == "name" and isinstance(word.value, ast.Constant):
                return str(word.value.value)
    return None


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
    first, _, attribute = name.partition(".")
    tree = _source(module)
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)] if tree else []
    for node in imports:
        for alias in node.names:
            if first == (alias.asname or alias.name):
                origin = str(node.module)
                return (f"{origin}.{alias.name}", attribute) if attribute else (origin, alias.name)
    return module, name


@functools.cache
def _source(module: str) -> ast.Module | None:
    """Parse a module of this workspace; None for a module of another project."""
    if module.partition(".")[0] not in _PACKAGES:
        return None
    spec = importlib.util.find_spec(module)
    file = Path(spec.origin) if spec and spec.origin else None
    return ast.parse(file.read_bytes()) if file and file.suffix == ".py" else None
