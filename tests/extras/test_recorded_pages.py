"""The examples of pages on recorded drivers: their fence is ```py. They need the extra `maps`."""

import re
from pathlib import Path

import pytest

pytest.importorskip("shapely", reason="extra `maps` is not installed")

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize(
    ("page", "count"),
    [("recorded-drivers", 2), ("recorded-conflicts", 1)],
)
def test_the_examples_run(tmp_path, monkeypatch, page, count):
    monkeypatch.chdir(tmp_path)
    text = (DOCS / f"{page}.md").read_text()
    blocks = re.findall(r"^```py\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert len(blocks) == count
    namespace: dict = {"__name__": "page"}
    for number, block in enumerate(blocks):
        exec(compile(block, f"{page}.md, block {number}", "exec"), namespace)


@pytest.mark.parametrize(
    ("page", "least"),
    [("recorded-drivers", 9), ("recorded-conflicts", 2)],
)
def test_every_command_parses(page, least):
    import shlex

    from socialiq.cli.main import parse

    text = (DOCS / f"{page}.md").read_text().replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line.startswith("$ socialiq ")]
    assert len(lines) >= least
    for line in lines:
        assert parse(shlex.split(line)[2:]) is not None
