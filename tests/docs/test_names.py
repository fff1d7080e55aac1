"""Variables of the sources name their content: no pronouns and participles."""

import ast
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[2]
WORDS = """one other found made given seen place each more known shown kept drawn asked both whole
part parts wanted said named others many some rest mine theirs own thing things"""
VAGUE = frozenset(WORDS.split())
SHARE = 0.01  # of all assignments


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


def test_variables_name_their_content():
    total: Counter[str] = Counter()
    vague: Counter[str] = Counter()
    for folder in ("packages", "studies"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            names = assigned(ast.parse(path.read_text()))
            total[folder] += len(names)
            vague[str(path.relative_to(ROOT))] += sum(name in VAGUE for name in names)
    worst = ", ".join(f"{path} ({count})" for path, count in vague.most_common(5) if count)
    assert vague.total() < SHARE * total.total(), f"name the content of variables in {worst}"
