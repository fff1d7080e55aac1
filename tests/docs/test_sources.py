"""The sources: names of variables say their content, functions fit a screen."""

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
WORDS = """one other found made given seen place each more known shown kept drawn asked both whole
part parts wanted said named others many some rest mine theirs own thing things"""
VAGUE = frozenset(WORDS.split())
SHARE = 0.01  # of all assignments
LONGEST = 60  # lines of a function, with its docstring


def assigned(tree: ast.AST) -> list[str]:
    """Return the names that assignments, loops and comprehensions bind."""
    targets: list[ast.expr] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.For | ast.comprehension):
            targets.append(node.target)
        elif isinstance(node, ast.Assign):
            targets += node.targets
    names = (item for target in targets for item in ast.walk(target) if isinstance(item, ast.Name))
    return [name.id for name in names if name.id not in ("self", "cls", "_")]


def test_variables_are_found():
    tree = ast.parse("one = 1\nfor track in (tracks := []):\n    a, found = track\n[x for x in y]")
    assert sorted(assigned(tree)) == ["a", "found", "one", "track", "x"]


def trees() -> Iterator[tuple[str, ast.AST]]:
    """Yield the path and the syntax tree of every source."""
    for folder in ("packages", "studies"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield str(path.relative_to(ROOT)), ast.parse(path.read_text())


def long_functions(tree: ast.AST) -> list[str]:
    """Return the functions of more than `LONGEST` lines."""
    functions = (item for item in ast.walk(tree) if isinstance(item, ast.FunctionDef))
    return [item.name for item in functions if item.end_lineno - item.lineno >= LONGEST]


def test_variables_name_their_content():
    total = 0
    vague: Counter[str] = Counter()
    for path, tree in trees():
        names = assigned(tree)
        total += len(names)
        vague[path] += sum(name in VAGUE for name in names)
    worst = ", ".join(f"{path} ({count})" for path, count in vague.most_common(5) if count)
    assert vague.total() < SHARE * total, f"name the content of variables in {worst}"


def defined(tree: ast.AST) -> Iterator[str]:
    """Yield the names of functions and classes, and of parameters."""
    for item in ast.walk(tree):
        if isinstance(item, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield item.name
        elif isinstance(item, ast.arg):
            yield item.arg


def test_definitions_and_parameters_are_found():
    code = "class A:\n  def b(self, *c, d, **e): pass\nasync def f(): lambda g, /: g"
    assert {*defined(ast.parse(code))} == {*"Abcdefg", "self"}


def test_definitions_and_parameters_name_their_content():
    """`part` and `parts` are terms: pieces of episodes that processes share, of a file that a page
    reads."""
    terms = {"part", "parts"}
    vague = [
        f"{path}: {name}"
        for path, tree in trees()
        for name in defined(tree)
        if name in VAGUE - terms
    ]
    assert vague == []


def test_long_functions_are_found():
    body = "\n".join("    x = 1" for _ in range(LONGEST - 1))
    assert long_functions(ast.parse(f"def a():\n{body}")) == []
    assert long_functions(ast.parse(f"class B:\n  def b(self):\n{body}\n    x = 1")) == ["b"]


def test_functions_fit_a_screen():
    long = [f"{path}: {name}" for path, tree in trees() for name in long_functions(tree)]
    assert long == []
