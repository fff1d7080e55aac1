"""The examples of docs/recorded-drivers.md; they need the extra `data`, so their fence is ```py."""

import re
from pathlib import Path

import pytest

pytest.importorskip("shapely", reason="extra `data` is not installed")

PAGE = Path(__file__).parents[2] / "docs" / "recorded-drivers.md"


def test_the_examples_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```py\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert len(blocks) == 2
    namespace: dict = {"__name__": "page"}
    for number, block in enumerate(blocks):
        exec(compile(block, f"{PAGE.name}, block {number}", "exec"), namespace)


def test_every_command_parses():
    import shlex

    from socialiq.cli.main import parse

    text = PAGE.read_text().replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line.startswith("$ socialiq ")]
    assert len(lines) >= 8
    for line in lines:
        assert parse(shlex.split(line)[2:]) is not None
