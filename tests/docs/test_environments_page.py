"""The commands of docs/environments.md run as they stand there, one after another."""

import re
import shlex
from pathlib import Path

import pytest

from socialiq.cli.main import main

PAGE = (Path(__file__).parents[2] / "docs" / "environments.md").read_text()
STATUSES = {"audit": (0, 1, 3)}

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


@pytest.mark.slow
def test_the_commands_do_what_they_say(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    first = re.search(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    console = re.search(r"^```console\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert first and console
    exec(first[1], {})
    commands = console[1].replace("\\\n", " ").splitlines()
    assert len(commands) == 10
    for line in commands:
        program, *words = shlex.split(line)
        assert program == "socialiq"
        allowed = STATUSES.get(words[0], (0,)) if words[1] != "verify" else (0,)
        assert main(words) in allowed, capsys.readouterr().err
    page = Path("audit/report.md").read_text()
    assert page.count("\\[ blank \\]") == 8 and "does not report fault" in page

    # A report may come from anyone: what it would run has to be named by hand.
    again = ["audit", "verify", "audit", "--rerun", "--allow-code"]
    assert main(again) == 2
    assert "give it as --world yourself" in capsys.readouterr().err
    named = ["--world", "lane.py:make"]
    assert main([*again, *named]) == 2
    assert "give it as --reference yourself" in capsys.readouterr().err
    for driver in ("pushy", "polite"):
        named += ["--reference", f"python:lane.py:{driver}"]
    assert main([*again, *named]) == 0
