"""The examples of docs/recorded-drivers.md; they need the extra `data`, so their fence is ```py."""

import re
from pathlib import Path

import pytest

pytest.importorskip("shapely", reason="extra `data` is not installed")

DOCS = Path(__file__).parents[2] / "docs"
PAGE = DOCS / "recorded-drivers.md"


def test_the_examples_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```py\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert len(blocks) == 2
    namespace: dict = {"__name__": "page"}
    for number, block in enumerate(blocks):
        exec(compile(block, f"{PAGE.name}, block {number}", "exec"), namespace)


@pytest.mark.parametrize(("page", "least"), [("recorded-drivers", 8), ("recorded-conflicts", 3)])
def test_every_command_parses(page, least):
    import shlex

    from socialiq.cli.main import parse

    text = (DOCS / f"{page}.md").read_text().replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line.startswith("$ socialiq ")]
    assert len(lines) >= least
    for line in lines:
        assert parse(shlex.split(line)[2:]) is not None
