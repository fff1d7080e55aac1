"""The commands of docs/add-a-study.md run as they stand there, one after another."""

import re
import shlex
from pathlib import Path

import pytest

from socialiq.cli.main import main

PAGE = (Path(__file__).parents[2] / "docs" / "add-a-study.md").read_text()


@pytest.mark.slow
def test_the_commands_do_what_they_say(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    study = re.search(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    console = re.search(r"^```console\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert study and console
    assert study[1].count("\n") < 60
    Path("optima.py").write_text(study[1])
    commands = [shlex.split(line) for line in console[1].splitlines()]
    assert len(commands) == 3
    printed, solved = [], []
    for program, *words in commands:
        assert program == "socialiq"
        assert main(words) == 0, capsys.readouterr().err
        printed.append(capsys.readouterr().out)
        solved.append({p.parent.name: p.stat().st_mtime_ns for p in Path().rglob("job.json")})
    assert "largest mean total" in printed[0] and printed[1] == printed[0]
    assert set(solved[1]) == {"0", "45", "90"} and set(solved[2]) == {"0", "45", "90", "30"}
    assert solved[1] == {name: solved[2][name] for name in solved[1]}  # none was solved again
    lines = Path("finer/optima.csv").read_text().splitlines()
    assert lines[0] == "angle,value" and [line.split(",")[0] for line in lines[1:]] == [
        "0.0",
        "30.0",
    ]
    assert Path("optima/optima.png").read_bytes().startswith(b"\x89PNG")
