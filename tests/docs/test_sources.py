"""The sources: names say their content, functions fit a screen, tests wait for events."""

import ast
from collections import Counter
from collections.abc import Collection, Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[2]
WORDS = """one other found made given seen place each more known shown kept drawn asked both whole
part parts wanted said named others many some rest mine theirs own thing things"""
VAGUE = frozenset(WORDS.split())
SHARE = 0.01  # of all assignments
LONGEST = 60  # lines of a function without docstrings, which are free


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


@cache
def trees(*folders: str) -> list[tuple[str, ast.AST]]:
    """Return the path and the syntax tree of every source; those of a user by default."""
    roots = [ROOT / name for name in folders or ("packages", "studies")]
    paths = (path for root in roots for path in root.rglob("*.py"))
    return [(str(path.relative_to(ROOT)), ast.parse(path.read_text())) for path in sorted(paths)]


def lines(node: ast.AST) -> int:
    """Return the number of lines of a node."""
    return node.end_lineno - node.lineno + 1


def documentation(function: ast.FunctionDef) -> int:
    """Return the number of lines of the docstrings in a function, those of inner ones included."""
    inner = (item for item in ast.walk(function) if isinstance(item, ast.FunctionDef))
    return sum(lines(item.body[0]) for item in inner if ast.get_docstring(item) is not None)


def long_functions(tree: ast.AST) -> list[str]:
    """Return the functions of more than `LONGEST` lines."""
    functions = (item for item in ast.walk(tree) if isinstance(item, ast.FunctionDef))
    return [item.name for item in functions if lines(item) - documentation(item) > LONGEST]


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
    assert (
        long_functions(ast.parse(f'def a():\n    """Return.\n\n    Long.\n    """\n{body}')) == []
    )


def test_functions_fit_a_screen():
    long = [f"{path}: {name}" for path, tree in trees() for name in long_functions(tree)]
    assert long == []


def packed(tree: ast.AST) -> list[int]:
    """Return the lines of assignments that hold several: `a, b = f(x), g(y)`."""
    return [
        node.lineno
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign)
        and isinstance(node.value, ast.Tuple)
        and isinstance(node.targets[0], ast.Tuple)
        and not {ast.dump(item) for item in names_in(node.targets[0])}
        & {ast.dump(item) for item in names_in(node.value)}
    ]


def names_in(node: ast.AST) -> list[ast.Name]:
    """Return the names of an expression, all as if they were read."""
    return [ast.Name(item.id, ast.Load()) for item in ast.walk(node) if isinstance(item, ast.Name)]


def test_a_line_holds_one_statement():
    assert packed(ast.parse("a, b = f(x), g(y)\nc, d = d, c\ne, f = pair")) == [1]
    assert [f"{path}:{line}" for path, tree in trees() for line in packed(tree)] == []


def explained(function: ast.FunctionDef) -> bool:
    """Whether a docstring has a section of Google's style."""
    text = ast.get_docstring(function) or ""
    return any(f"{section}:" in text for section in ("Args", "Returns", "Raises", "Yields"))


def test_public_functions_of_several_parameters_are_explained():
    functions = [
        node
        for _, tree in trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
        if len({item.arg for item in node.args.args + node.args.kwonlyargs} - {"self", "cls"}) > 1
    ]
    assert sum(map(explained, functions)) > 0.9 * len(functions) > 0


def imported_modules(tree: ast.AST, modules: Collection[str]) -> Iterator[str]:
    """Yield the modules that one imports, inside functions too, without what types alone need."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            continue
        if isinstance(node, ast.Import):
            yield from (item.name for item in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for item in node.names:
                inner = f"{node.module}.{item.name}"
                yield inner if inner in modules else node.module
        waiting.extend(ast.iter_child_nodes(node))


def test_no_circle_of_imports_even_inside_functions():
    modules = {
        path.split("/src/")[-1]
        .removesuffix(".py")
        .removesuffix("/__init__")
        .replace("/", "."): tree
        for path, tree in trees()
    }
    # A package itself loads what it names only when that is used.
    graph = {
        name: set(imported_modules(tree, modules)) - {name, "socialiq"}
        for name, tree in modules.items()
        if name != "socialiq"
    }
    assert list(TopologicalSorter(graph).static_order())


CLOCKS = ("monotonic", "perf_counter", "process_time", "thread_time", "time")
WAITING = ("communicate", "join", "recv", "wait", "HTTPConnection")
"""Calls that a number limits, their first argument or `timeout`."""
COMMANDS = ("tests/fuzz/__main__.py",)  # it runs for the minutes that it is given


def dotted(function: ast.expr) -> str:
    """Return the name of a function, or that of a module and its function; else the last name."""
    if isinstance(function, ast.Name):
        return function.id
    if not isinstance(function, ast.Attribute):
        return ""
    module = function.value
    return f"{module.id if isinstance(module, ast.Name) else '_'}.{function.attr}"


def reads_a_clock(node: ast.AST, names: set[str]) -> bool:
    """Whether an expression calls a clock or has one of the names."""
    for item in ast.walk(node):
        if isinstance(item, ast.Name) and item.id in names:
            return True
        if isinstance(item, ast.Call):
            name = dotted(item.func).removesuffix("_ns")
            if name in CLOCKS[:-1] or name in (f"time.{clock}" for clock in CLOCKS):
                return True
    return False


def limits_of_time(tree: ast.AST) -> list[int]:
    """Return the lines that compare times of a clock, or wait for a number of seconds."""
    names: set[str] = set()
    lines = []
    clocked = reads_a_clock(tree, names)
    for item in ast.walk(tree):
        if clocked and isinstance(item, ast.Assign):
            pairs = [(target, item.value) for target in item.targets]
            if isinstance(item.targets[0], ast.Tuple) and isinstance(item.value, ast.Tuple):
                pairs = [*zip(item.targets[0].elts, item.value.elts, strict=True)]
            names |= {
                target.id
                for target, value in pairs
                if isinstance(target, ast.Name) and reads_a_clock(value, names)
            }
    for item in ast.walk(tree):
        if clocked and isinstance(item, ast.Compare) and reads_a_clock(item, names):
            lines.append(item.lineno)
        if isinstance(item, ast.Call) and dotted(item.func).split(".")[-1] in WAITING:
            words = {word.arg: word.value for word in item.keywords}
            limits = (*item.args[:1], words.get("timeout"))
            values = [limit.value for limit in limits if isinstance(limit, ast.Constant)]
            if any(isinstance(value, int | float) for value in values):
                lines.append(item.lineno)
    return lines


def test_limits_of_time_are_found():
    for text in (
        "began = time.monotonic()\nx\nassert time.perf_counter_ns() < 5",
        "from time import monotonic\nend = monotonic() + 5\nwhile end > 0: pass",
        "x\ny\nchild.communicate(timeout=60)",
        "x\ny\nchild.wait(10)",
    ):
        assert limits_of_time(ast.parse(text)) == [3]
    assert limits_of_time(ast.parse("began = time.monotonic()\nchild.wait(HANG)\n1 < x")) == []


def test_no_test_depends_on_the_speed_of_the_machine():
    """`tests/patience.py` alone compares times, to end what hangs."""
    limits = {
        name: lines
        for name, tree in trees("tests")
        if name not in COMMANDS and (lines := limits_of_time(tree))
    }
    assert list(limits) == ["tests/patience.py"], limits
    assert len(limits["tests/patience.py"]) == 1
