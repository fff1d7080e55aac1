"""The examples of the page on recorded drivers, with the fence ```py, need the extra `maps`."""

import re
from pathlib import Path

import pytest

pytest.importorskip("shapely", reason="extra `maps` is not installed")

PAGE = (Path(__file__).parents[2] / "docs" / "recorded-conflicts.md").read_text()


def test_the_examples_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```py\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 3
    namespace: dict = {"__name__": "page"}
    for number, block in enumerate(blocks):
        exec(compile(block, f"recorded-conflicts.md, block {number}", "exec"), namespace)


def test_every_command_parses():
    import shlex

    from socialiq.cli.main import parse

    lines = [
        line for line in PAGE.replace("\\\n", " ").splitlines() if line.startswith("$ socialiq ")
    ]
    assert len(lines) >= 11
    for line in lines:
        assert parse(shlex.split(line)[2:]) is not None
