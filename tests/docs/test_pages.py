"""Every python block of README and docs runs, in order, in one namespace for each page."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *ROOT.glob("docs/**/*.md")])
BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_code_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    namespace: dict = {"__name__": "page"}
    for number, block in enumerate(BLOCK.findall(page.read_text())):
        exec(compile(block, f"{page.name}, block {number}", "exec"), namespace)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for target in LINK.findall(page.read_text()):
        assert (page.parent / target).exists(), target


def test_every_command_of_the_readme_parses():
    import shlex

    from socialiq.cli.main import parse

    text = (ROOT / "README.md").read_text()
    lines = [
        line.split("socialiq ", 1)[1]
        for line in text.splitlines()
        if re.match(r"^(\.venv/bin/)?socialiq \w", line)
    ]
    assert len(lines) >= 5
    for line in lines:
        arguments = shlex.split(line.split(" | ")[0].split(" #")[0])
        assert parse(arguments) is not None
