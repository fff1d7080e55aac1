"""Every Python block of README and docs runs, links and anchors lead somewhere, commands parse."""

import importlib.util
import re
import shlex
from functools import cache
from pathlib import Path

import pytest

from socialiq.cli.main import parse

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
RUN = [page for page in PAGES if page.parent != ROOT or page.name == "README.md"]
LONG = ("context.md", "continuous.md", "effects.md", "environments.md", "extend.md", "merge.md")
"""Pages whose code trains or drives for seconds."""
BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#:\s]*)(?:#([^)\s]*))?\)")


@cache
def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub and Sphinx make them."""
    found: set[str] = set()
    for title in re.findall(r"^#+ (.+)$", CODE.sub("", page.read_text()), re.MULTILINE):
        words = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", title).strip().lower()
        anchor = re.sub(r"[^\w\- ]", "", words).replace(" ", "-")
        number = 1
        while anchor in found:
            anchor = f"{anchor.removesuffix(f'-{number - 1}')}-{number}"
            number += 1
        found.add(anchor)
    return found


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=[pytest.mark.slow] if page.name in LONG else []) for page in RUN],
    ids=[str(page.relative_to(ROOT)) for page in RUN],
)
def test_code_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    namespace: dict = {"__name__": "page"}
    for number, block in enumerate(BLOCK.findall(page.read_text())):
        exec(compile(block, f"{page.name}, block {number}", "exec"), namespace)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for target, anchor in LINK.findall(CODE.sub("", page.read_text())):
        found = page.parent / target if target else page
        assert found.exists(), target
        if anchor and found.suffix == ".md":
            assert anchor in anchors(found), f"{target}#{anchor}"


def test_anchors_are_those_of_headings(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "# The dial: `turn`, 90°\n## Again\n## Again\n```\n# no heading\n```\n## [A](b) c\n"
    )
    assert anchors(page) == {"the-dial-turn-90", "again", "again-1", "a-c"}


def commands(text: str) -> list[list[str]]:
    lines = re.findall(r"^socialiq (\w.*)$", text, re.MULTILINE)
    return [shlex.split(line.split(" | ")[0].split(" #")[0]) for line in lines]


def test_every_command_of_the_readme_parses():
    found = commands((ROOT / "README.md").read_text())
    assert len(found) >= 10
    for arguments in found:
        assert parse(arguments) is not None


def test_the_readme_is_short_and_uses_the_public_interface_alone():
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 90
    [block] = BLOCK.findall(text)
    assert len(block.splitlines()) <= 12
    assert re.findall(r"^\s*(?:import|from) (socialiq\S*)", block, re.MULTILINE) == ["socialiq"]


@pytest.mark.parametrize(
    ("query", "page"),
    [
        ("quickstart", "start.md"),
        ("install", "install.md"),
        ("pedestrian", "worlds/intersection-crosswalk.md"),
        ("onnx", "interchange.md"),
        ("glossary", "glossary.md"),
    ],
)
def test_a_search_finds_its_page_first(query, page):
    """The site's search puts pages first whose title has the query (docs/scorer.js)."""
    docs = ROOT / "docs"
    titles = {path: path.read_text().split("\n", 1)[0] for path in docs.glob("**/*.md")}
    named = [
        str(path.relative_to(docs)) for path, title in titles.items() if query in title.lower()
    ]
    assert named == [page]


def test_the_documentation_has_at_most_60000_words():
    """A word has a letter or a digit; tables count, blocks of code don't."""
    text = "\n".join(CODE.sub("", page.read_text()) for page in ROOT.glob("docs/**/*.md"))
    assert re.findall(r"^[<>]{7} .*", text, re.MULTILINE) == [], "marks of a merge"
    words = [word for word in text.split() if re.search(r"\w", word)]
    assert 10_000 < len(words) <= 60_000


def test_the_picture_of_the_readme_is_drawn_from_the_committed_table(tmp_path):
    path = ROOT / "docs" / "pictures" / "front.py"
    spec = importlib.util.spec_from_file_location("front", path)
    assert spec is not None and spec.loader is not None
    front = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(front)
    points = front.points()
    assert len(points) == 19 and {len(seeds) for seeds in points.values()} == {5}
    assert points[0.0][:, 0].mean() > points[90.0][:, 0].mean()
    texts = [one.get_text() for one in front.draw().axes[0].texts]
    assert [text.split("°")[0] for text in texts] == ["0", "15", "30", "45", "60", "75", "90"]
